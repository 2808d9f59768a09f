// SPDX-License-Identifier: Apache-2.0
#include "trainer/learn/trainer.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <condition_variable>
#include <limits>
#include <set>
#include <thread>

#include "services/core/clock.h"
#include "services/core/log.h"
#include "services/core/rng.h"
#include "services/core/stop.h"
#include "services/episode/object_names.h"
#include "trainer/data/loader.h"
#include "trainer/data/statistics.h"
#include "trainer/learn/metrics_log.h"
#include "trainer/learn/optimizer.h"
#include "trainer/learn/replicas.h"
#include "trainer/learn/run_state.h"
#include "trainer/learn/tensors.h"

namespace etude::learn {
namespace {

constexpr double kProgressEvery = 1;         // s
constexpr double kLineEvery = 10;            // s
constexpr std::uint64_t kMetricsEvery = 50;  // steps

std::vector<curriculum::Subtask> Subtasks(const policy::PolicyConfig& config) {
  std::map<int, curriculum::Subtask> by_level;
  for (const auto& module : config.modules) {
    by_level[module.level].level = module.level;
    by_level[module.level].modules.push_back(module.name);
  }
  std::vector<curriculum::Subtask> subtasks;
  for (auto& [level, subtask] : by_level) subtasks.push_back(std::move(subtask));
  return subtasks;
}

// looks at a growing dataset now and then, until it is destroyed
class Follower {
 public:
  Follower(std::shared_ptr<data::Dataset> dataset, double every_s)
      : thread_([this, dataset = std::move(dataset), every_s] {
          std::unique_lock lock(mutex_);
          while (!wake_.wait_for(lock, std::chrono::duration<double>(every_s), [this] { return stop_; })) {
            const auto added = dataset->Refresh();
            if (!added) Log().warn("look for new episodes: {}", added.error().message);
          }
        }) {}
  ~Follower() {
    {
      const std::lock_guard lock(mutex_);
      stop_ = true;
    }
    wake_.notify_all();
    thread_.join();
  }

 private:
  std::mutex mutex_;
  std::condition_variable wake_;
  bool stop_ = false;
  std::thread thread_;
};

// a collector that is silent for this long brings nothing more
constexpr auto kCollectorPatience = std::chrono::seconds(60);

std::size_t PlannedTrainEpisodes(const CampaignSpec& spec) {
  std::size_t count = 0;
  for (std::uint64_t i = 0; i < spec.episodes; ++i) count += SplitOf(spec, i) == "train";
  return count;
}

// reads the dataset; with `follow` waits until there is enough to begin
Status AwaitData(data::Dataset& dataset, const TrainConfig& config, bool follow) {
  std::size_t reported = std::numeric_limits<std::size_t>::max();
  auto last_change = MonotonicClock::now();
  const std::size_t enough =
      follow ? std::min(static_cast<std::size_t>(config.data.min_episodes), PlannedTrainEpisodes(dataset.spec())) : 1;
  while (true) {
    ETUDE_ASSIGN_OR_RETURN([[maybe_unused]] const int added, dataset.Refresh());
    const auto snapshot = dataset.snapshot();
    const std::size_t train = snapshot->episode_count(data::Split::kTrain);
    const bool silent = MonotonicClock::now() - last_change > kCollectorPatience;
    const std::size_t least = silent ? 1 : enough;
    const bool frames =
        snapshot->frame_count(data::Split::kTrain) > 0 && snapshot->frame_count(data::Split::kValid) > 0;
    if (train >= least && frames) return {};
    if (!follow)
      return Fail(Code::kNotFound,
                  fmt::format("train on '{}': {} usable training and {} validation frames in {} episodes; "
                              "collect more, "
                              "or give --follow to wait for them",
                              dataset.path().string(), snapshot->frame_count(data::Split::kTrain),
                              snapshot->frame_count(data::Split::kValid), snapshot->episodes().size()));
    if (train != reported) Log().info("waiting for data: {} of {} training episodes", train, least);
    if (train != reported) last_change = MonotonicClock::now();
    reported = train;
    if (WaitForStop(std::chrono::milliseconds(500)))
      return Fail(Code::kUnavailable, "stopped while waiting for the first episodes");
  }
}

std::set<std::string> FrozenParameters(const policy::Policy& policy, const std::vector<std::string>& modules) {
  std::set<std::string> names;
  for (const auto& module : modules)
    for (auto& name : policy.ParametersOf(module)) names.insert(std::move(name));
  return names;
}

// The classes that the policy tells apart: as configured, unless the dataset has others.
void AdoptClasses(const std::vector<std::string>& objects, std::vector<std::string>& classes) {
  std::vector<std::string> found;
  for (const auto& object : objects) {
    const std::string its_class = ObjectNoun(object);
    if (std::find(found.begin(), found.end(), its_class) == found.end()) found.push_back(its_class);
  }
  const bool covered = std::all_of(found.begin(), found.end(), [&](const std::string& name) {
    return std::find(classes.begin(), classes.end(), name) != classes.end();
  });
  if (covered) return;
  Log().info("the policy's classes are the dataset's: {}", fmt::join(found, ", "));
  classes = std::move(found);
}

}  // namespace

struct Trainer::Impl {
  TrainConfig config;
  RunOptions options;
  Hooks hooks;
  std::shared_ptr<data::Dataset> dataset;
  std::shared_ptr<const language::Grammar> grammar;
  std::shared_ptr<const data::BatchMaker> maker;
  std::unique_ptr<Replicas> replicas;
  std::unique_ptr<Optimizer> optimizer;
  std::unique_ptr<curriculum::Scheduler> scheduler;
  std::unique_ptr<MetricsLog> log;
  std::unique_ptr<data::Loader> loader;

  int joints = 0;
  std::uint64_t step = 0;     // steps done
  double elapsed_before = 0;  // s, of earlier runs
  Stopwatch watch;
  int best_stage = 0;
  double best_score = std::numeric_limits<double>::infinity();
  std::uint64_t checkpoint_step = 0, evaluated_step = 0;
  Evaluation evaluation;

  // since the last line of metrics
  struct Window {
    double loss = 0, wait_s = 0, gradient_norm = 0;
    std::map<std::string, double> terms;
    int steps = 0;
    Stopwatch watch;
  } window;
  Progress last;
  Stopwatch since_progress, since_line;

  double Elapsed() const { return elapsed_before + watch.Seconds(); }
  double RunProgress() const {
    double progress = 0;
    if (config.steps > 0) progress = static_cast<double>(step) / static_cast<double>(config.steps);
    if (config.minutes > 0) progress = std::max(progress, Elapsed() / (60 * config.minutes));
    return std::min(1.0, progress);
  }

  Status Build();
  Status Resume(const RunState& state, std::vector<std::shared_ptr<policy::Policy>>& policies) const;
  Status Loop();
  Status TrainStep();
  Status AfterStep();
  Status EvaluateNow(bool observe);
  Status SaveNow(bool best);
  Status Finish(bool stopped);
  void Record(const BatchLoss& loss, double wait_s, double gradient_norm);
  Status FlushWindow();
  void Report(bool finished);
  void LogAdvance(const std::optional<curriculum::Advance>& advance);
};

Status Trainer::Impl::Build() {
  ETUDE_RETURN_IF_ERROR(MakeFolders(options.out));
  ETUDE_RETURN_IF_ERROR(AwaitData(*dataset, config, options.follow));
  const auto snapshot = dataset->snapshot();
  ETUDE_ASSIGN_OR_RETURN(const auto statistics, data::ComputeStatistics(*snapshot));
  joints = static_cast<int>(statistics.joint_mean.size());
  AdoptClasses(dataset->spec().objects, config.policy.objects);
  ETUDE_ASSIGN_OR_RETURN(auto loaded, language::Grammar::LoadFor(dataset->spec().objects));
  grammar = std::make_shared<const language::Grammar>(std::move(loaded));

  const auto& crop = config.policy.image.crop;
  const auto& camera = snapshot->episodes().front()->episode().cameras.at(0).camera;
  if (crop[0] < 0 || crop[1] < 0 || crop[0] + crop[2] > camera.width || crop[1] + crop[3] > camera.height)
    return Fail(Code::kInvalidArgument,
                fmt::format("policy.image.crop: {}x{} px at ({}, {}) does not fit the dataset's "
                            "pictures of {}x{} px",
                            crop[2], crop[3], crop[0], crop[1], camera.width, camera.height));
  maker = std::make_shared<data::BatchMaker>(config.data, data::Region{crop[0], crop[1], crop[2], crop[3]},
                                             config.policy.objects, dataset->spec().tasks, grammar, camera.width,
                                             camera.height);

  SetBlasThreads(config.threads.intra_op);
  int copies = config.threads.replicas;
  if (copies == 0) copies = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  std::vector<std::shared_ptr<policy::Policy>> policies;
  for (int r = 0; r < std::min(copies, config.data.batch); ++r) {
    ETUDE_ASSIGN_OR_RETURN(auto policy,
                           policy::Policy::Create(config.policy, ToNormalization(statistics), config.seed));
    policy->train();
    policies.push_back(std::move(policy));
  }
  scheduler = std::make_unique<curriculum::Scheduler>(config.curriculum, Subtasks(config.policy));

  RunState state;
  if (options.resume) {
    ETUDE_ASSIGN_OR_RETURN(state, LoadRunState(options.out / "training_state.safetensors"));
    ETUDE_RETURN_IF_ERROR(Resume(state, policies));
  }
  optimizer = std::make_unique<Optimizer>(config.optimizer, policies, FrozenParameters(*policies[0], config.freeze));
  if (options.resume) {
    ETUDE_RETURN_IF_ERROR(optimizer->LoadStateTensors(state.optimizer));
    ETUDE_RETURN_IF_ERROR(scheduler->Restore(state.curriculum));
    if (state.rng.defined()) {
      at::Generator generator = at::detail::getDefaultCPUGenerator();
      generator.set_state(state.rng);
    }
    step = state.step;
    elapsed_before = state.elapsed_s;
    best_stage = state.best_stage;
    best_score = state.best_stage > 0 ? state.best_score : best_score;
    checkpoint_step = state.checkpoint_step;
  }
  replicas = std::make_unique<Replicas>(std::move(policies));
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(options.out / "config.yaml", ToYaml(ToJson(config))));
  ETUDE_ASSIGN_OR_RETURN(auto opened, MetricsLog::Open(options.out));
  log = std::make_unique<MetricsLog>(std::move(opened));
  Log().info(
      "training '{}': {} parameters, {} replicas, batch {} x {} sentences, {} training episodes, "
      "from step {}",
      config.name, optimizer->size(), replicas->size(), config.data.batch, config.data.sentences,
      snapshot->episode_count(data::Split::kTrain), step);
  return {};
}

Status Trainer::Impl::Resume(const RunState& state, std::vector<std::shared_ptr<policy::Policy>>& policies) const {
  if (state.architecture != policy::ArchitectureHash(config.policy))
    return Fail(Code::kInvalidArgument,
                fmt::format("resume '{}': its policy has another architecture ({:.12} there, "
                            "{:.12} asked for); train "
                            "into another folder, or leave policy.* as in its config.yaml",
                            options.out.string(), state.architecture, policy::ArchitectureHash(config.policy)));
  for (auto& policy : policies) ETUDE_RETURN_IF_ERROR(policy->LoadStateTensors(state.policy));
  return {};
}

void Trainer::Impl::LogAdvance(const std::optional<curriculum::Advance>& advance) {
  if (!advance) return;
  Log().info("stage {} of {} ({}) at step {}: {}: {}", advance->to, scheduler->stages(), scheduler->StageName(),
             advance->step, ToString(advance->cause), advance->reason);
  const Status written = log->WriteAdvance(*advance, scheduler->StageName());
  if (!written) Log().warn("{}", written.error().message);
}

Status Trainer::Impl::TrainStep() {
  Stopwatch wait;
  ETUDE_ASSIGN_OR_RETURN(auto batch, loader->Next());
  const double wait_s = wait.Seconds();
  optimizer->ZeroGradients();
  ETUDE_ASSIGN_OR_RETURN(const BatchLoss loss, replicas->Backward(*batch, scheduler->level()));
  const double lr = LearningRate(config.optimizer, step, RunProgress());
  const auto outcome =
      std::isfinite(loss.total) ? optimizer->Step(lr) : Optimizer::Outcome{std::numeric_limits<double>::quiet_NaN()};
  if (!std::isfinite(outcome.gradient_norm)) {
    std::string terms;
    for (const auto& [name, value] : loss.terms)
      if (!std::isfinite(value)) terms += " " + name;
    return Fail(Code::kInternal, fmt::format("the loss is not finite at step {} (loss {}, gradient norm {}, "
                                             "terms:{}); nothing was saved, "
                                             "the last good checkpoint is of step {}; try a lower optimizer.lr",
                                             step, loss.total, outcome.gradient_norm,
                                             terms.empty() ? " all finite" : terms, checkpoint_step));
  }
  optimizer->UpdateAverage(config.ema);
  loader->Recycle(std::move(batch));
  ++step;
  Record(loss, wait_s, outcome.gradient_norm);
  return {};
}

void Trainer::Impl::Record(const BatchLoss& loss, double wait_s, double gradient_norm) {
  window.loss += loss.total;
  window.wait_s += wait_s;
  window.gradient_norm += gradient_norm;
  for (const auto& [name, value] : loss.terms) window.terms[name] += value;
  ++window.steps;
}

Status Trainer::Impl::FlushWindow() {
  if (window.steps == 0) return {};
  const double n = window.steps, seconds = window.watch.Seconds();
  last.loss = window.loss / n;
  last.data_wait = window.wait_s / seconds;
  last.samples_per_second = n * config.data.batch / seconds;
  std::map<std::string, double> scalars{{"loss", last.loss},
                                        {"gradient_norm", window.gradient_norm / n},
                                        {"learning_rate", LearningRate(config.optimizer, step, RunProgress())},
                                        {"samples_per_second", last.samples_per_second},
                                        {"data_wait", last.data_wait},
                                        {"stage", scheduler->stage()}};
  for (const auto& [name, value] : window.terms) scalars[name] = value / n;
  window = {};
  return log->Write("train", step, Elapsed(), scalars);
}

Status Trainer::Impl::EvaluateNow(bool observe) {
  const auto snapshot = dataset->snapshot();
  const auto samples =
      data::SpreadFrames(*snapshot, data::Split::kValid, MixSeed({config.seed}, "valid"), config.eval.frames);
  optimizer->ExchangeAverage();
  auto result = learn::Evaluate(replicas->front(), *maker, *snapshot, samples, scheduler->level(), config.data.batch);
  const auto language = learn::EvaluateLanguage(replicas->front(), *grammar, dataset->spec().tasks);
  optimizer->ExchangeAverage();
  ETUDE_ASSIGN_OR_RETURN(evaluation, std::move(result));
  evaluation.metrics.insert(language.begin(), language.end());
  evaluated_step = step;
  last.metrics = evaluation.metrics;
  ETUDE_RETURN_IF_ERROR(log->Write("valid", step, Elapsed(), evaluation.metrics));

  // the best is judged by the last subtask in training; a later stage is always better
  const int stage = scheduler->stage();
  double score = 0;
  int judged = 0;
  for (const auto& module : config.policy.modules) {
    if (module.level != scheduler->level() || !evaluation.errors.contains(module.name)) continue;
    score += evaluation.errors.at(module.name);
    ++judged;
  }
  const bool best =
      judged > 0 && std::isfinite(score) && (stage > best_stage || (stage == best_stage && score < best_score));
  if (best) {
    best_stage = stage;
    best_score = score;
  }
  if (observe) LogAdvance(scheduler->Observe(step, RunProgress(), evaluation.errors));
  // before the last stage only channel `latest` matters
  if (best && stage == scheduler->stages()) return SaveNow(true);
  return {};
}

Status Trainer::Impl::SaveNow(bool best) {
  CheckpointRequest request;
  request.step = step;
  request.stage = scheduler->stage();
  request.stages = scheduler->stages();
  request.stage_name = scheduler->StageName();
  request.best = best;
  request.metrics = last.metrics;
  request.dataset = dataset->snapshot()->Fingerprint();
  request.train_episodes = dataset->snapshot()->episode_count(data::Split::kTrain);
  request.joints = joints;
  request.config = &config;
  optimizer->ExchangeAverage();
  request.tensors = replicas->front().StateTensors();
  const Status sent = hooks.on_checkpoint ? hooks.on_checkpoint(request) : Status();
  optimizer->ExchangeAverage();
  if (!sent) return Fail(sent.error().Wrap(fmt::format("checkpoint of step {}", step)));
  checkpoint_step = step;

  RunState state;
  state.policy = replicas->front().StateTensors();
  state.optimizer = optimizer->StateTensors();
  state.rng = at::detail::getDefaultCPUGenerator().get_state();
  state.step = step;
  state.elapsed_s = Elapsed();
  state.curriculum = scheduler->Save();
  state.architecture = policy::ArchitectureHash(config.policy);
  state.best_stage = best_stage;
  state.best_score = std::isfinite(best_score) ? best_score : 0;
  state.checkpoint_step = checkpoint_step;
  return SaveRunState(options.out / "training_state.safetensors", state);
}

void Trainer::Impl::Report(bool finished) {
  last.step = step;
  last.stage = scheduler->stage();
  last.stages = scheduler->stages();
  last.stage_name = scheduler->StageName();
  last.progress = RunProgress();
  last.train_episodes = dataset->snapshot()->episode_count(data::Split::kTrain);
  last.eta_s = last.progress > 0 ? Elapsed() * (1 - last.progress) / last.progress : 0;
  last.checkpoint_step = checkpoint_step;
  last.finished = finished;
  if (window.steps > 0) {
    last.loss = window.loss / window.steps;
    last.data_wait = window.wait_s / window.watch.Seconds();
    last.samples_per_second = window.steps * config.data.batch / window.watch.Seconds();
  }
  if (hooks.on_progress) hooks.on_progress(last);
  since_progress.Restart();
  if (!finished && since_line.Seconds() < kLineEvery) return;
  since_line.Restart();
  std::string metrics;
  for (const auto& [name, value] : last.metrics)
    if (!name.ends_with(".hit") && !name.ends_with("_cm") && name != "loss")
      metrics += fmt::format(" {}={:.3g}", name, value);
  Log().info("step {} stage {}/{} {} loss {:.4g} {:.0f} samples/s wait {:.1f} % episodes {} eta {}{}", step, last.stage,
             last.stages, last.stage_name, last.loss, last.samples_per_second, 100 * last.data_wait,
             last.train_episodes, FormatDuration(last.eta_s), metrics);
}

Status Trainer::Impl::AfterStep() {
  if (step % kMetricsEvery == 0) ETUDE_RETURN_IF_ERROR(FlushWindow());
  LogAdvance(scheduler->Tick(step, RunProgress()));
  if (step % static_cast<std::uint64_t>(config.eval.every_steps) == 0) {
    const int stage = scheduler->stage();
    ETUDE_RETURN_IF_ERROR(EvaluateNow(true));
    if (scheduler->stage() != stage && checkpoint_step != step) ETUDE_RETURN_IF_ERROR(SaveNow(false));
    window = {};  // the rate is of training, not of validation
  }
  if (step % static_cast<std::uint64_t>(config.checkpoint.every_steps) == 0 && checkpoint_step != step)
    ETUDE_RETURN_IF_ERROR(SaveNow(false));
  if (since_progress.Seconds() >= kProgressEvery) Report(false);
  return {};
}

Status Trainer::Impl::Finish(bool stopped) {
  ETUDE_RETURN_IF_ERROR(FlushWindow());
  // a stop drains at once; the limit also measures what was reached
  if (!stopped && evaluated_step != step) ETUDE_RETURN_IF_ERROR(EvaluateNow(false));
  if (checkpoint_step != step) ETUDE_RETURN_IF_ERROR(SaveNow(false));
  Report(!stopped);
  Log().info("{} at step {} after {}; '{}'", stopped ? "stopped" : "finished", step, FormatDuration(Elapsed()),
             options.out.string());
  return log->Sync();
}

Status Trainer::Impl::Loop() {
  std::unique_ptr<Follower> follower;
  if (options.follow) follower = std::make_unique<Follower>(dataset, config.data.refresh_s);
  loader = std::make_unique<data::Loader>(dataset, maker, config.data, config.seed, step);
  watch.Restart();
  window = {};
  bool stopped = false;
  while (RunProgress() < 1 && !(stopped = StopRequested())) {
    ETUDE_RETURN_IF_ERROR(TrainStep());
    ETUDE_RETURN_IF_ERROR(AfterStep());
  }
  loader.reset();
  return Finish(stopped);
}

Trainer::Trainer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Trainer::~Trainer() = default;

Result<std::unique_ptr<Trainer>> Trainer::Create(const TrainConfig& config, std::shared_ptr<data::Dataset> dataset,
                                                 const RunOptions& options, const Hooks& hooks) {
  ETUDE_RETURN_IF_ERROR(config.Validate());
  if (config.steps == 0 && config.minutes <= 0)
    return Fail(Code::kInvalidArgument, "train: give --steps N or --minutes M (or steps:, minutes: in the config)");
  auto impl = std::make_unique<Impl>();
  impl->config = config;
  impl->options = options;
  impl->hooks = hooks;
  impl->dataset = std::move(dataset);
  try {
    ETUDE_RETURN_IF_ERROR(impl->Build());
  } catch (const c10::Error& error) {
    return Fail(Code::kInternal, fmt::format("build the policy: {}", error.what_without_backtrace()));
  }
  return std::unique_ptr<Trainer>(new Trainer(std::move(impl)));
}

Status Trainer::Run() {
  try {
    return impl_->Loop();
  } catch (const c10::Error& error) {
    return Fail(Code::kInternal, fmt::format("train: {}", error.what_without_backtrace()));
  }
}

Progress Trainer::progress() const { return impl_->last; }

}  // namespace etude::learn
