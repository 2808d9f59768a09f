// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/device.h"

#include <c10/core/impl/DeviceGuardImplInterface.h>
#include <fmt/format.h>
#include <torch/version.h>

#include <atomic>
#include <charconv>
#include <string_view>

namespace etude::policy {
namespace {

constexpr std::string_view kCuda = "cuda";

std::atomic<int> aten_only{0};

// The number behind "cuda:"; -1: none, or no number.
int NumberOf(std::string_view name) {
  if (name.size() <= kCuda.size() + 1 || name[kCuda.size()] != ':') return -1;
  const char* const end = name.data() + name.size();
  int number = -1;
  const auto read = std::from_chars(name.data() + kCuda.size() + 1, end, number);
  return read.ec == std::errc() && read.ptr == end ? number : -1;
}

}  // namespace

Result<torch::Device> OpenDevice(const std::string& name, int rank) {
  if (name == "cpu") return torch::Device(torch::kCPU);
  int number = NumberOf(name);
  if (name != kCuda && (!name.starts_with(kCuda) || number < 0))
    return Fail(Code::kInvalidArgument, fmt::format("device '{}': must be cpu, cuda or cuda:NUMBER", name));
  // whoever computes on a device registers this when it is loaded
  if (!c10::impl::hasDeviceGuardImpl(torch::kCUDA))
    return Fail(Code::kUnavailable,
                fmt::format("device '{}': this libtorch ({}) was built without CUDA; leave out --device, or build with "
                            "a CUDA libtorch (CMAKE_PREFIX_PATH)",
                            name, TORCH_VERSION));
  const auto count = static_cast<int>(torch::cuda::device_count());
  if (name == kCuda && count > 0) number = rank % count;
  if (count == 0 || number >= count)
    return Fail(Code::kUnavailable, fmt::format("device '{}': the CUDA driver shows {} device{} here (see nvidia-smi)",
                                                name, count, count == 1 ? "" : "s"));
  // float32 is float32 there too; what may be rounded is a policy's `precision`
  at::globalContext().setAllowTF32CuDNN(false);
  return torch::Device(torch::kCUDA, static_cast<c10::DeviceIndex>(number));
}

torch::Tensor ToDevice(const torch::Tensor& tensor, const torch::Device& device) {
  if (tensor.device() == device) return tensor;
  if (!device.is_cuda() || !tensor.device().is_cpu()) return tensor.to(device);
  // the caching allocator of pinned memory waits for the copy before it gives the memory to somebody else
  return tensor.pin_memory().to(device, tensor.scalar_type(), /*non_blocking=*/true);
}

bool UsesOwnKernels(const torch::Device& device) { return device.is_cpu() && aten_only == 0; }

AtenOnly::AtenOnly() { ++aten_only; }
AtenOnly::~AtenOnly() { --aten_only; }

}  // namespace etude::policy
