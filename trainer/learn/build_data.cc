// SPDX-License-Identifier: Apache-2.0
#include "trainer/learn/build_data.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <iterator>
#include <map>

#include "services/core/log.h"
#include "services/language/held_out.h"
#include "services/spec/episode_world.h"
#include "services/spec/object_names.h"
#include "services/spec/task_name.h"
#include "trainer/checkpoint/readiness.h"
#include "trainer/data/labels.h"
#include "trainer/policy/crop.h"
#include "trainer/policy/names.h"

namespace etude::learn {
namespace {

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

void AddWords(const std::string& text, TrainingRun& run) {
  auto words = language::WordsIn(run.words);
  words.merge(language::WordsIn(text));
  run.words = language::WordsText(words);
}

}  // namespace etude::learn
