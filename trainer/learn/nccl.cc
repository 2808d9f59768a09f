// SPDX-License-Identifier: Apache-2.0
#include "trainer/learn/nccl.h"

#include <cstdlib>
#include <set>

#include "services/core/check.h"

#ifdef USE_C10D_NCCL
#include <ATen/cuda/CUDAContext.h>
#include <fmt/format.h>

#include <torch/csrc/distributed/c10d/ProcessGroupNCCL.hpp>
#endif

namespace etude::learn {

bool AreCardsApart(const std::vector<std::string>& cards) {
  const std::set<std::string> different(cards.begin(), cards.end());
  return different.size() == cards.size() && !different.contains("");
}

#ifdef USE_C10D_NCCL

std::string CardOf(const torch::Device& device) {
  if (!device.is_cuda()) return "";
  std::string text;
  for (const char byte : at::cuda::getDeviceProperties(device.index())->uuid.bytes)
    text += fmt::format("{:02x}", static_cast<unsigned char>(byte));
  return text;
}

CardSum OpenCardSum(const c10::intrusive_ptr<c10d::Store>& store, int rank, int size,
                    std::chrono::milliseconds patience) {
  // a wait that fails says so here, instead of ending the process without words
  setenv("TORCH_NCCL_BLOCKING_WAIT", "1", 1);
  auto options = c10d::ProcessGroupNCCL::Options::create();
  options->timeout = patience;
  const auto group = c10::make_intrusive<c10d::ProcessGroupNCCL>(store, rank, size, options);
  return [group](std::vector<torch::Tensor>& tensors) {
    return group->allreduce(tensors, c10d::AllreduceOptions())->wait();
  };
}

#else

std::string CardOf(const torch::Device&) { return ""; }

CardSum OpenCardSum(const c10::intrusive_ptr<c10d::Store>&, int, int, std::chrono::milliseconds) {
  ETUDE_CHECK(false, "built without NCCL");
  std::abort();
}

#endif

}  // namespace etude::learn
