// SPDX-License-Identifier: Apache-2.0
// Builds a run: data, network, optimiser, and what an earlier run left.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <map>
#include <set>
#include <string_view>

#include "services/core/cores.h"
#include "services/core/hash.h"
#include "services/core/log.h"
#include "services/language/held_out.h"
#include "services/spec/episode_world.h"
#include "services/spec/object_names.h"
#include "services/spec/task_name.h"
#include "trainer/checkpoint/readiness.h"
#include "trainer/checkpoint/surgery.h"
#include "trainer/data/labels.h"
#include "trainer/data/statistics.h"
#include "trainer/learn/await_data.h"
#include "trainer/learn/run.h"
#include "trainer/learn/tensors.h"
#include "trainer/policy/architecture.h"
#include "trainer/policy/crop.h"
#include "trainer/policy/language_encoder.h"
#include "trainer/policy/names.h"
#include "trainer/policy/parts.h"

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

// The classes that the policy tells apart: as configured, unless the dataset has others.
void AdoptClasses(std::vector<std::string> found, std::vector<std::string>& classes) {
  const bool covered = std::all_of(found.begin(), found.end(), [&](const std::string& name) {
    return std::find(classes.begin(), classes.end(), name) != classes.end();
  });
  if (covered) return;
  Log().info("the policy's classes are the dataset's: {}", fmt::join(found, ", "));
  classes = std::move(found);
}

// The tasks that the policy tells apart: as configured, or every task that there is, so that modules that are added
// later find theirs; unless the dataset has others.
void AdoptTasks(const std::vector<std::string>& tasks, policy::PolicyConfig& config) {
  if (!policy::DecodesTask(config)) return;
  std::vector<std::string> known = BaseTasks();
  const auto has = [](const std::vector<std::string>& list, const std::string& name) {
    return std::find(list.begin(), list.end(), name) != list.end();
  };
  bool covered = !config.tasks.empty();
  for (const auto& text : tasks) {
    const auto task = ParseTask(text);
    if (!task) continue;
    if (!has(known, task->base)) known.push_back(task->base);
    covered = covered && has(config.tasks, task->base);
  }
  if (!covered) config.tasks = std::move(known);
}

// Of every episode: one that is another's is named. A camera that moves within a folder, or will, is part of what is
// learned, and then any other folder's, too; each of two that stand still has its own policy.
Result<checkpoint::Embodiment> FindEmbodiment(const data::Dataset& dataset, const data::Snapshot& snapshot) {
  auto embodiment = checkpoint::EmbodimentOf(snapshot.episodes().front()->episode());
  for (std::uint32_t folder = 0; folder < dataset.folders(); ++folder) {
    const auto& world = dataset.spec(folder).randomization.world;
    if (world.camera_position > 0 || world.camera_aim > 0 || world.camera_roll > 0) embodiment.camera_pose.clear();
    if (world.fovy_deg > 0) embodiment.fovy = 0;
  }
  std::vector<checkpoint::Embodiment> each;
  std::map<std::uint32_t, std::size_t> first;  // of each folder
  for (const auto& entry : snapshot.episodes()) {
    const auto own = first.try_emplace(entry->folder, each.size()).first->second;
    each.push_back(checkpoint::EmbodimentOf(entry->episode()));
    if (each.back().camera_pose != each[own].camera_pose) embodiment.camera_pose.clear();
    if (each.back().fovy != each[own].fovy) embodiment.fovy = 0;
  }
  const auto& episodes = snapshot.episodes();
  for (std::size_t i = 0; i < each.size(); ++i)
    if (const auto differences = checkpoint::Differences(embodiment, each[i]); !differences.empty())
      return Fail(Code::kInvalidArgument,
                  fmt::format("the data are of several kinds: '{}' is not as '{}' ({}); a policy fits one: collect a "
                              "dataset for each",
                              episodes[i]->record.path.string(), episodes.front()->record.path.string(),
                              fmt::join(differences, "; ")));
  return embodiment;
}

// Those that the dataset is drawn with, the ones that are still to come too: a crop must be the same when the run is
// resumed. Where the spec knows of no moving camera, those that the episodes have.
std::vector<Camera> CamerasOfDataset(const data::Dataset& dataset, const data::Snapshot& snapshot) {
  constexpr std::uint64_t kFewest = 4096;
  std::vector<Camera> cameras;
  for (std::uint32_t folder = 0; folder < dataset.folders(); ++folder) {
    const CampaignSpec& spec = dataset.spec(folder);
    if (spec.randomization.world.moves_camera()) {
      std::ranges::copy(CamerasOf(spec, std::max(kFewest, spec.episodes)), std::back_inserter(cameras));
      continue;
    }
    for (const auto& entry : snapshot.episodes())
      if (entry->folder == folder) cameras.push_back(entry->episode().cameras.at(0).camera);
  }
  return cameras;
}

// Of the grammar that this run draws sentences from; "" where it has none for an object, which ends a run at its begin.
std::string WordsOf(const TrainingRun& run, const std::vector<std::string>& objects) {
  const auto& tasks = run.dataset->tasks();
  auto words = language::SeenWords(*run.grammar, tasks, objects);
  if (!words) return "";
  const bool relabels = run.config.data.sentences > 1 && run.config.curriculum.relabelled != "never";
  if (run.config.data.clauses > 0 && relabels)
    if (auto more = language::ClauseWords(*run.grammar, tasks, objects)) words->merge(*more);
  return language::WordsText(*words);
}

// The specs', and the ball where a task has one in the way, which no spec may name beside it.
std::vector<std::string> ObjectsIn(const data::Dataset& dataset) {
  std::vector<std::string> objects = dataset.objects();
  const bool avoids = std::ranges::any_of(dataset.tasks(), [](const std::string& text) {
    const auto task = ParseTask(text);
    return task && task->avoid == "obstacle";
  });
  if (avoids && std::ranges::find(objects, kObstacleObject) == objects.end()) objects.emplace_back(kObstacleObject);
  return objects;
}

// A module about one object learns nothing where there is none of it, and then nothing that reads it may drive.
Status CheckObjects(const policy::PolicyConfig& config, const std::vector<std::string>& objects) {
  const auto path = checkpoint::ControlPath(config);
  const auto is_there = [&](const std::string& name) {
    return std::ranges::any_of(objects,
                               [&](const auto& object) { return object == name || ObjectNoun(object) == name; });
  };
  for (const auto& module : config.modules) {
    std::vector<std::string> about{module.decoder.entity};
    for (const auto& item : module.attend) about.push_back(policy::AttendedEntity(item));
    for (const auto& text : about) {
      const auto entity = data::ParseEntity(text);
      if (!entity || entity->kind != data::Entity::Kind::kObject || is_there(entity->object)) continue;
      const std::string problem = fmt::format(
          "policy: module {} is about '{}', which the data do not have (they have {}): give data with it, or "
          "a graph without that module",
          module.name, entity->object, fmt::join(objects, ", "));
      if (std::ranges::find(path, module.name) != path.end()) return Fail(Code::kInvalidArgument, problem);
      Log().warn("{}", problem);
    }
  }
  return {};
}

// The specs', and what episodes show besides: an earlier import's spec has what its first recording tracked, and
// relabelled sentences speak of all that stands in a scene.
std::vector<std::string> ObjectsSaid(const data::Dataset& dataset, const data::Snapshot& snapshot) {
  std::vector<std::string> objects = dataset.objects();
  for (const auto& entry : snapshot.episodes())
    for (const auto& object : entry->episode().objects)
      if (!IsDistractor(object.name) && object.name != kObstacleObject &&
          std::ranges::find(objects, object.name) == objects.end())
        objects.push_back(object.name);
  return objects;
}

Status MakeBatchMaker(const data::Snapshot& snapshot, TrainingRun& run) {
  AdoptClasses(NounsOf(*run.dataset), run.config.policy.objects);
  AdoptTasks(run.dataset->tasks(), run.config.policy);
  const std::vector<std::string> said = ObjectsSaid(*run.dataset, snapshot);
  ETUDE_ASSIGN_OR_RETURN(auto loaded, language::Grammar::LoadFor(said, run.dataset->tasks()));
  run.grammar = std::make_shared<const language::Grammar>(std::move(loaded));
  run.words = WordsOf(run, said);
  policy::PolicyConfig& config = run.config.policy;
  ETUDE_RETURN_IF_ERROR(CheckObjects(config, ObjectsIn(*run.dataset)));
  const auto& camera = snapshot.episodes().front()->episode().cameras.at(0).camera;
  const std::vector<Camera> cameras = CamerasOfDataset(*run.dataset, snapshot);
  ETUDE_ASSIGN_OR_RETURN(const auto crop, policy::ResolveCrop(config.image, cameras));
  config.image.crop = policy::ToNumbers(crop);  // a checkpoint says what it saw
  const data::BatchContent content{
      crop,        camera.width, camera.height, run.dataset->tasks(), config.objects, policy::LabelColumnsOf(config),
      config.tasks};
  run.maker = std::make_shared<data::BatchMaker>(run.config.data, content, run.grammar);
  return {};
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
  if (run.config.data.varied > 0 || run.config.data.noisy > 0)
    Log().warn(
        "sentences are drawn with synonyms or typing errors: each new one goes through CLIP's tower; data.varied=0 "
        "data.noisy=0 keep to the templates, which are embedded once");
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

// That a training before had, which what is copied of it, or goes on, still knows.
void AddWords(const std::string& text, TrainingRun& run) {
  auto words = language::WordsIn(run.words);
  words.merge(language::WordsIn(text));
  run.words = language::WordsText(words);
}

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

Status BeginWithCheckpoint(TrainingRun& run, Policies& policies) {
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
  return {};
}

// Of a run that begins with no checkpoint.
Status CheckNothingIsKept(const InitConfig& init) {
  if (init.freeze.empty()) return {};
  return Fail(Code::kInvalidArgument,
              fmt::format("init.freeze: {}: nothing was learned yet that could be kept; give --init FILE",
                          fmt::join(init.freeze, ", ")));
}

// what was saved is of this network, robot and camera
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

Result<std::optional<RunState>> StateToResume(const RunOptions& options) {
  if (!options.resume) return std::nullopt;
  ETUDE_ASSIGN_OR_RETURN(auto state, LoadRunState(options.out / kRunStateFile));
  return std::optional(std::move(state));
}

// As where a run begins with a checkpoint: what has not begun to learn never would, and nothing that reads it may
// drive.
Status CheckFrozenLearned(const RunState& state, const TrainingRun& run) {
  const auto learned = [](const auto& item) { return item.second.trained_steps > 0; };
  if (std::ranges::none_of(state.modules, learned)) return {};  // states of before count no steps at all
  std::vector<std::string> untrained;
  for (const auto& module : run.config.policy.modules) {
    const bool has_loss = !module.decoder.quantity.empty() || policy::IsToldWhereToLook(module);
    if (!has_loss || std::ranges::count(run.config.init.freeze, module.name) == 0) continue;
    const auto record = state.modules.find(module.name);
    if (record == state.modules.end() || (record->second.trained_steps == 0 && !record->second.error))
      untrained.push_back(module.name);
  }
  if (untrained.empty()) return {};
  return Fail(
      Code::kInvalidArgument,
      fmt::format("init.freeze: {}: not trained yet: it would never learn; leave it out", fmt::join(untrained, ", ")));
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

// Of what learned until now, checkpoints had the average over the last steps; frozen it is as the last step left it.
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

std::vector<std::string> NounsOf(const data::Dataset& dataset) {
  std::vector<std::string> nouns;
  for (const auto& object : dataset.objects())
    if (std::string noun = ObjectNoun(object); std::ranges::find(nouns, noun) == nouns.end())
      nouns.push_back(std::move(noun));
  return nouns;
}

std::vector<std::string> DatasetsOf(const data::Dataset& dataset) {
  std::vector<std::string> datasets;
  for (std::size_t folder = 0; folder < dataset.folders(); ++folder) datasets.push_back(dataset.spec_sha256(folder));
  return datasets;
}

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
    ETUDE_ASSIGN_OR_RETURN(auto opened, MetricsLog::Open(options.out));
    run->log = std::make_unique<MetricsLog>(std::move(opened));
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
