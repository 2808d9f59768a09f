// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/tensors.h"

#include <fmt/format.h>

#include <cstring>
#include <utility>

namespace etude::checkpoint {
namespace {

constexpr std::pair<store::DType, torch::ScalarType> kTypes[] = {
    {store::DType::kF32, torch::kFloat32},   {store::DType::kF16, torch::kFloat16},
    {store::DType::kBF16, torch::kBFloat16}, {store::DType::kF64, torch::kFloat64},
    {store::DType::kI64, torch::kInt64},     {store::DType::kI32, torch::kInt32},
    {store::DType::kU8, torch::kUInt8},      {store::DType::kBool, torch::kBool}};

}  // namespace

Result<store::Tensor> ToStore(const torch::Tensor& tensor) {
  const torch::Tensor dense = tensor.detach().to(torch::kCPU).contiguous();
  for (const auto& [own, theirs] : kTypes) {
    if (dense.scalar_type() != theirs) continue;
    store::Tensor result{own, dense.sizes().vec(), {}};
    result.data.resize(static_cast<std::size_t>(dense.nbytes()));
    std::memcpy(result.data.data(), dense.data_ptr(), result.data.size());
    return result;
  }
  return Fail(Code::kInvalidArgument,
              fmt::format("save a tensor: type {} is not supported", std::string(dense.dtype().name())));
}

torch::Tensor FromStore(const store::Tensor& tensor) {
  torch::ScalarType type = torch::kFloat32;
  for (const auto& [own, theirs] : kTypes)
    if (tensor.dtype == own) type = theirs;
  torch::Tensor result = torch::empty(tensor.shape, torch::TensorOptions().dtype(type));
  std::memcpy(result.data_ptr(), tensor.data.data(), tensor.data.size());
  return result;
}

}  // namespace etude::checkpoint
