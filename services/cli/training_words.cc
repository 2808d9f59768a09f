// SPDX-License-Identifier: Apache-2.0
#include "services/cli/training_words.h"

#include "services/bus/directory.h"
#include "services/core/identity.h"
#include "services/language/held_out.h"
#include "services/store/safetensors.h"

namespace etude::cli {
namespace {

using namespace std::chrono_literals;

constexpr auto kServerAppears = 2s;

// What is served from a file says that file; a server that follows a run has its checkpoints from the bus, and the run
// says its folder.
std::optional<std::string> CheckpointOf(bus::Directory& directory, const Selector& run) {
  const auto server = directory.Find(bus::PresenceKind::kPolicy, run, kServerAppears);
  if (!server || !*server) return std::nullopt;
  if (!(*server)->folder.empty())
    return (*server)->host == HostName() ? std::optional((*server)->folder) : std::nullopt;
  for (const auto& trainer : directory.Matching(bus::PresenceKind::kRun, {(*server)->name, (*server)->id}))
    if (trainer.host == HostName()) return (Path(trainer.folder) / "checkpoints" / "latest.safetensors").string();
  return std::nullopt;
}

}  // namespace

std::optional<std::set<std::string>> TrainingWordsOf(const std::string& checkpoint) {
  const auto bytes = ReadBinaryFile(checkpoint);
  if (!bytes) return std::nullopt;
  const auto content = store::DecodeSafetensors(*bytes, [](std::string_view) { return false; });
  if (!content || !content->metadata.contains("words")) return std::nullopt;
  return language::WordsIn(content->metadata.at("words"));
}

std::optional<std::set<std::string>> TrainingWords(const bus::Participant& participant, const std::string& run) {
  const auto selector = ParseSelector(run, "run");
  auto directory = bus::Directory::Open(participant);
  if (!selector || !directory) return std::nullopt;
  const auto file = CheckpointOf(*directory, *selector);
  return file ? TrainingWordsOf(*file) : std::nullopt;
}

}  // namespace etude::cli
