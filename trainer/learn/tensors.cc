// SPDX-License-Identifier: Apache-2.0
#include "trainer/learn/tensors.h"

#include "services/episode/action.h"

namespace etude::learn {
namespace {

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
    part.labels[name] = Wrap(label.values.data(), label.shape, torch::kFloat32, first, last);
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

}  // namespace etude::learn
