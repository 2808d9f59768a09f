// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/worth.h"

#include <sstream>

#include "services/core/check.h"
#include "trainer/policy/names.h"

namespace etude::policy {
namespace {

using torch::Tensor;

std::vector<std::string> SpokenWords(const std::string& sentence) {
  std::istringstream stream(sentence);
  std::vector<std::string> words;
  for (std::string word; words.size() < kMostWords && stream >> word;) words.push_back(word);
  return words;
}

// Of the words that SpokenWords has, all but one; and what follows them.
std::string WithoutWord(const std::string& sentence, std::size_t left_out) {
  std::istringstream stream(sentence);
  std::string rest;
  std::size_t i = 0;
  for (std::string word; stream >> word; ++i)
    if (i != left_out) rest += (rest.empty() ? "" : " ") + word;
  return rest;
}

// How far the first plan and each of the others are apart, m. @param plans  (N, kWaypoints, 3)
std::vector<double> MovesOf(const Tensor& plans) {
  const Tensor moves = (plans.narrow(0, 1, plans.size(0) - 1) - plans.narrow(0, 0, 1))
                           .norm(2, -1)
                           .mean(-1)
                           .to(torch::kCPU, torch::kFloat64)
                           .contiguous();
  if (!torch::isfinite(moves).all().item<bool>()) return {};
  return {moves.data_ptr<double>(), moves.data_ptr<double>() + moves.numel()};
}

// (B, S', kWaypoints, 3) m; undefined: no module decodes a trajectory.
Tensor PlansOf(const PolicyConfig& config, const Outputs& outputs) {
  const ModuleConfig* module = DrivingModule(config);
  return module ? outputs.at(module->name).decoded.at("trajectory").narrow(-1, 0, 3) : Tensor();
}

// The picture is encoded once for all sentences.
std::vector<double> WithoutEachWord(Policy& policy, Inputs inputs, std::size_t words) {
  const std::string sentence = inputs.sentences.at(0);
  for (std::size_t i = 0; i < words; ++i) inputs.sentences.push_back(WithoutWord(sentence, i));
  const auto count = static_cast<std::int64_t>(inputs.sentences.size());
  inputs.sentence_index = torch::arange(count, torch::kInt64).view({1, count});
  const Tensor plans = PlansOf(policy.config(), policy.Forward(inputs));
  // none that depends on the sentence has but one
  return plans.defined() ? MovesOf(plans.select(0, 0).expand({count, -1, -1})) : std::vector<double>{};
}

std::vector<double> WithEachJointAtItsMean(Policy& policy, Inputs inputs) {
  const std::int64_t count = policy.joints() + 1;
  const Tensor mean = policy.named_buffers()["normalization_joint_mean"].to(inputs.joints.device());
  inputs.joints = inputs.joints.repeat({count, 1});
  for (std::int64_t j = 0; j + 1 < count; ++j) inputs.joints[j + 1][j] = mean[j];
  inputs.images = inputs.images.repeat({count, 1, 1, 1}).contiguous(torch::MemoryFormat::ChannelsLast);
  inputs.crop_origin = inputs.crop_origin.repeat({count, 1});
  if (inputs.viewpoint.defined()) inputs.viewpoint = inputs.viewpoint.repeat({count, 1});
  inputs.sentence_index = torch::zeros({count, 1}, torch::kInt64);
  const Tensor plans = PlansOf(policy.config(), policy.Forward(inputs));
  return plans.defined() ? MovesOf(plans.select(1, 0)) : std::vector<double>{};
}

}  // namespace

Worth WorthOf(Policy& policy, const Inputs& inputs) {
  ETUDE_CHECK(inputs.joints.size(0) == 1 && inputs.sentences.size() == 1, "{} samples of {} sentences",
              inputs.joints.size(0), inputs.sentences.size());
  const auto words = SpokenWords(inputs.sentences[0]);
  Worth worth;
  if (!words.empty()) {
    const auto moves = WithoutEachWord(policy, inputs, words.size());
    for (std::size_t i = 0; i < moves.size(); ++i) worth.words.push_back({words[i], moves[i]});
  }
  worth.joints = WithEachJointAtItsMean(policy, inputs);
  return worth;
}

}  // namespace etude::policy
