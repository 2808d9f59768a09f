// SPDX-License-Identifier: Apache-2.0
#include "services/cli/training_words.h"

#include <fcntl.h>

#include "services/bus/directory.h"
#include "services/core/descriptor.h"
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
  if (!server) return std::nullopt;
  if (*server && !(*server)->folder.empty())
    return (*server)->host == HostName() ? std::optional((*server)->folder) : std::nullopt;
  const Selector its_run = *server ? Selector{(*server)->name, (*server)->id} : run;
  for (const auto& trainer : directory.Matching(bus::PresenceKind::kRun, its_run))
    if (trainer.host == HostName()) return (Path(trainer.folder) / "checkpoints" / "latest.safetensors").string();
  return std::nullopt;
}

}  // namespace

std::optional<std::set<std::string>> TrainingWordsOf(const std::string& checkpoint) {
  const Descriptor file(::open(checkpoint.c_str(), O_RDONLY | O_CLOEXEC));
  if (file.get() < 0) return std::nullopt;
  const auto header = store::ReadSafetensorsHeader(file.get(), checkpoint);
  if (!header) return std::nullopt;
  const auto metadata = header->value("__metadata__", OrderedJson::object());
  if (!metadata.is_object() || !metadata.contains("words") || !metadata["words"].is_string()) return std::nullopt;
  return language::WordsIn(metadata["words"].get<std::string>());
}

std::optional<std::set<std::string>> TrainingWords(const bus::Participant& participant, const std::string& run) {
  const auto selector = ParseSelector(run, "run");
  auto directory = bus::Directory::Open(participant);
  if (!selector || !directory) return std::nullopt;
  const auto file = CheckpointOf(*directory, *selector);
  return file ? TrainingWordsOf(*file) : std::nullopt;
}

}  // namespace etude::cli
