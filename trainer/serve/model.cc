// SPDX-License-Identifier: Apache-2.0
#include "trainer/serve/model.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "services/core/hash.h"
#include "services/episode/action.h"

namespace etude::serve {
namespace {

std::vector<float> Values(const torch::Tensor& tensor) {
  const auto flat = tensor.to(torch::kFloat32).contiguous().view({-1});
  return {flat.data_ptr<float>(), flat.data_ptr<float>() + flat.numel()};
}

// the module that says the trajectory; nullptr when the network has none
const policy::ModuleOutput* FindTrajectory(const policy::Outputs& outputs) {
  for (const auto& [name, output] : outputs)
    if (output.decoded.contains("trajectory")) return &output;
  return nullptr;
}

OrderedJson Rounded(const std::vector<float>& values) {
  auto list = OrderedJson::array();
  for (const float value : values)
    list.push_back(std::isfinite(value) ? OrderedJson(std::round(value * 1e5) / 1e5) : OrderedJson(nullptr));
  return list;
}

}  // namespace

Result<std::shared_ptr<const Model>> Model::FromBytes(std::span<const std::uint8_t> bytes) {
  auto model = std::shared_ptr<Model>(new Model());
  ETUDE_ASSIGN_OR_RETURN(model->checkpoint_, publish::DecodeCheckpoint(bytes));
  ETUDE_ASSIGN_OR_RETURN(model->policy_, publish::BuildPolicy(model->checkpoint_));
  model->checkpoint_.tensors.clear();
  model->sha256_ = Sha256Hex(bytes);
  return std::shared_ptr<const Model>(std::move(model));
}

Result<std::shared_ptr<const Model>> Model::FromFile(const Path& path) {
  ETUDE_ASSIGN_OR_RETURN(const auto bytes, ReadBinaryFile(path));
  auto model = FromBytes(bytes);
  if (!model) return Fail(model.error().Wrap(fmt::format("read '{}'", path.string())));
  return model;
}

Result<policy::Inputs> Model::Prepare(const bus::Observation& observation) const {
  const auto& crop = checkpoint_.policy.image.crop;
  const std::size_t width = observation.width, height = observation.height;
  if (width > 16384 || height > 16384 || observation.image.size() != width * height * 3)
    return Fail(Code::kInvalidArgument,
                fmt::format("image of {} bytes is not {}x{} RGB", observation.image.size(), width, height));
  if (static_cast<std::size_t>(crop[0] + crop[2]) > width || static_cast<std::size_t>(crop[1] + crop[3]) > height)
    return Fail(Code::kInvalidArgument,
                fmt::format("picture of {}x{} px: this policy looks at {}x{} px from ({}, {}) on", width, height,
                            crop[2], crop[3], crop[0], crop[1]));
  if (static_cast<int>(observation.joints.size()) != info().joints)
    return Fail(Code::kInvalidArgument,
                fmt::format("{} joints: this policy reads {}", observation.joints.size(), info().joints));
  if (!std::all_of(observation.joints.begin(), observation.joints.end(), [](float q) { return std::isfinite(q); }))
    return Fail(Code::kInvalidArgument, "a joint position is not a finite number");

  policy::Inputs inputs;
  auto image = torch::empty({1, crop[3], crop[2], 3}, torch::kUInt8);
  const std::size_t row = static_cast<std::size_t>(crop[2]) * 3;
  for (int y = 0; y < crop[3]; ++y)
    std::memcpy(image.data_ptr<std::uint8_t>() + row * static_cast<std::size_t>(y),
                observation.image.data() +
                    (static_cast<std::size_t>(crop[1] + y) * width + static_cast<std::size_t>(crop[0])) * 3,
                row);
  inputs.images = image.permute({0, 3, 1, 2});
  inputs.crop_origin = torch::tensor({static_cast<float>(crop[0]), static_cast<float>(crop[1])}).view({1, 2});
  inputs.joints = torch::tensor(observation.joints, torch::kFloat32).view({1, -1});
  inputs.sentences = {observation.instruction};
  inputs.sentence_index = torch::zeros({1, 1}, torch::kInt64);
  return inputs;
}

OrderedJson Model::Describe(const policy::Outputs& outputs) const {
  OrderedJson json = OrderedJson::object();
  for (const auto& module : config().modules) {
    const auto it = outputs.find(module.name);
    if (it == outputs.end()) continue;
    OrderedJson& item = json[module.name] = OrderedJson::object();
    for (const auto& [kind, value] : it->second.decoded) {
      if (kind == "class") {
        const auto probabilities = Values(torch::softmax(value.to(torch::kFloat32), -1));
        const auto best = std::max_element(probabilities.begin(), probabilities.end()) - probabilities.begin();
        item["class"] = config().objects.at(static_cast<std::size_t>(best));
        item["probability"] = std::round(probabilities[static_cast<std::size_t>(best)] * 1e5) / 1e5;
      } else if (kind != "trajectory") {
        item[kind] = Rounded(Values(value));
        if (kind == "pose") item["position"] = Rounded(Values(value.narrow(-1, 0, 3)));
      }
    }
    if (it->second.soft_argmax.defined()) item["soft_argmax"] = Rounded(Values(it->second.soft_argmax));
  }
  return json;
}

bus::Action Model::Answer(const bus::Observation& observation) const {
  bus::Action action;
  action.run = observation.run;
  action.session = observation.session;
  action.request_id = observation.request_id;
  action.checkpoint_step = info().step;
  action.checkpoint_sha256 = sha256_;
  try {
    const auto inputs = Prepare(observation);
    if (!inputs) {
      action.error = inputs.error().message;
      return action;
    }
    const torch::NoGradGuard no_grad;
    const auto outputs = policy_->Forward(*inputs);
    action.modules_json = Describe(outputs).dump();
    const auto* trajectory = FindTrajectory(outputs);
    if (trajectory) action.waypoints = Values(trajectory->decoded.at("trajectory"));
    if (static_cast<int>(action.waypoints.size()) != kWaypoints * kWaypointSize)
      action.error = "this policy has no module that decodes a trajectory";
    else if (!std::all_of(action.waypoints.begin(), action.waypoints.end(), [](float x) { return std::isfinite(x); }))
      action.error = "the policy's answer is not finite";
  } catch (const std::exception& error) {
    action.error = fmt::format("evaluate the policy: {}", error.what());
  }
  if (!action.error.empty()) action.waypoints.clear();
  return action;
}

}  // namespace etude::serve
