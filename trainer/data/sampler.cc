// SPDX-License-Identifier: Apache-2.0
#include "trainer/data/sampler.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <iterator>

#include "services/core/check.h"
#include "services/core/rng.h"
#include "services/spec/object_names.h"

namespace etude::data {
namespace {

constexpr int kMostDraws = 64;

}  // namespace

std::vector<Sample> DrawBatch(const Snapshot& snapshot, Split split, std::uint64_t seed, std::uint64_t step, int batch,
                              int retry, double rest) {
  const auto& by_task = snapshot.frames(split);
  if (by_task.empty()) return {};
  std::vector<const std::vector<FrameRef>*> tasks;
  for (const auto& [task, refs] : by_task) tasks.push_back(&refs);

  std::vector<Sample> samples(static_cast<std::size_t>(batch));
  for (std::size_t b = 0; b < samples.size(); ++b) {
    const std::uint64_t number = step * samples.size() + b;
    samples[b].seed = MixSeed({seed, number, static_cast<std::uint64_t>(retry)}, "sample");
    const auto& refs = *tasks[number % tasks.size()];
    Rng rng(samples[b].seed);
    // a task of nothing but rest has no other frame to find
    for (int draw = 0; draw < kMostDraws; ++draw) {
      samples[b].frame = refs[rng.Below(refs.size())];
      const FrameRef frame = samples[b].frame;
      if (rest >= 1 || !snapshot.episodes()[frame.episode]->AtRest(frame.frame) || rng.Bernoulli(rest)) break;
    }
  }
  return samples;
}

std::vector<Sample> SpreadFrames(const Snapshot& snapshot, Split split, std::uint64_t seed, int count) {
  const auto& by_task = snapshot.frames(split);
  std::vector<Sample> samples;
  if (by_task.empty()) return samples;
  const std::size_t share = std::max<std::size_t>(1, static_cast<std::size_t>(count) / by_task.size());
  for (const auto& [task, refs] : by_task) {
    // refs go episode by episode: equal steps through them visit all episodes and all phases
    const std::size_t n = std::min(share, refs.size());
    for (std::size_t i = 0; i < n; ++i) {
      const FrameRef frame = refs[(2 * i + 1) * refs.size() / (2 * n)];
      const auto number = snapshot.episodes()[frame.episode]->number();
      samples.push_back({frame, MixSeed({seed, number, frame.frame}, "spread")});
    }
  }
  return samples;
}

namespace {

// An object that B of "A to the left of B" may be; "" when the scene has none. Any of them, not only the one that was
// demonstrated: where each picture has one reference, which words mean it is learned slowly.
std::string DrawReference(const TaskSpec& task, const std::string& target, const std::vector<std::string>& names,
                          Rng& rng) {
  std::vector<std::string> others;
  std::copy_if(names.begin(), names.end(), std::back_inserter(others),
               [&](const std::string& name) { return task.MayRefer(target, name); });
  return others.empty() ? "" : others[rng.Below(others.size())];
}

}  // namespace

language::Command CommandOf(const Episode& episode) {
  const auto task = ParseTask(episode.task);
  ETUDE_CHECK(task, "task={}", episode.task);
  return language::CommandFor(*task, episode.target, episode.reference);
}

std::vector<language::Command> DrawCommands(const Episode& episode, const std::vector<std::string>& tasks,
                                            int sentences, std::uint64_t seed) {
  ETUDE_CHECK(sentences >= 1 && !tasks.empty());
  Rng rng(MixSeed({seed}, "commands"));
  const language::Command demonstrated = CommandOf(episode);
  std::vector<std::string> names;
  for (const auto& object : episode.objects)
    if (object.name != episode.target && object.name != demonstrated.obstacle && !IsDistractor(object.name))
      names.push_back(object.name);
  rng.Shuffle(names);
  names.push_back(episode.target);

  std::vector<language::Command> commands{demonstrated};
  for (int s = 1; s < sentences; ++s) {
    const auto task = ParseTask(tasks[rng.Below(tasks.size())]);
    ETUDE_CHECK(task, "tasks={}", fmt::join(tasks, ", "));
    language::Command command{task->base, names[static_cast<std::size_t>(s - 1) % names.size()], "",
                              task->relation() ? "" : demonstrated.obstacle};
    if (task->relation()) {
      command.reference = DrawReference(*task->spec, command.target, names, rng);
      if (command.reference.empty()) command = demonstrated;
    }
    commands.push_back(std::move(command));
  }
  return commands;
}

namespace {

// What one may be told to keep off: in half of the cases one of the other things on the table. Nothing that is called
// as the target is; "": there is nothing.
std::string DrawObstacle(const std::string& target, std::vector<std::string> names, Rng& rng) {
  const std::string noun = ObjectNoun(target);
  std::erase_if(names, [&](const std::string& name) { return ObjectNoun(name) == noun; });
  const bool other = rng.Bernoulli(0.5);
  if (!names.empty() && (other || noun == kObstacleObject)) return names[rng.Below(names.size())];
  return noun == kObstacleObject ? "" : kObstacleObject;
}

}  // namespace

void AddClauses(const Episode& episode, const std::vector<std::string>& tasks, double share, std::uint64_t seed,
                std::vector<language::Command>& commands) {
  if (!(share > 0)) return;
  std::vector<TaskName> relations;
  for (const auto& name : tasks)
    if (const auto task = ParseTask(name); task && task->relation()) relations.push_back(*task);
  std::vector<std::string> names;
  for (const auto& object : episode.objects)
    if (!IsDistractor(object.name)) names.push_back(object.name);
  Rng rng(MixSeed({seed}, "clauses"));
  for (std::size_t s = 1; s < commands.size(); ++s) {
    language::Command& command = commands[s];
    // drawn whether it is used or not: sentences do not depend on each other
    const bool chosen = rng.Bernoulli(share), relate = rng.Bernoulli(0.5), all = rng.Bernoulli(0.5);
    Rng own(MixSeed({seed, s}, "clause"));
    if (!chosen || !command.reference.empty() || !command.obstacle.empty()) continue;
    if (!relate || relations.empty()) {
      command.obstacle = all ? language::kEverythingElse : DrawObstacle(command.target, names, own);
      continue;
    }
    const TaskName& task = relations[own.Below(relations.size())];
    const std::string reference = DrawReference(*task.spec, command.target, names, own);
    if (!reference.empty()) command = {task.base, command.target, reference, ""};
  }
}

}  // namespace etude::data
