// SPDX-License-Identifier: Apache-2.0
// Model::Inspect: what the modules say of an observation, where they look, and what they would say.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "trainer/policy/answer.h"
#include "trainer/policy/crop.h"
#include "trainer/policy/torch_error.h"
#include "trainer/policy/what_if.h"
#include "trainer/policy/worth.h"
#include "trainer/serve/model.h"

namespace etude::serve {
namespace {

using torch::Tensor;

/// Appends one module's attention of every head, each scaled to its largest weight, and says where it lies.
void PutAttention(const policy::Policy& network, const std::string& module, const policy::ModuleOutput& output,
                  OrderedJson& layout, std::vector<std::uint8_t>& bytes) {
  const Tensor heads =
      output.head_attention.select(0, 0).select(0, 0).to(torch::kCPU, torch::kFloat32).contiguous();  // (h, K)
  const Tensor largest = std::get<0>(heads.max(-1, /*keepdim=*/true)).clamp_min(1e-12);
  const Tensor scaled = (heads / largest * 255).round().to(torch::kUInt8).contiguous();
  OrderedJson& place = layout[module] = {{"offset", bytes.size()}, {"heads", heads.size(0)}};
  std::vector<std::string> keys = network.KeysOf(module);
  if (!keys.empty() && keys[0] == "image") {
    const auto [rows, columns] = network.grid();
    place["image"] = {rows, columns};
    keys.erase(keys.begin());
  }
  place["keys"] = keys;
  for (std::int64_t h = 0; h < heads.size(0); ++h) place["scale"].push_back(largest[h][0].item<double>());
  const auto* first = scaled.data_ptr<std::uint8_t>();
  bytes.insert(bytes.end(), first, first + scaled.numel());
}

// As the observation is, but for what the what-if changes of it, and where it lies in the camera's.
void PutPicture(const policy::Inputs& inputs, const codec::Region& crop, bus::Insight& insight) {
  for (const int number : policy::ToNumbers(crop)) insight.view.push_back(static_cast<std::uint32_t>(number));
  const Tensor picture = inputs.images.select(0, 0).permute({1, 2, 0}).contiguous();
  insight.height = static_cast<std::uint32_t>(picture.size(0));
  insight.width = static_cast<std::uint32_t>(picture.size(1));
  const auto* first = picture.data_ptr<std::uint8_t>();
  insight.picture.assign(first, first + picture.numel());
}

// None where they are not finite: the modules may be seen all the same.
std::vector<float> FiniteWaypoints(const policy::PolicyConfig& config, const policy::Outputs& outputs) {
  auto waypoints = policy::WaypointsOf(config, outputs);
  if (!std::ranges::all_of(waypoints, [](float x) { return std::isfinite(x); })) waypoints.clear();
  return waypoints;
}

std::string WorthText(const policy::Worth& worth) {
  OrderedJson words = OrderedJson::array();
  for (const auto& [word, moves] : worth.words) words.push_back(OrderedJson{{"word", word}, {"moves", moves}});
  return OrderedJson{{"words", words}, {"joints", worth.joints}}.dump();
}

}  // namespace

Status Model::InspectInto(const bus::Observation& observation, const std::string& what_if_json,
                          bus::Insight& insight) const {
  ETUDE_ASSIGN_OR_RETURN(const auto what_if, policy::ParseWhatIf(what_if_json, metadata_.policy));
  const auto check = [&](const std::string& sentence) -> Status {
    if (const Status readable = policy_->CheckSentence(sentence); !readable)
      return Fail(readable.error().Wrap("what if"));
    return {};
  };
  ETUDE_RETURN_IF_ERROR(check(what_if.sentence));
  for (const auto& [module, sentence] : what_if.think) ETUDE_RETURN_IF_ERROR(check(sentence));
  ETUDE_ASSIGN_OR_RETURN(auto inputs, Prepare(observation));
  const torch::NoGradGuard no_grad;
  const auto outputs = policy_->Forward(inputs);
  insight.modules_json = policy::DescribeModules(metadata_.policy, outputs).dump();
  insight.waypoints = FiniteWaypoints(metadata_.policy, outputs);
  OrderedJson layout = OrderedJson::object();
  for (const auto& module : metadata_.policy.modules)
    PutAttention(*policy_, module.name, outputs.at(module.name), layout, insight.attention);
  insight.attention_json = layout.dump();
  PutPicture(inputs, policy::CropOf(metadata_.policy.image), insight);
  if (what_if.worth) insight.worth_json = WorthText(policy::WorthOf(*policy_, inputs));
  if (what_if.empty()) return {};
  inputs.images = inputs.images.clone();
  policy::Hide(what_if, inputs.images, inputs.crop_origin);
  inputs.unattended = policy::Unattended(what_if, inputs.crop_origin);
  if (!what_if.sentence.empty()) inputs.sentences = {what_if.sentence};
  auto thoughts = policy::ThoughtsOf(what_if, *policy_, inputs);
  const auto changed = policy_->Forward(inputs, 0, policy::SayInstead(what_if, metadata_.policy, std::move(thoughts)));
  insight.what_if_json = policy::DescribeModules(metadata_.policy, changed).dump();
  insight.what_if_waypoints = FiniteWaypoints(metadata_.policy, changed);
  return {};
}

bus::Insight Model::Inspect(const bus::Observation& observation, const std::string& what_if_json) const {
  bus::Insight insight;
  insight.run = observation.run;
  insight.run_id = observation.run_id;
  insight.session = observation.session;
  insight.request_id = observation.request_id;
  insight.instruction = observation.instruction;
  insight.checkpoint_step = metadata_.step;
  insight.checkpoint_sha256 = sha256_;
  try {
    if (const Status done = InspectInto(observation, what_if_json, insight); !done)
      insight.error = done.error().message;
  } catch (const std::exception& error) {
    insight.error = policy::TorchError("look into the policy", error).message;
  }
  return insight;
}

}  // namespace etude::serve
