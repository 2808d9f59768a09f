// SPDX-License-Identifier: Apache-2.0
#include "trainer/learn/tensors.h"

#include "services/episode/action.h"
#include "services/episode/viewpoint.h"
#include "trainer/policy/device.h"

namespace etude::learn {
namespace {

/// Takes rows [first, last) out of a batch's arrays.
struct Rows {
  int first, last;
  torch::Device device;

  torch::Tensor Of(void* data, const std::vector<std::int64_t>& shape, torch::ScalarType type) const {
    const auto whole = torch::from_blob(data, shape, torch::TensorOptions().dtype(type));
    return policy::ToDevice(whole.slice(0, first, last), device);
  }
};

}  // namespace

Part PartOf(data::Batch& batch, int first, int last, const torch::Device& device) {
  const std::int64_t B = batch.size;
  const Rows rows{first, last, device};
  Part part;
  part.inputs.images =
      rows.Of(batch.images.data(), {B, batch.height, batch.width, 3}, torch::kUInt8).permute({0, 3, 1, 2});
  part.inputs.crop_origin = rows.Of(batch.crop_origin.data(), {B, 2}, torch::kFloat32);
  part.inputs.viewpoint = rows.Of(batch.viewpoint.data(), {B, kViewpointSize}, torch::kFloat32);
  part.inputs.joints = rows.Of(batch.joints.data(), {B, batch.joints_each}, torch::kFloat32);
  part.inputs.sentences = batch.sentences;
  part.inputs.sentence_index = rows.Of(batch.sentence_index.data(), {B, batch.sentences_each}, torch::kInt64);
  for (auto& [name, label] : batch.labels) {
    part.labels[name] = rows.Of(label.values.data(), label.shape, torch::kFloat32);
    part.labels[name + ".valid"] = rows.Of(label.valid.data(), label.valid_shape, torch::kBool);
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
