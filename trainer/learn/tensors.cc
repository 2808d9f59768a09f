// SPDX-License-Identifier: Apache-2.0
#include "trainer/learn/tensors.h"

#include <fmt/format.h>

#include <cstring>
#include <utility>

#include "services/episode/action.h"

namespace etude::learn {
namespace {

constexpr std::pair<store::DType, torch::ScalarType> kTypes[] = {
    {store::DType::kF32, torch::kFloat32},   {store::DType::kF16, torch::kFloat16},
    {store::DType::kBF16, torch::kBFloat16}, {store::DType::kF64, torch::kFloat64},
    {store::DType::kI64, torch::kInt64},     {store::DType::kI32, torch::kInt32},
    {store::DType::kU8, torch::kUInt8},      {store::DType::kBool, torch::kBool}};

torch::Tensor Wrap(void* data, const std::vector<std::int64_t>& shape, torch::ScalarType type, int first, int last) {
  return torch::from_blob(data, shape, torch::TensorOptions().dtype(type)).slice(0, first, last);
}

}  // namespace

Part PartOf(data::Batch& batch, int first, int last) {
  const std::int64_t B = batch.size;
  Part part;
  part.inputs.images =
      Wrap(batch.images.data(), {B, batch.height, batch.width, 3}, torch::kUInt8, first, last).permute({0, 3, 1, 2});
  part.inputs.crop_origin = Wrap(batch.crop_origin.data(), {B, 2}, torch::kFloat32, first, last);
  part.inputs.joints = Wrap(batch.joints.data(), {B, batch.joints_each}, torch::kFloat32, first, last);
  part.inputs.sentences = batch.sentences;
  part.inputs.sentence_index = Wrap(batch.sentence_index.data(), {B, batch.sentences_each}, torch::kInt64, first, last);
  for (auto& [name, label] : batch.labels) {
    part.labels[name] = label.classes.empty() ? Wrap(label.values.data(), label.shape, torch::kFloat32, first, last)
                                              : Wrap(label.classes.data(), label.shape, torch::kInt64, first, last);
    part.labels[name + ".valid"] = Wrap(label.valid.data(), label.valid_shape, torch::kBool, first, last);
  }
  return part;
}

policy::Normalization ToNormalization(const data::Statistics& statistics) {
  const auto tensor = [](const std::vector<float>& values) { return torch::tensor(values, torch::kFloat32); };
  return {tensor(statistics.joint_mean),       tensor(statistics.joint_std),
          tensor(statistics.position_mean),    tensor(statistics.position_std),
          tensor(statistics.displacement_std), tensor(statistics.offset_std).view({kWaypoints, 3})};
}

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

}  // namespace etude::learn
