// SPDX-License-Identifier: Apache-2.0
// What a run's folder is called on the bus, and which checkpoint it stands for. The name is for people; the id is the
// folder's (identity.h).
#pragma once

#include <string>
#include <string_view>

#include "services/core/file.h"
#include "services/core/identity.h"
#include "services/core/result.h"

namespace etude {

/// "Out/My Run" -> "my-run": a plain name for a folder.
std::string PlainNameOf(const Path& folder);

/// The name that KeepRunName left in `folder`; where there is none, PlainNameOf.
std::string RunNameOf(const Path& folder);
/// Durable. @pre IsPlainName(name) @error kUnavailable of the disk
Status KeepRunName(const Path& folder, const std::string& name);

/// The run that is meant by NAME, NAME@ID, or a run's folder, which knows both. A text that is a name and also the
/// folder of a run with another name means the folder (logged); of a run with that name, the name.
/// @param what  for the error: "--subscribe" @error kInvalidArgument: none of these; kNotFound: the folder has no id
Result<Selector> ParseRun(const std::string& text, std::string_view what);

/// For options that want a checkpoint: of a run's folder its newest one, RUN/checkpoints/latest.safetensors; else
/// `text`.
std::string CheckpointFile(const std::string& text);

}  // namespace etude
