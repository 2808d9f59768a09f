// SPDX-License-Identifier: Apache-2.0
#include "trainer/data/sampler.h"

#include <algorithm>

#include "services/core/check.h"
#include "services/core/rng.h"

namespace etude::data {

std::vector<Sample> DrawBatch(const Snapshot& snapshot, Split split, std::uint64_t seed, std::uint64_t step, int batch,
                              int retry) {
  const auto& by_task = snapshot.frames(split);
  if (by_task.empty()) return {};
  std::vector<const std::vector<FrameRef>*> tasks;
  for (const auto& [task, refs] : by_task) tasks.push_back(&refs);

  std::vector<Sample> samples(static_cast<std::size_t>(batch));
  for (std::size_t b = 0; b < samples.size(); ++b) {
    const std::uint64_t number = step * samples.size() + b;
    samples[b].seed = MixSeed({seed, number, static_cast<std::uint64_t>(retry)}, "sample");
    const auto& refs = *tasks[number % tasks.size()];
    samples[b].frame = refs[Rng(samples[b].seed).Below(refs.size())];
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
      const auto index = snapshot.episodes()[frame.episode]->index;
      samples.push_back({frame, MixSeed({seed, index, frame.frame}, "spread")});
    }
  }
  return samples;
}

std::vector<language::Command> DrawCommands(const Episode& episode, const std::vector<std::string>& tasks,
                                            int sentences, std::uint64_t seed) {
  ETUDE_CHECK(sentences >= 1 && !tasks.empty());
  Rng rng(MixSeed({seed}, "commands"));
  std::vector<std::string> names;
  for (const auto& object : episode.objects)
    if (object.name != episode.target) names.push_back(object.name);
  rng.Shuffle(names);
  names.push_back(episode.target);

  std::vector<language::Command> commands{{episode.task, episode.target}};
  for (int s = 1; s < sentences; ++s)
    commands.push_back({tasks[rng.Below(tasks.size())], names[static_cast<std::size_t>(s - 1) % names.size()]});
  return commands;
}

}  // namespace etude::data
