// SPDX-License-Identifier: Apache-2.0
#include "trainer/learn/begin.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <set>
#include <string>
#include <string_view>

#include "services/core/log.h"
#include "trainer/checkpoint/readiness.h"
#include "trainer/checkpoint/surgery.h"
#include "trainer/learn/build_data.h"
#include "trainer/policy/architecture.h"
#include "trainer/policy/parts.h"

namespace etude::learn {
namespace {

// Which parts come from where, in one line each that matters.
void LogSurgery(const checkpoint::Checkpoint& source, const checkpoint::Surgery& surgery, const InitConfig& init) {
  Log().info("begins with run {} step {} of '{}': copied {}; fresh {}; frozen {}", source.metadata.run,
             source.metadata.step, init.from, fmt::join(surgery.copied, ", "),
             surgery.fresh.empty() ? "nothing" : fmt::format("{}", fmt::join(surgery.fresh, ", ")),
             init.freeze.empty() ? "nothing" : fmt::format("{}", fmt::join(init.freeze, ", ")));
  for (const auto& [part, other] : surgery.alike)
    Log().info("{} begins like {} ({} tensors)", part, other.first, other.second);
  for (const auto& [module, inputs] : surgery.grown)
    Log().info("{} reads more than its original: {}", module, fmt::join(inputs, ", "));
  for (const auto& [attention, modules] : surgery.frozen_attention)
    Log().info("{} is frozen: {} learns with it as it is", attention, fmt::join(modules, ", "));
  for (const auto& [module, parts] : surgery.moved)
    Log().info("{} is frozen and reads {}, which learns: its answers move with it", module, fmt::join(parts, ", "));
  if (!surgery.differences.empty())
    Log().warn("it was trained for something else: {}", fmt::join(surgery.differences, "; "));
}

}  // namespace

Status BeginWithCheckpoint(TrainingRun& run, std::vector<std::shared_ptr<policy::Policy>>& policies) {
  const InitConfig& init = run.config.init;
  ETUDE_ASSIGN_OR_RETURN(const auto source, checkpoint::ReadFile(init.from));
  ETUDE_ASSIGN_OR_RETURN(const auto surgery,
                         checkpoint::Operate(source, {init.copy, init.fresh, init.freeze, init.like}, run.config.policy,
                                             policies.front()->StateTensors(), run.embodiment));
  for (auto& policy : policies) ETUDE_RETURN_IF_ERROR(policy->LoadStateTensors(surgery.tensors));
  const auto unsettled = checkpoint::Unsettled(run.config.policy, surgery);
  for (const auto& [module, record] : source.metadata.modules) {
    if (!surgery.copied.contains(module)) continue;
    run.modules[module] = record;
    if (unsettled.contains(module)) run.modules[module].error.reset();
  }
  if (surgery.copied.contains("language")) AddWords(source.metadata.words, run);
  run.scheduler->StartAt(checkpoint::FirstLevelToLearn(run.config.policy, surgery));
  LogSurgery(source, surgery, init);
  if (const std::string other = OtherRecipe(source.metadata, run.config); !other.empty())
    Log().warn(
        "it was trained by experiment '{0}' and goes on by '{1}' (optimizer, pictures, curriculum); --config {0} "
        "--set policy=checkpoint goes on by its own",
        other, run.config.name);
  return {};
}

std::string OtherRecipe(const checkpoint::Metadata& source, const TrainConfig& config) {
  const auto& trained = source.train_config;
  if (!trained.is_object() || !trained.contains("name") || !trained["name"].is_string()) return "";
  const auto name = trained["name"].get<std::string>();
  return name == config.name ? "" : name;
}

Status CheckNothingIsKept(const InitConfig& init) {
  if (init.freeze.empty()) return {};
  return Fail(Code::kInvalidArgument,
              fmt::format("init.freeze: {}: nothing was learned yet that could be kept; give --init FILE",
                          fmt::join(init.freeze, ", ")));
}

Result<std::optional<RunState>> StateToResume(const RunOptions& options) {
  if (!options.resume) return std::nullopt;
  ETUDE_ASSIGN_OR_RETURN(auto state, LoadRunState(options.out / kRunStateFile));
  return std::optional(std::move(state));
}

Status CheckFits(const RunState& state, const TrainingRun& run) {
  const std::string architecture = policy::ArchitectureHash(run.config.policy);
  if (state.architecture != architecture)
    return Fail(Code::kInvalidArgument, fmt::format("resume '{}': its policy has another architecture ({:.12} there, "
                                                    "{:.12} asked for); {}",
                                                    run.options.out.string(), state.architecture, architecture,
                                                    run.dataset->folders() > state.datasets.size()
                                                        ? "what is added behind may bring no objects or tasks that the "
                                                          "datasets before it do not have: train into another folder"
                                                        : "train into another folder, or leave policy.* as in its "
                                                          "config.yaml"));
  // more of them may come behind; those of before keep their place, by which their episodes are known
  const auto datasets = DatasetsOf(*run.dataset);
  const bool same = datasets.size() >= state.datasets.size() &&
                    std::equal(state.datasets.begin(), state.datasets.end(), datasets.begin());
  if (!same)
    return Fail(Code::kInvalidArgument,
                fmt::format("resume '{}': {} is not what it was trained on: {}; others may only be added behind",
                            run.options.out.string(), run.dataset->text(),
                            state.datasets.size() > 1 ? "its config.yaml lists those, which stay in the same order"
                                                      : "a dataset of another campaign file, which comes first"));
  const auto differences = checkpoint::Differences(run.embodiment, state.embodiment);
  if (differences.empty()) return {};
  return Fail(Code::kInvalidArgument,
              fmt::format("resume '{}': {} is not what the run was trained on ({}); train into another folder, or give "
                          "the data that fit",
                          run.options.out.string(), run.dataset->text(), fmt::join(differences, "; ")));
}

Status CheckFrozenLearned(const RunState& state, const TrainingRun& run) {
  const auto not_begun = checkpoint::NotBegun(run.config.policy, state.modules);
  std::vector<std::string> untrained;
  for (const auto& module : run.config.policy.modules)
    if (not_begun.contains(module.name) && std::ranges::count(run.config.init.freeze, module.name) > 0)
      untrained.push_back(module.name);
  if (untrained.empty()) return {};
  return Fail(
      Code::kInvalidArgument,
      fmt::format("init.freeze: {}: not trained yet: it would never learn; leave it out", fmt::join(untrained, ", ")));
}

Status RestoreState(const RunState& state, TrainingRun& run) {
  ETUDE_RETURN_IF_ERROR(run.optimizer->LoadStateTensors(state.optimizer));
  // an average that was switched off would be evaluated and kept, and never move again
  if (run.config.ema <= 0) run.optimizer->UpdateAverage(0);
  ETUDE_RETURN_IF_ERROR(run.scheduler->Restore(state.curriculum));
  ETUDE_RETURN_IF_ERROR(run.limit.Restore(state.limit));
  if (state.rng.defined()) {
    at::Generator generator = at::detail::getDefaultCPUGenerator();
    generator.set_state(state.rng);
  }
  run.modules = state.modules;
  AddWords(state.words, run);
  run.step = state.step;
  run.elapsed_before = state.elapsed_s;
  // a score on other episodes says nothing about the next one
  const bool same_validation = run.validation->episodes().size() == state.validation.size();
  run.best_stage = same_validation ? state.best_stage : 0;
  if (run.best_stage > 0) run.best_score = state.best_score;
  run.checkpoint_step = state.checkpoint_step;
  run.evaluation.metrics = state.metrics;
  return {};
}

void LogFrozen(const RunState& state, const TrainingRun& run) {
  const auto& freeze = run.config.init.freeze;
  Log().info("frozen: {}", fmt::join(freeze, ", "));
  std::set<std::string> raw;
  for (const auto& [name, tensor] : state.optimizer)
    if (constexpr std::string_view average = "average/"; name.starts_with(average))
      if (const auto part = policy::PartOfTensor(name.substr(average.size())); std::ranges::count(freeze, part) > 0)
        raw.insert(part);
  if (!raw.empty())
    Log().warn(
        "{} learned until step {} and stay as that left them, not as their average over the last steps, which "
        "checkpoints had: to keep that, begin a run with --init and the last checkpoint",
        fmt::join(raw, ", "), state.step);
}

}  // namespace etude::learn
