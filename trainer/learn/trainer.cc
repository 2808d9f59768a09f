// SPDX-License-Identifier: Apache-2.0
#include "trainer/learn/trainer.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "services/core/log.h"
#include "services/core/rng.h"
#include "services/core/stop.h"
#include "trainer/learn/await_data.h"
#include "trainer/learn/build_data.h"
#include "trainer/learn/error_cells.h"
#include "trainer/learn/keep.h"
#include "trainer/learn/report.h"
#include "trainer/learn/run.h"
#include "trainer/policy/names.h"
#include "trainer/policy/torch_error.h"

namespace etude::learn {
namespace {

constexpr std::uint64_t kMetricsEvery = 50;  // steps

tl::unexpected<Error> NotFinite(const TrainingRun& run, const BatchLoss& loss, double gradient_norm) {
  std::string terms;
  for (const auto& [name, value] : loss.terms)
    if (!std::isfinite(value)) terms += " " + name;
  return Fail(Code::kInternal, fmt::format("the loss is not finite at step {} (loss {}, gradient norm {}, "
                                           "terms:{}); nothing was saved, "
                                           "the last good checkpoint is of step {}; try a lower optimizer.lr",
                                           run.step, loss.total, gradient_norm, terms.empty() ? " all finite" : terms,
                                           run.checkpoint_step));
}

// Terms are named as Policy::Loss does. A module that no label trains has its gradient from those that read it.
bool HadLoss(const policy::ModuleConfig& module, const BatchLoss& loss) {
  const auto nonzero = [&](const char* kind) {
    const auto term = loss.terms.find(module.name + kind);
    return term != loss.terms.end() && term->second != 0;
  };
  if (nonzero(".attention") || nonzero(".decode")) return true;
  const bool decodes = !module.decoder.quantity.empty() && module.decoder.weight > 0;
  return !decodes && !policy::IsToldWhereToLook(module);
}

}  // namespace

struct Trainer::Impl {
  std::unique_ptr<TrainingRun> owned;
  Hooks hooks;
  TrainingRun& run = *owned;
  Reporter reporter{run, hooks};
  std::unique_ptr<data::Loader> loader;
  bool over = false;  ///< rank 0 said so
  bool stopped = false;
  bool bad_weights = false;  ///< no numbers: they are not kept

  Status Loop();
  Status FollowRankZero();
  Status TrainStep();
  Status AfterStep();
  Status Measure();
  Status EvaluateNow(bool observe);
  void TellErrors(policy::Policy& policy);
  bool TakeBest();
  void CountModules(const BatchLoss& loss);
  Status KeepSteps();
  Status WatchSource();
  void TellRanks();
  // the others wait for the next step meanwhile
  std::function<void()> KeepRanksWaiting() {
    return [this] {
      if (run.options.ranks) run.options.ranks->KeepWaiting();
    };
  }
  Status SaveAndEnd(const Error& lost);
  Status Finish();
  Status NoteEnd(Status ended);
  Status NoteAdvance(const std::optional<curriculum::Advance>& advance);
  void LogUnmeasured();
};

Status Trainer::Impl::NoteAdvance(const std::optional<curriculum::Advance>& advance) {
  if (!advance) return {};
  Log().info("stage {} of {} ({}) at step {}: {}: {}", advance->to, run.scheduler->stages(), run.scheduler->StageName(),
             advance->step, ToString(advance->cause), advance->reason);
  const std::string name = run.scheduler->StageName();
  ETUDE_RETURN_IF_ERROR(WriteOrWait(run, "curriculum.jsonl", [&] { return run.log->WriteAdvance(*advance, name); }));
  return WriteOrWait(run, "metrics.jsonl", [&] { return run.log->WriteStage(*advance, name); });
}

// a module that was trained by this step: its level has been reached, nothing keeps its parameters, and it had a loss
void Trainer::Impl::CountModules(const BatchLoss& loss) {
  const auto& freeze = run.config.init.freeze;
  for (const auto& module : run.config.policy.modules)
    if (module.level <= run.scheduler->level() &&
        std::find(freeze.begin(), freeze.end(), module.name) == freeze.end() && HadLoss(module, loss))
      ++run.modules[module.name].trained_steps;
}

Status Trainer::Impl::TrainStep() {
  Ranks* ranks = run.options.ranks.get();
  StepOrder order{true, run.scheduler->level(), LearningRate(run.config.optimizer, run.step, run.Progress())};
  if (ranks) {
    ETUDE_ASSIGN_OR_RETURN(order, ranks->Agree(order));
  }
  if ((over = !order.go)) return {};
  Stopwatch wait;
  ETUDE_ASSIGN_OR_RETURN(auto batch, loader->Next());
  const double wait_s = wait.Seconds();
  if (!run.scheduler->RelabelledAt(order.level)) data::KeepDemonstrated(*batch);
  run.optimizer->ZeroGradients();
  ETUDE_ASSIGN_OR_RETURN(const BatchLoss loss, run.replicas->Backward(*batch, order.level));
  if (ranks) ETUDE_RETURN_IF_ERROR(ranks->Sum(run.optimizer->SumGradients()));
  const auto outcome = run.optimizer->Step(order.lr);
  if ((bad_weights = !std::isfinite(outcome.gradient_norm) || !std::isfinite(loss.total)))
    return NotFinite(run, loss, outcome.gradient_norm);
  run.optimizer->UpdateAverage(run.config.ema);
  loader->Recycle(std::move(batch));
  CountModules(loss);
  ++run.step;
  reporter.Add(loss, wait_s, outcome);
  return {};
}

// the best is judged by the last subtask in training; a later stage is always better
bool Trainer::Impl::TakeBest() {
  const int stage = run.scheduler->stage();
  double score = 0;
  int judged = 0;
  for (const auto& module : run.config.policy.modules) {
    if (module.level != run.scheduler->level() || !run.evaluation.errors.contains(module.name)) continue;
    score += run.evaluation.errors.at(module.name);
    ++judged;
  }
  const bool best = judged > 0 && std::isfinite(score) &&
                    (stage > run.best_stage || (stage == run.best_stage && score < run.best_score));
  if (!best) return false;
  run.best_stage = stage;
  run.best_score = score;
  return true;
}

void Trainer::Impl::LogUnmeasured() {
  if (!run.scheduler->NewlyUnmeasured()) return;
  for (const auto& module : run.scheduler->unmeasured())
    Log().warn(
        "stage {} ({}): module {} has no validation error, so that only the budget ends this stage (at {:.0f} % "
        "of the run): does the validation split have its label?",
        run.scheduler->stage(), run.scheduler->StageName(), module, 100 * run.scheduler->Budget());
}

// Of all validation episodes that there are by now: those of the first step, by which runs are compared, are too few to
// tell one object from another. Training goes on without it.
void Trainer::Impl::TellErrors(policy::Policy& policy) {
  const auto snapshot = run.dataset->snapshot();
  const auto samples =
      data::SpreadFrames(*snapshot, data::Split::kValid, MixSeed({run.config.seed}, "valid"), run.config.eval.frames);
  const auto cells = MeasureErrors(
      policy, {*run.maker, *snapshot, samples, run.scheduler->level(), run.config.data.batch, KeepRanksWaiting()});
  if (!cells) return Log().warn("cannot tell where validation errs: {}", cells.error().message);
  if (!cells->empty()) hooks.on_errors(*cells, run.step);
}

// The weights are good also where their validation cannot be computed: a GPU that others fill, or a mistake of ours.
Status Trainer::Impl::Measure() {
  const auto samples = data::SpreadFrames(*run.validation, data::Split::kValid, MixSeed({run.config.seed}, "valid"),
                                          run.config.eval.frames);
  auto& policy = run.replicas->front();
  try {
    const AveragedWeights averaged(run);
    ETUDE_ASSIGN_OR_RETURN(run.evaluation,
                           learn::Evaluate(policy, {*run.maker, *run.validation, samples, run.scheduler->level(),
                                                    run.config.data.batch, KeepRanksWaiting()}));
    const auto language = learn::EvaluateLanguage(policy, *run.grammar, run.dataset->tasks(), NounsOf(*run.dataset));
    run.evaluation.metrics.insert(language.begin(), language.end());
    if (hooks.on_errors) TellErrors(policy);
    return {};
  } catch (const c10::Error& error) {
    return Fail(policy::TorchError("validate", error));
  }
}

Status Trainer::Impl::EvaluateNow(bool observe) {
  ETUDE_RETURN_IF_ERROR(Measure());
  // before anything of it is kept: the state that a run is resumed from is the only one
  if ((bad_weights = !std::isfinite(run.evaluation.metrics["loss"])))
    return Fail(Code::kInternal,
                fmt::format("the validation loss is not finite at step {}; nothing was saved, the last good "
                            "checkpoint is of step {}; try a lower optimizer.lr",
                            run.step, run.checkpoint_step));
  run.evaluated_step = run.step;
  for (const auto& [module, error] : run.evaluation.errors)
    if (std::isfinite(error)) run.modules[module].error = error;
  ETUDE_RETURN_IF_ERROR(WriteOrWait(
      run, "metrics.jsonl", [&] { return run.log->Write("valid", run.step, run.Elapsed(), run.evaluation.metrics); }));
  const int stage = run.scheduler->stage(), best_stage = run.best_stage;
  const double best_score = run.best_score;
  const bool best = TakeBest();
  if (observe) {
    ETUDE_RETURN_IF_ERROR(NoteAdvance(run.scheduler->Observe(run.step, run.Progress(), run.evaluation.errors)));
    LogUnmeasured();
  }
  // before the last stage only channel `latest` matters
  if (!best || stage != run.scheduler->stages()) return {};
  const Status kept = KeepNow(run, hooks, true);
  if (!kept) {  // what was the best still is; the state that is kept at the end says so
    run.best_stage = best_stage;
    run.best_score = best_score;
  }
  return kept;
}

// minutes that have become steps stand in config.yaml from then on
Status Trainer::Impl::AfterStep() {
  const bool measured = run.limit.Observe(run.step, run.Elapsed(), run.scheduler->stage() == run.scheduler->stages());
  if (measured) {
    Log().info("{} minutes are {} steps, as fast as the last ones were; steps count from now on",
               run.limit.asked_minutes(), run.limit.steps());
    run.config.steps = run.limit.steps();
    run.config.minutes = 0;
  }
  if (run.step % kMetricsEvery == 0) ETUDE_RETURN_IF_ERROR(reporter.Flush());
  ETUDE_RETURN_IF_ERROR(NoteAdvance(run.scheduler->Tick(run.step, run.Progress())));
  if (run.step % static_cast<std::uint64_t>(run.config.eval.every_steps) == 0) {
    const int stage = run.scheduler->stage();
    ETUDE_RETURN_IF_ERROR(EvaluateNow(true));
    if (run.scheduler->stage() != stage && run.checkpoint_step != run.step)
      ETUDE_RETURN_IF_ERROR(KeepNow(run, hooks, false));
    reporter.Restart();
  }
  // the last one is kept behind its validation: Finish does both
  const bool due = run.step % static_cast<std::uint64_t>(run.config.checkpoint.every_steps) == 0 && run.Progress() < 1;
  if (due && run.checkpoint_step != run.step) ETUDE_RETURN_IF_ERROR(KeepNow(run, hooks, false));
  if (measured) ETUDE_RETURN_IF_ERROR(KeepSteps());
  return {};
}

// The state that knows the steps first: with the configuration alone, a run that goes on would count its minutes anew.
Status Trainer::Impl::KeepSteps() {
  ETUDE_RETURN_IF_ERROR(KeepNow(run, run.checkpoint_step == run.step ? Hooks{} : hooks, false));
  return KeepConfig(run);
}

// a source of data that died ends the run with its words, after everything is saved
Status Trainer::Impl::WatchSource() {
  if (!reporter.due()) return {};
  reporter.Report(false);
  const Status alive = run.options.source ? run.options.source() : Status();
  if (alive) return {};
  stopped = true;
  TellRanks();
  ETUDE_RETURN_IF_ERROR(Finish());
  return Fail(alive.error().Wrap(fmt::format("training stopped at step {} and can be resumed", run.step)));
}

// The run's last word in its files. What cannot be written any more changes nothing of how it ended.
Status Trainer::Impl::NoteEnd(Status ended) {
  if (run.options.ranks && !run.options.ranks->leads()) return ended;
  const End cause = !ended ? End::kFailed : stopped ? End::kStopped : End::kFinished;
  const std::string reason = ended ? std::string() : ended.error().message;
  if (const Status noted = run.log->WriteEnd(run.step, run.Elapsed(), cause, reason); !noted)
    Log().warn("{}", noted.error().message);
  return ended;
}

Status Trainer::Impl::Finish() {
  loader.reset();
  const Status told = reporter.Flush();  // where it cannot be written, what was learned is kept all the same
  const bool by_time = !stopped && run.limit.minutes() > 0;
  if (by_time) {
    run.limit.EndAt(run.step);
    run.config.steps = run.step;
    run.config.minutes = 0;
  }
  // a stop drains at once; the limit also measures what was reached, and keeps it where it cannot be measured
  const Status measured = !stopped && run.evaluated_step != run.step ? EvaluateNow(false) : Status();
  if (bad_weights) return measured;
  if (by_time) {
    ETUDE_RETURN_IF_ERROR(KeepSteps());
  } else if (run.checkpoint_step != run.step) {
    ETUDE_RETURN_IF_ERROR(KeepNow(run, hooks, false));
  }
  reporter.Report(!stopped);
  ETUDE_RETURN_IF_ERROR(measured);
  ETUDE_RETURN_IF_ERROR(told);
  Log().info("{} at step {} after {}; '{}'", stopped ? "stopped" : "finished", run.step, FormatDuration(run.Elapsed()),
             run.options.out.string());
  return run.log->Sync();
}

// That the run is over. One that does not hear it is gone; what this one has learned is saved all the same.
void Trainer::Impl::TellRanks() {
  if (!run.options.ranks) return;
  if (const auto told = run.options.ranks->Agree({.go = false}); !told) Log().warn("{}", told.error().message);
}

// The weights are those of the last step that was made (by all ranks): good ones, whether the others have gone or the
// data cannot be read.
Status Trainer::Impl::SaveAndEnd(const Error& lost) {
  if (run.options.ranks) run.options.ranks->Abandon();
  if (run.step == 0) return Fail(lost);
  stopped = true;
  ETUDE_RETURN_IF_ERROR(Finish());
  return Fail(lost.Wrap(fmt::format("training stopped at step {} and can be resumed", run.step)));
}

// What a rank does that does not lead: the same steps with the same orders, and nothing else. It goes on until rank 0
// says that the run is over: a stop request reaches all of them, and one that left before would be missed in a step.
Status Trainer::Impl::FollowRankZero() {
  loader = std::make_unique<data::Loader>(run.dataset, run.maker, run.config.data, run.config.seed, run.step);
  while (!over) ETUDE_RETURN_IF_ERROR(TrainStep());
  Log().info("rank {} of {}: finished at step {}", run.options.ranks->rank(), run.options.ranks->size(), run.step);
  return {};
}

Status Trainer::Impl::Loop() {
  std::unique_ptr<Follower> follower;
  if (run.options.follow) follower = std::make_unique<Follower>(run.dataset, run.config.data.refresh_s);
  if (run.options.ranks && !run.options.ranks->leads()) return FollowRankZero();
  run.config.steps = run.limit.steps();
  run.config.minutes = run.limit.minutes();
  ETUDE_RETURN_IF_ERROR(KeepConfig(run));
  if (hooks.has_checkpoint && !hooks.has_checkpoint(run.checkpoint_step)) run.checkpoint_step = 0;
  if (hooks.has_best && !hooks.has_best()) {
    run.best_stage = 0;
    run.best_score = std::numeric_limits<double>::infinity();
  }
  loader = std::make_unique<data::Loader>(run.dataset, run.maker, run.config.data, run.config.seed, run.step);
  run.watch.Restart();
  run.waited = 0;
  reporter.Restart();
  while (run.Progress() < 1 && !(stopped = StopRequested())) {
    Status made = TrainStep();
    if (made) made = AfterStep();
    if (!made && !bad_weights) return SaveAndEnd(made.error());
    ETUDE_RETURN_IF_ERROR(made);
    ETUDE_RETURN_IF_ERROR(WatchSource());
  }
  TellRanks();
  return Finish();
}

Trainer::Trainer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Trainer::~Trainer() = default;

Status RequireLimit(const TrainConfig& config) {
  if (config.steps > 0 || config.minutes > 0) return {};
  return Fail(Code::kInvalidArgument, "train: give --steps N or --minutes M (or steps:, minutes: in the config)");
}

Result<std::unique_ptr<Trainer>> Trainer::Create(const TrainConfig& config, std::shared_ptr<data::Dataset> dataset,
                                                 const RunOptions& options, const Hooks& hooks) {
  ETUDE_RETURN_IF_ERROR(config.Validate());
  ETUDE_RETURN_IF_ERROR(RequireLimit(config));
  try {
    ETUDE_ASSIGN_OR_RETURN(auto run, BuildRun(config, std::move(dataset), options));
    return std::unique_ptr<Trainer>(new Trainer(std::unique_ptr<Impl>(new Impl{std::move(run), hooks})));
  } catch (const c10::Error& error) {
    return Fail(policy::TorchError("build the policy", error));
  }
}

Status Trainer::Run() {
  return impl_->NoteEnd([this]() -> Status {
    try {
      return impl_->Loop();
    } catch (const c10::Error& error) {
      return Fail(policy::TorchError("train", error));
    }
  }());
}

}  // namespace etude::learn
