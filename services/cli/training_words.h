// SPDX-License-Identifier: Apache-2.0
// Which words the training of a policy said that is served on the bus.
#pragma once

#include <optional>
#include <set>
#include <string>

#include "services/bus/participant.h"

namespace etude::cli {

/// As the checkpoint that is served has them, or one of its run: they are the same in all of a run's. Nothing where
/// that cannot be known: nobody serves or trains it, its file is on another machine, or from before checkpoints had
/// words.
/// @param run  NAME or NAME@ID
std::optional<std::set<std::string>> TrainingWords(const bus::Participant& participant, const std::string& run);

/// Of one file. Nothing: it cannot be read, or says none.
std::optional<std::set<std::string>> TrainingWordsOf(const std::string& checkpoint);

}  // namespace etude::cli
