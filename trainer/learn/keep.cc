// SPDX-License-Identifier: Apache-2.0
#include "trainer/learn/keep.h"

#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <optional>
#include <utility>

#include "services/core/crash_point.h"
#include "services/core/disk_wait.h"
#include "services/core/log.h"
#include "services/core/rng.h"
#include "trainer/data/batch.h"
#include "trainer/learn/build_data.h"
#include "trainer/learn/tensors.h"
#include "trainer/policy/architecture.h"
#include "trainer/policy/layers.h"
#include "trainer/policy/parts.h"
#include "trainer/policy/torch_error.h"

namespace etude::learn {
namespace {

// pictures that the statistics of averaged weights are measured on: batches of training, augmented alike
constexpr int kStatisticBatches = 4;

bool IsRunningStatistic(const std::string& name) {
  return name.ends_with("running_mean") || name.ends_with("running_var");
}

// those of frozen parts stay as they are
std::map<std::string, torch::Tensor> RunningStatistics(policy::Policy& policy) {
  std::map<std::string, torch::Tensor> found;
  for (const auto& item : policy.named_buffers())
    if (IsRunningStatistic(item.key()) && !policy.frozen().contains(policy::PartOfTensor(item.key())))
      found[item.key()] = item.value();
  return found;
}

checkpoint::Metadata MetadataOf(const TrainingRun& run, bool best) {
  const auto snapshot = run.dataset->snapshot();
  checkpoint::Metadata metadata;
  metadata.step = run.step;
  metadata.stage = run.scheduler->stage();
  metadata.stages = run.scheduler->stages();
  metadata.stage_name = run.scheduler->StageName();
  metadata.best = best;
  metadata.train_episodes = snapshot->episode_count(data::Split::kTrain);
  metadata.dataset = snapshot->Fingerprint();
  metadata.words = run.words;
  metadata.embodiment = run.embodiment;
  metadata.modules = run.modules;
  metadata.metrics = run.evaluation.metrics;
  metadata.policy = run.config.policy;
  metadata.train_config = ToJson(run.config);
  return metadata;
}

RunState StateOf(const TrainingRun& run) {
  RunState state;
  state.policy = run.replicas->front().StateTensors();
  state.optimizer = run.optimizer->StateTensors();
  state.rng = at::detail::getDefaultCPUGenerator().get_state();
  state.step = run.step;
  state.elapsed_s = run.Elapsed();
  state.limit = run.limit.Save();
  state.curriculum = run.scheduler->Save();
  state.architecture = policy::ArchitectureHash(run.config.policy);
  state.embodiment = run.embodiment;
  state.modules = run.modules;
  state.words = run.words;
  for (const auto& entry : run.validation->episodes()) state.validation.push_back(entry->number());
  state.datasets = DatasetsOf(*run.dataset);
  if (run.options.device.is_cpu())
    state.replicas = run.replicas->size() * (run.options.ranks ? run.options.ranks->size() : 1);
  state.best_stage = run.best_stage;
  state.best_score = std::isfinite(run.best_score) ? run.best_score : 0;
  state.checkpoint_step = run.checkpoint_step;
  state.metrics = run.evaluation.metrics;
  return state;
}

}  // namespace

Status WriteOrWait(TrainingRun& run, const std::string& what, const std::function<Status()>& write) {
  constexpr std::chrono::seconds kPause{1};
  const double waited_before = run.waited;
  std::optional<Stopwatch> waiting;
  // counted before each try: the state that is written says how long was trained
  const auto counted_write = [&] {
    if (waiting) run.waited = waited_before + waiting->Seconds();
    return write();
  };
  return WriteWhenThereIsRoom(what, counted_write, kPause, [&] {
    if (!waiting) waiting.emplace();
    if (run.options.source) (void)run.options.source();  // training asks it for its words
    if (run.options.ranks) run.options.ranks->KeepWaiting();
  });
}

Status KeepConfig(TrainingRun& run) {
  OrderedJson config = ToJson(run.config);
  // for people: reading it back passes it over, --data says it
  for (std::size_t folder = 0; folder < run.dataset->folders() && run.dataset->folders() > 1; ++folder)
    config["datasets"].push_back(std::filesystem::absolute(run.dataset->path(folder)).lexically_normal().string());
  return WriteOrWait(run, "config.yaml",
                     [&] { return WriteFileAtomically(run.options.out / "config.yaml", ToYaml(config)); });
}

namespace {

Status KeepState(TrainingRun& run) {
  return WriteOrWait(run, "the state that --resume needs",
                     [&] { return SaveRunState(run.options.out / kRunStateFile, StateOf(run)); });
}

}  // namespace

Status KeepNow(TrainingRun& run, const Hooks& hooks, bool best) {
  const std::string what = fmt::format("checkpoint of step {}", run.step);
  Status sent;
  try {
    if (hooks.on_checkpoint) {
      const AveragedWeights averaged(run);
      const checkpoint::Checkpoint made{MetadataOf(run, best), run.replicas->front().StateTensors()};
      sent = WriteOrWait(run, "the " + what, [&] { return hooks.on_checkpoint(made); });
    }
  } catch (const c10::Error& error) {
    // averaged weights need a few batches more; what was learned needs none
    ETUDE_RETURN_IF_ERROR(KeepState(run));
    return Fail(policy::TorchError(what, error));
  }
  if (!sent) {  // nor does it need the room of a checkpoint
    ETUDE_RETURN_IF_ERROR(KeepState(run));
    Error error = sent.error().Wrap(what);
    error.message += "; what was learned is kept: --resume goes on";
    return Fail(std::move(error));
  }
  CrashPoint("trainer.checkpoint_kept", run.step);
  run.checkpoint_step = run.step;
  return KeepState(run);
}

AveragedWeights::AveragedWeights(TrainingRun& run) : run_(run) {
  if (!run_.optimizer->averages()) return;
  const torch::NoGradGuard no_grad;
  for (const auto& [name, buffer] : RunningStatistics(run_.replicas->front())) own_[name] = buffer.clone();
  run_.optimizer->ExchangeAverage();
  if (own_.empty()) return;
  try {
    Measure();
  } catch (...) {  // memory that ran out: no destructor comes after it
    GiveBack();
    throw;
  }
}

AveragedWeights::~AveragedWeights() { GiveBack(); }

void AveragedWeights::GiveBack() {
  if (!run_.optimizer->averages()) return;
  const torch::NoGradGuard no_grad;
  run_.optimizer->ExchangeAverage();
  for (auto& [name, buffer] : RunningStatistics(run_.replicas->front())) buffer.copy_(own_.at(name));
}

// A running statistic that begins at 0 is momentum times the batch's after one pass: the mean over batches is had
// without changing how the network normalises.
void AveragedWeights::Measure() {
  const torch::NoGradGuard no_grad;
  policy::Policy& policy = run_.replicas->front();
  auto buffers = RunningStatistics(policy);
  std::map<std::string, torch::Tensor> sums;
  for (const auto& [name, buffer] : buffers) sums[name] = torch::zeros_like(buffer);
  const auto snapshot = run_.dataset->snapshot();
  const std::uint64_t seed = MixSeed({run_.config.seed}, "statistics of averaged weights");
  data::Batch batch;
  data::FrameScratch scratch;
  int measured = 0;
  for (int i = 0; i < kStatisticBatches; ++i) {
    const std::uint64_t number = run_.step * kStatisticBatches + static_cast<std::uint64_t>(i);
    const auto& drawn = run_.config.data;
    auto samples = data::DrawBatch(*snapshot, data::Split::kTrain, seed, number, drawn.batch, 0, drawn.rest);
    if (const Status made =
            data::MakeReadable(*run_.maker, *snapshot, number, data::Augment::kYes, samples, scratch, batch);
        !made) {
      Log().warn("statistics of averaged weights: a batch is left out: {}", made.error().message);
      continue;
    }
    ++measured;
    for (auto& [name, buffer] : buffers) buffer.zero_();
    const Part part = PartOf(batch, 0, batch.size, policy.device());
    (void)policy.Forward(part.inputs, run_.scheduler->level());
    for (const auto& [name, buffer] : buffers) sums[name] += buffer;
  }
  for (auto& [name, buffer] : buffers) {
    // nothing looked at the picture: what was there stays
    const bool used = sums[name].abs().sum().item<double>() > 0;
    buffer.copy_(used ? sums[name] / (policy::kNormMomentum * measured) : own_.at(name));
  }
}

}  // namespace etude::learn
