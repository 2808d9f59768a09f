// SPDX-License-Identifier: Apache-2.0
// Tests the policies of trainer/experiments/policies: each module that has parameters is trained by what it is for.
#include <algorithm>
#include <set>

#include "services/episode/viewpoint.h"
#include "services/spec/task_name.h"
#include "tests/support/matchers.h"
#include "tests/trainer/policy/fixtures.h"
#include "trainer/policy/loss.h"
#include "trainer/policy/names.h"
#include "trainer/policy/parts.h"
#include "trainer/policy/policy_file.h"

namespace etude::policy {
namespace gradient_test {

constexpr int kBatch = 3, kSentences = 4;  // odd: gradients that are cut off do not cancel each other

/// The graph of a file with a small image encoder, whose size no gradient's way depends on.
PolicyConfig ReadSmall(const std::string& name) {
  const auto map = ReadPolicyMap(name, {"trainer/experiments/policies"});
  EXPECT_THAT(map, IsOk());
  auto config = FromJson<PolicyConfig>(*map, name);
  EXPECT_THAT(config, IsOk());
  config->image.layers = TinyConfig().image.layers;
  config->image.crop = {40, 30, 48, 32};
  config->precision = "float32";
  config->tasks = BaseTasks();
  return *config;
}

/// All labels that the policy asks for, in view.
Labels LabelsOf(const PolicyConfig& config) {
  Labels labels;
  for (const data::LabelColumn& column : LabelColumnsOf(config)) {
    std::vector<std::int64_t> shape{kBatch, column.entity.per_sentence() ? kSentences : 1}, valid = shape;
    if (column.entity.is_set()) shape.push_back(data::kMaxOthers), valid.push_back(data::kMaxOthers);
    for (const auto size : column.rule->label_shape()) shape.push_back(size);
    if (column.rule->label_parts() > 1) valid.push_back(column.rule->label_parts());
    torch::Tensor& value = labels[column.name] = 0.2 * torch::randn(shape);
    labels[column.name + ".valid"] = torch::ones(valid, torch::kBool);
    if (column.name.ends_with(".pixel")) value = torch::tensor({64.0F, 46.0F}) + 20 * torch::rand(shape) - 10;
    if (column.name.ends_with(".class"))
      value = torch::randint(static_cast<int>(config.objects.size()), shape).to(torch::kFloat32);
    if (column.name.ends_with(".task"))
      value = torch::randint(static_cast<int>(config.tasks.size()), shape).to(torch::kFloat32);
    if (column.name.ends_with(".trajectory"))
      value.select(-1, kWaypointSize - 1).copy_(torch::rand({kBatch, 1, kWaypoints}).round());
  }
  return labels;
}

Inputs InputsOf(const PolicyConfig& config) {
  Inputs inputs = MakeInputs(config, kBatch, kSentences);
  const Viewpoint above = ViewpointOf(200, 200, 112, 112, {{0, 0, 1}, Eigen::Quaterniond::Identity()});
  inputs.viewpoint = torch::tensor(std::vector<float>(above.begin(), above.end())).expand({kBatch, kViewpointSize});
  return inputs;
}

/// The names of a policy's parameters that a step of the stage `level` changes; those of frozen parts have none.
std::set<std::string> Trained(Policy& policy, const Inputs& inputs, const Labels& labels, int level) {
  policy.zero_grad();
  policy.Loss(inputs, policy.Forward(inputs, level), labels, level).total.backward();
  std::set<std::string> trained;
  for (const auto& item : policy.named_parameters())
    if (item.value().grad().defined() && item.value().grad().abs().max().item<float>() > 0) trained.insert(item.key());
  return trained;
}

// what begins at zero passes nothing on in its first step
void LeaveZero(Policy& policy) {
  const torch::NoGradGuard no_grad;
  for (auto& item : policy.named_parameters())
    if (item.value().abs().max().item<float>() == 0) item.value().copy_(0.05 * torch::randn_like(item.value()));
}

// A module with one key looks there whatever its query is: what the query is made of does nothing.
bool IsIdle(const Policy& policy, const ModuleConfig& module, const std::string& parameter) {
  const auto keys = policy.KeysOf(module.name);
  if (keys.size() != 1 || keys[0] == "image") return false;
  if (parameter == "segments." + module.name) return true;  // of its query
  const std::string own = parameter.substr(std::string("modules.").size() + module.name.size() + 1);
  return own == "register" || own.starts_with("attention.query.") || own.starts_with("query_head.") ||
         own == "attention.key_weight";
}

class PolicyFiles : public testing::TestWithParam<const char*> {};

TEST_P(PolicyFiles, TrainEveryModule) {
  const PolicyConfig config = ReadSmall(GetParam());
  const auto policy = MakePolicy(config, 2);
  LeaveZero(*policy);
  torch::manual_seed(6);
  const Inputs inputs = InputsOf(config);
  const Labels labels = LabelsOf(config);
  const auto last = Trained(*policy, inputs, labels, policy->levels());
  for (const ModuleConfig& module : config.modules) {
    const auto parameters = policy->ParametersOf(module.name);
    if (parameters.empty()) continue;  // it asks with another module's register, with its level's attention
    const auto own = Trained(*policy, inputs, labels, module.level);
    EXPECT_TRUE(std::ranges::any_of(parameters, [&](const auto& name) { return own.contains(name); }))
        << module.name << " learns nothing in its own stage";
    for (const auto& name : parameters)
      EXPECT_TRUE(last.contains(name) || IsIdle(*policy, module, name)) << name << " is never trained";
  }
  for (const char* encoder : {"image", "language", "joints"})
    EXPECT_TRUE(std::ranges::any_of(policy->ParametersOf(encoder), [&](const auto& name) {
      return last.contains(name);
    })) << encoder;
}

// Several sentences are asked of a picture: a graph may say the hand anew for each of them, or the target for all.
TEST_P(PolicyFiles, AreMeasuredInEveryModule) {
  const PolicyConfig config = ReadSmall(GetParam());
  const auto policy = MakePolicy(config, 2);
  torch::manual_seed(6);
  const torch::NoGradGuard no_grad;
  const auto outputs = policy->Forward(InputsOf(config), policy->levels());
  const Labels labels = LabelsOf(config);
  for (const ModuleConfig& module : config.modules) {
    const Quantity* quantity = QuantityOf(module);
    if (quantity == nullptr) continue;
    const Target target = FindTarget(labels, module.decoder.label());
    ASSERT_TRUE(target.value.defined()) << module.name;
    const auto metrics = quantity->Measure(HeadOf(config, module), outputs.at(module.name), target);
    EXPECT_FALSE(metrics.empty()) << module.name;
    for (const Metric& metric : metrics) {
      EXPECT_NO_THROW(metric.valid.expand(metric.values.sizes())) << module.name << "." << metric.name;
      EXPECT_TRUE(metric.values.to(torch::kFloat64).isfinite().all().item<bool>()) << module.name << metric.name;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Compact, PolicyFiles,
                         testing::Values("compact/base", "compact/obstacle", "compact/multi_obstacle",
                                         "compact/relational", "compact/moving_camera"));
INSTANTIATE_TEST_SUITE_P(Paper, PolicyFiles,
                         testing::Values("paper/base", "paper/faithful", "paper/obstacle", "paper/multi_obstacle",
                                         "paper/relational"));

// Put on top of a frozen base, what is new learns, and nothing else moves.
TEST(AddedModules, LearnOnAFrozenBase) {
  const PolicyConfig base = ReadSmall("compact/base");
  std::vector<std::string> frozen{"image", "language", "joints"};
  for (const ModuleConfig& module : base.modules)
    if (module.name != "CTRL") frozen.push_back(module.name);
  for (const char* name : {"compact/obstacle", "compact/multi_obstacle"}) {
    const PolicyConfig config = ReadSmall(name);
    const auto policy = MakePolicy(config, 3);
    LeaveZero(*policy);
    policy->Freeze(frozen);
    torch::manual_seed(7);
    const auto trained = Trained(*policy, InputsOf(config), LabelsOf(config), policy->levels());
    for (const std::string& part : PartsOf(config)) {
      const bool is_frozen = std::ranges::find(frozen, part) != frozen.end();
      for (const auto& parameter : policy->ParametersOf(part))
        EXPECT_EQ(trained.contains(parameter), !is_frozen) << name << ": " << parameter;
    }
  }
}

}  // namespace gradient_test
}  // namespace etude::policy
