// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/torchscript.h"

#include <fmt/format.h>
#include <torch/csrc/jit/frontend/tracer.h>
#include <torch/script.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <limits>
#include <set>
#include <sstream>

#include "services/episode/action.h"
#include "services/episode/viewpoint.h"
#include "services/language/tokenizer.h"
#include "trainer/checkpoint/readiness.h"
#include "trainer/policy/answer.h"
#include "trainer/policy/crop.h"
#include "trainer/policy/device.h"
#include "trainer/policy/language_encoder.h"
#include "trainer/policy/names.h"
#include "trainer/policy/torch_error.h"

namespace etude::checkpoint {
namespace {

using torch::Tensor;

constexpr double kTolerance = 1e-5;  // m
// of rotations and gripper, which an untrained policy says in any size; convolutions round by how they are summed
constexpr double kOtherTolerance = 1e-4;
constexpr const char* kSentences[] = {"pick up the red cube", "push it", "please put the green bottle down next to me"};

struct Question {
  Tensor crop, joints, token_ids;
  Tensor viewpoint;  // of a policy that reads its camera; else undefined

  torch::jit::Stack stack() const {
    torch::jit::Stack inputs{crop, joints, token_ids};
    if (viewpoint.defined()) inputs.emplace_back(viewpoint);
    return inputs;
  }
};

// (1, kViewpointSize): about a metre above the table, looking down
Tensor RandomViewpoint(torch::Generator draw) {
  const Viewpoint above = ViewpointOf(200, 200, 112, 112, {{0, 0, 1}, Eigen::Quaterniond::Identity()});
  const Tensor viewpoint = torch::tensor(std::vector<float>(above.begin(), above.end())).view({1, kViewpointSize});
  return viewpoint * (0.9 + 0.2 * torch::rand({1, kViewpointSize}, draw, torch::kFloat32));
}

Question RandomQuestion(const policy::PolicyConfig& config, const language::Senses* senses, int joints,
                        const char* sentence, torch::Generator draw) {
  const codec::Region crop = policy::CropOf(config.image);
  return {torch::randint(256, {1, 3, crop.height, crop.width}, draw, torch::kUInt8),
          torch::rand({1, joints}, draw, torch::kFloat32) * 2 - 1, TokenIds(sentence, config.language.buckets, senses),
          policy::ReadsCamera(config) ? RandomViewpoint(draw) : Tensor()};
}

policy::Inputs InputsOf(const policy::PolicyConfig& config, const Question& question) {
  const codec::Region crop = policy::CropOf(config.image);
  policy::Inputs inputs;
  inputs.images = question.crop;
  inputs.crop_origin = torch::tensor({static_cast<float>(crop.u), static_cast<float>(crop.v)}).view({1, 2});
  inputs.viewpoint = question.viewpoint;
  inputs.joints = question.joints;
  inputs.token_ids = question.token_ids;
  inputs.sentence_index = torch::zeros({1, 1}, torch::kInt64);
  return inputs;
}

// "modules.CTRL.decoder.from.position:TAR3D" as a name that TorchScript takes, different from those before
std::string AttributeName(const std::string& name, std::set<std::string>& taken) {
  std::string plain = name;
  std::replace_if(
      plain.begin(), plain.end(), [](char c) { return std::isalnum(static_cast<unsigned char>(c)) == 0; }, '_');
  std::string free = plain;
  for (int n = 2; !taken.insert(free).second; ++n) free = fmt::format("{}_{}", plain, n);
  return free;
}

// The weights are the module's parameters, by the tensors that the policy computes with.
void RegisterWeights(policy::Policy& policy, torch::jit::Module& module) {
  std::set<std::string> taken{"training"};
  for (const auto& parameter : policy.named_parameters()) {
    parameter.value().requires_grad_(false);
    module.register_parameter(AttributeName(parameter.key(), taken), parameter.value(), /*is_buffer=*/false);
  }
  for (const auto& buffer : policy.named_buffers())
    module.register_buffer(AttributeName(buffer.key(), taken), buffer.value());
}

// One evaluation, written down operation by operation.
torch::jit::Module Trace(policy::Policy& policy, const Question& example) {
  torch::jit::Module module("__torch__.EtudePolicy");
  module.register_attribute("training", c10::BoolType::get(), false);
  RegisterWeights(policy, module);
  const auto evaluate = [&](torch::jit::Stack inputs) {
    const Question question{inputs[0].toTensor(), inputs[1].toTensor(), inputs[2].toTensor(),
                            inputs.size() > 3 ? inputs[3].toTensor() : Tensor()};
    const auto outputs = policy.Forward(InputsOf(policy.config(), question));
    return torch::jit::Stack{policy::WaypointTensor(policy.config(), outputs).contiguous()};
  };
  const auto [state, said] = torch::jit::tracer::trace(
      example.stack(), evaluate, [](const torch::autograd::Variable&) { return std::string(); }, /*strict=*/true,
      /*force_outplace=*/false, &module, InputNames(policy.config()));
  const c10::QualifiedName name(*module.type()->name(), "forward");
  module.type()->addMethod(module._ivalue()->compilation_unit()->create_function(name, state->graph));
  return module;
}

OrderedJson Facts(const Metadata& metadata) {
  OrderedJson facts{{"format", "etude-torchscript-1"},
                    {"run", metadata.run},
                    {"step", metadata.step},
                    {"policy", metadata.policy.name},
                    {"robot", metadata.embodiment.robot},
                    {"joints", metadata.embodiment.joints},
                    {"picture", OrderedJson::array({metadata.embodiment.width, metadata.embodiment.height})},
                    {"crop", metadata.policy.image.crop},
                    {"inputs", InputNames(metadata.policy)},
                    {"token_buckets", metadata.policy.language.buckets},
                    {"waypoints", kWaypoints},
                    {"waypoint", kWaypointNames},
                    {"horizon_steps", kHorizonSteps},
                    {"control_rate_hz", kControlRate}};
  if (metadata.policy.language.senses) facts["token_senses"] = metadata.policy.language.sha256;
  return facts;
}

// The largest difference between what the file and the policy say, m; of rotations and gripper as it weighs.
double Disagreement(const std::string& bytes, policy::Policy& policy, const language::Senses* senses) {
  std::istringstream stream(bytes);
  torch::jit::Module module = torch::jit::load(stream);
  auto draw = at::detail::createCPUGenerator(1);
  double most = 0;
  for (const char* sentence : kSentences) {
    const Question question = RandomQuestion(policy.config(), senses, policy.joints(), sentence, draw);
    const Tensor said = module.forward(question.stack()).toTensor();
    policy::Inputs inputs = InputsOf(policy.config(), question);
    inputs.token_ids = Tensor();
    inputs.sentences = {sentence};
    const Tensor wanted = policy::WaypointTensor(policy.config(), policy.Forward(inputs));
    const Tensor apart = (said - wanted).abs().view({-1, kWaypointSize});
    const double place = apart.narrow(1, 0, 3).max().item<double>();
    const double rest = apart.narrow(1, 3, kWaypointSize - 3).max().item<double>();
    // a comparison with what is no number is false
    if (!std::isfinite(place + rest)) return std::numeric_limits<double>::infinity();
    most = std::max({most, place, rest * (kTolerance / kOtherTolerance)});
  }
  return most;
}

Result<std::string> Write(policy::Policy& policy, const Metadata& metadata) {
  const torch::NoGradGuard no_grad;
  // the file computes with torch's operations: so must the policy that it is compared with, since our kernels sum in
  // another order, which a trained policy shows by a tenth of a millimetre
  const policy::AtenOnly like_the_file;
  ETUDE_ASSIGN_OR_RETURN(const auto senses, policy::OpenSenses(policy.config().language));
  auto draw = at::detail::createCPUGenerator(0);
  const auto question = RandomQuestion(policy.config(), senses.get(), policy.joints(), kSentences[0], draw);
  const auto module = Trace(policy, question);
  std::ostringstream stream;
  module.save(stream, {{kTorchScriptFacts, Facts(metadata).dump(1)}});
  std::string bytes = std::move(stream).str();
  const double difference = Disagreement(bytes, policy, senses.get());
  if (!(difference <= kTolerance))
    return Fail(Code::kInternal, fmt::format("as TorchScript the policy says something else (by {}, more than {})",
                                             difference, kTolerance));
  return bytes;
}

}  // namespace

std::vector<std::string> InputNames(const policy::PolicyConfig& policy) {
  std::vector<std::string> names{"crop", "joints", "token_ids"};
  if (policy::ReadsCamera(policy)) names.emplace_back("viewpoint");
  return names;
}

Tensor TokenIds(const std::string& sentence, int buckets, const language::Senses* senses) {
  language::TokenizerConfig tokenizer;
  tokenizer.buckets = buckets;
  const auto words = language::Tokenize(sentence, tokenizer, senses);
  std::size_t features = 1;
  for (const auto& word : words) features = std::max(features, word.size());
  Tensor ids =
      torch::full({static_cast<std::int64_t>(words.size()), static_cast<std::int64_t>(features)}, -1, torch::kInt64);
  for (std::size_t w = 0; w < words.size(); ++w)
    for (std::size_t f = 0; f < words[w].size(); ++f)
      ids[static_cast<std::int64_t>(w)][static_cast<std::int64_t>(f)] = words[w][f];
  return ids;
}

Result<std::string> ToTorchScript(const Checkpoint& checkpoint) {
  const auto& metadata = checkpoint.metadata;
  const auto context = [&](const std::string& what) {
    return fmt::format("export the checkpoint of run '{}', step {}, as TorchScript: {}", metadata.run, metadata.step,
                       what);
  };
  if (!metadata.policy.language.clip_folder().empty())
    return Fail(Code::kInvalidArgument,
                context("its language is clip's text encoder, which is not in the checkpoint; a policy with its own "
                        "language encoder (policy.language=conv) can be exported"));
  const auto& modules = metadata.policy.modules;
  if (std::none_of(modules.begin(), modules.end(),
                   [](const auto& module) { return module.decoder.quantity == "trajectory"; }))
    return Fail(Code::kInvalidArgument, context("none of its modules decodes a trajectory"));
  if (Status trained = CheckTrained(metadata); !trained)
    return Fail(Code::kInvalidArgument, context(trained.error().message));
  Checkpoint exact = checkpoint;
  exact.metadata.policy.precision = "float32";
  ETUDE_ASSIGN_OR_RETURN(const auto policy, BuildPolicy(exact));
  try {
    return Write(*policy, metadata);
  } catch (const std::exception& error) {  // of torch
    return Fail(policy::TorchError(context("torch"), error));
  }
}

}  // namespace etude::checkpoint
