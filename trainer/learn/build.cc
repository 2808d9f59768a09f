// SPDX-License-Identifier: Apache-2.0
// Builds a run: its network, replicas and optimiser, out of data (build_data.h) and what it begins with (begin.h).
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <filesystem>
#include <map>

#include "services/core/cores.h"
#include "services/core/hash.h"
#include "services/core/log.h"
#include "trainer/checkpoint/surgery.h"
#include "trainer/data/statistics.h"
#include "trainer/learn/await_data.h"
#include "trainer/learn/begin.h"
#include "trainer/learn/build_data.h"
#include "trainer/learn/keep.h"
#include "trainer/learn/run.h"
#include "trainer/learn/tensors.h"
#include "trainer/policy/language_encoder.h"

namespace etude::learn {
namespace {

using Policies = std::vector<std::shared_ptr<policy::Policy>>;

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

// What clip's folder holds, or WordNet, becomes part of what the policy is.
Status OpenTextEncoder(TrainingRun& run) {
  policy::LanguageConfig& language = run.config.policy.language;
  if (language.senses) {
    ETUDE_ASSIGN_OR_RETURN(const auto senses, policy::OpenSenses(language));
    language.sha256 = senses->sha256();
  }
  if (language.clip_folder().empty()) return {};
  const Path folder = std::filesystem::absolute(language.clip_folder()).lexically_normal();
  ETUDE_ASSIGN_OR_RETURN(run.text_encoder, clip::TextEncoder::Open(folder, language.sha256));
  language.encoder = "clip:" + folder.string();
  language.sha256 = run.text_encoder->sha256();
  Log().info("language: CLIP's text tower of '{}', {} numbers a sentence, content {:.12}, frozen", folder.string(),
             run.text_encoder->width(), language.sha256);
  const auto& data = run.config.data;
  if (data.varied > 0 || data.noisy > 0 || data.strange > 0 || data.masked > 0)
    Log().warn(
        "sentences are drawn with synonyms, typing errors or nonsense: each new one goes through CLIP's tower; "
        "data.varied=0 data.noisy=0 data.strange=0 data.masked=0 keep to the templates, which are embedded once");
  return {};
}

int RanksOf(const TrainingRun& run) { return run.options.ranks ? run.options.ranks->size() : 1; }

// Of the network in this process, where a run begins.
int NewCopies(const TrainingRun& run) {
  // more of them keep the cores of a CPU busy; a CUDA device is with one
  if (!run.options.device.is_cpu()) return 1;
  // each has a picture of every batch at least
  const int pictures = std::max(1, run.config.data.batch / RanksOf(run));
  if (run.config.threads.replicas > 0) return std::min(run.config.threads.replicas, pictures);
  const int cores = run.options.replicas > 0 ? run.options.replicas : Cores();
  return std::clamp(pictures / ThreadsConfig::kFewestPictures, 1, cores);
}

// A run that goes on keeps its own, on a machine with more or fewer cores too: it comes to the same weights. Who asks
// for another number, or has a number of ranks that cannot share them, gets what was asked for, and is told.
int CopiesOf(const TrainingRun& run, const std::optional<RunState>& state) {
  const int copies = NewCopies(run), ranks = RanksOf(run);
  const int before = state ? state->replicas : 0;
  if (before == 0 || !run.options.device.is_cpu() || before == copies * ranks) return copies;
  if (run.config.threads.replicas == 0 && before % ranks == 0 && before <= run.config.data.batch) {
    Log().info(
        "goes on with {} replicas, as many as it had (here it would begin with {}; threads.replicas=N changes it)",
        before, copies * ranks);
    return before / ranks;
  }
  Log().warn("goes on with {} replicas instead of the {} that it had: not what it would have come to with those",
             copies * ranks, before);
  return copies;
}

Result<Policies> MakeReplicas(const TrainingRun& run, const data::Statistics& statistics, int copies) {
  const TrainConfig& config = run.config;
  SetBlasThreads(config.threads.intra_op);
  const int ranks = RanksOf(run);
  if (ranks > config.data.batch)
    return Fail(Code::kInvalidArgument,
                fmt::format("{} ranks share {} pictures a step (data.batch): give no more ranks "
                            "than pictures",
                            ranks, config.data.batch));
  Policies policies;
  for (int r = 0; r < copies; ++r) {
    ETUDE_ASSIGN_OR_RETURN(
        auto policy, policy::Policy::Create(config.policy, ToNormalization(statistics), config.seed, run.text_encoder));
    policy->train();
    policies.push_back(std::move(policy));
  }
  return policies;
}

Status BuildNetwork(const data::Snapshot& snapshot, const data::Statistics& statistics,
                    const std::optional<RunState>& state, int copies_here, TrainingRun& run) {
  ETUDE_ASSIGN_OR_RETURN(auto policies, MakeReplicas(run, statistics, copies_here));
  std::vector<std::string> modules;
  for (const auto& module : run.config.policy.modules) modules.push_back(module.name);
  for (const auto& [name, goal] : run.config.curriculum.goals)
    if (std::ranges::find(modules, name) == modules.end())
      Log().warn("curriculum.goals: {}: the policy has no such module{}", name, Suggestion(name, modules));
  run.scheduler = std::make_unique<curriculum::Scheduler>(run.config.curriculum, Subtasks(run.config.policy));
  run.limit = RunLimit(run.config.steps, run.config.minutes);
  if (state) {
    ETUDE_RETURN_IF_ERROR(CheckFits(*state, run));
    ETUDE_RETURN_IF_ERROR(checkpoint::CheckFreeze(run.config.policy, run.config.init.freeze));
    ETUDE_RETURN_IF_ERROR(CheckFrozenLearned(*state, run));
    for (auto& policy : policies) ETUDE_RETURN_IF_ERROR(policy->LoadStateTensors(state->policy));
  } else if (!run.config.init.from.empty()) {
    ETUDE_RETURN_IF_ERROR(BeginWithCheckpoint(run, policies));
  } else {
    ETUDE_RETURN_IF_ERROR(CheckNothingIsKept(run.config.init));
  }
  for (auto& policy : policies) {
    policy->Freeze(run.config.init.freeze);
    policy->to(run.options.device);
  }
  ETUDE_ASSIGN_OR_RETURN(run.validation, data::FixedSplit(snapshot, data::Split::kValid,
                                                          state ? state->validation : std::vector<std::uint64_t>{}));
  run.optimizer = std::make_unique<Optimizer>(run.config.optimizer, policies);
  if (run.optimizer->size() == 0)
    return Fail(Code::kInvalidArgument,
                fmt::format("init.freeze: {}: that is all there is, and nothing is left to train: leave a part out, or "
                            "add a module",
                            fmt::join(run.config.init.freeze, ", ")));
  if (state) ETUDE_RETURN_IF_ERROR(RestoreState(*state, run));
  const auto copies = static_cast<int>(policies.size());
  const Ranks* ranks = run.options.ranks.get();
  run.optimizer->AverageOver(copies * (ranks ? ranks->size() : 1));
  run.replicas = ranks ? std::make_unique<Replicas>(std::move(policies), copies * ranks->rank(), copies * ranks->size())
                       : std::make_unique<Replicas>(std::move(policies));
  return {};
}

// All ranks train the same network, on the same data where those stand still.
Status CheckRanks(const data::Snapshot& snapshot, const TrainingRun& run, int copies) {
  if (!run.options.ranks) return {};
  ETUDE_RETURN_IF_ERROR(run.options.ranks->CheckSame("configuration", ToJson(run.config).dump()));
  ETUDE_RETURN_IF_ERROR(run.options.ranks->CheckSame("threads.replicas", std::to_string(copies)));
  // each reads its own file: an old copy of the state on another host would train another network along
  const Path begins = run.options.resume ? run.options.out / kRunStateFile : Path(run.config.init.from);
  std::string content;
  if (!begins.empty()) {
    ETUDE_ASSIGN_OR_RETURN(const auto bytes, ReadBinaryFile(begins));
    content = Sha256Hex(bytes);
  }
  ETUDE_RETURN_IF_ERROR(
      run.options.ranks->CheckSame(run.options.resume ? kRunStateFile : "content of init.from", content));
  if (run.options.follow) return {};
  return run.options.ranks->CheckSame("dataset", snapshot.Fingerprint());
}

// A growing dataset has more episodes for a rank that looks later: all normalise by what rank 0 saw.
Status ShareStatistics(const RunOptions& options, data::Statistics& statistics) {
  if (!options.ranks || !options.follow) return {};
  for (std::vector<float>* part : {&statistics.joint_mean, &statistics.joint_std, &statistics.position_mean,
                                   &statistics.position_std, &statistics.displacement_std, &statistics.offset_std}) {
    torch::Tensor values = torch::zeros({static_cast<std::int64_t>(part->size())}, torch::kFloat32);
    if (options.ranks->leads()) std::copy(part->begin(), part->end(), values.data_ptr<float>());
    ETUDE_RETURN_IF_ERROR(options.ranks->Sum(values));
    std::copy_n(values.data_ptr<float>(), part->size(), part->begin());
  }
  return {};
}

// What each of several folders adds. A run that goes on is validated on the episodes that it began with.
void LogFolders(const data::Dataset& dataset, const data::Snapshot& snapshot, const data::Snapshot& validation) {
  for (std::uint32_t folder = 0; folder < dataset.folders() && dataset.folders() > 1; ++folder) {
    const auto of_folder = [&](const data::Snapshot& from, data::Split split) {
      return std::ranges::count_if(from.episodes(),
                                   [&](const auto& entry) { return entry->folder == folder && entry->split == split; });
    };
    const auto validated = of_folder(validation, data::Split::kValid);
    Log().info("dataset {} of {}, '{}': {} training and {} validation episodes", folder + 1, dataset.folders(),
               dataset.path(folder).string(), of_folder(snapshot, data::Split::kTrain), validated);
    if (validated == 0)
      Log().warn("nothing of '{}' is validated on: {}", dataset.path(folder).string(),
                 of_folder(snapshot, data::Split::kValid) == 0
                     ? "it has no validation episode"
                     : "this run goes on with the validation episodes that it began with");
  }
}

}  // namespace

Status CheckBeginning(const TrainConfig& config, bool resume) {
  ETUDE_RETURN_IF_ERROR(config.Validate());
  ETUDE_RETURN_IF_ERROR(RequireLimit(config));
  TrainingRun run;
  run.config = config;
  ETUDE_RETURN_IF_ERROR(OpenTextEncoder(run));
  if (resume) return checkpoint::CheckFreeze(config.policy, config.init.freeze);
  if (config.init.from.empty()) return CheckNothingIsKept(config.init);
  ETUDE_ASSIGN_OR_RETURN(const auto source, checkpoint::ReadFile(config.init.from));
  const InitConfig& init = config.init;
  return checkpoint::CheckSurgery(source, {init.copy, init.fresh, init.freeze, init.like}, config.policy);
}

Result<std::unique_ptr<TrainingRun>> BuildRun(const TrainConfig& config, std::shared_ptr<data::Dataset> dataset,
                                              const RunOptions& options) {
  auto run = std::make_unique<TrainingRun>();
  run->config = config;
  run->options = options;
  run->dataset = std::move(dataset);
  ETUDE_RETURN_IF_ERROR(MakeFolders(options.out));
  ETUDE_RETURN_IF_ERROR(OpenTextEncoder(*run));
  ETUDE_RETURN_IF_ERROR(AwaitData(*run->dataset, config,
                                  {.follow = options.follow,
                                   .patience = options.patience,
                                   .source = options.source,
                                   .over = options.over,
                                   .alone = options.ranks == nullptr}));
  const auto snapshot = run->dataset->snapshot();
  ETUDE_ASSIGN_OR_RETURN(auto statistics, data::ComputeStatistics(*snapshot));
  ETUDE_ASSIGN_OR_RETURN(run->embodiment, FindEmbodiment(*run->dataset, *snapshot));
  ETUDE_RETURN_IF_ERROR(MakeBatchMaker(*snapshot, *run));
  ETUDE_ASSIGN_OR_RETURN(const auto state, StateToResume(options));
  const int copies = CopiesOf(*run, state);
  ETUDE_RETURN_IF_ERROR(CheckRanks(*snapshot, *run, copies));
  ETUDE_RETURN_IF_ERROR(ShareStatistics(options, statistics));
  ETUDE_RETURN_IF_ERROR(BuildNetwork(*snapshot, statistics, state, copies, *run));
  LogFolders(*run->dataset, *snapshot, *run->validation);
  if (state && !run->config.init.freeze.empty()) LogFrozen(*state, *run);
  if (!options.follow && run->dataset->unread() > 0)
    Log().warn("{} episodes could not be read and are left out; `etude dataset verify --keep` says why",
               run->dataset->unread());
  if (!options.ranks || options.ranks->leads()) {
    ETUDE_RETURN_IF_ERROR(WriteOrWait(*run, "metrics.jsonl", [&]() -> Status {
      ETUDE_ASSIGN_OR_RETURN(auto opened, MetricsLog::Open(options.out));
      run->log = std::make_unique<MetricsLog>(std::move(opened));
      return {};
    }));
  }
  Log().info(
      "training '{}': {} parameters to train, {} replicas, batch {} x {} sentences, {} training and {} validation "
      "episodes, "
      "on {} from step {}",
      config.name, run->optimizer->size(), run->replicas->size(), config.data.batch, config.data.sentences,
      snapshot->episode_count(data::Split::kTrain), run->validation->episodes().size(), options.device.str(),
      run->step);
  return run;
}

}  // namespace etude::learn
