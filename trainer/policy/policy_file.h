// SPDX-License-Identifier: Apache-2.0
// Finds and reads the files that policies and experiments are made of, see trainer/experiments. No torch here.
#pragma once

#include <string>
#include <vector>

#include "services/core/config.h"
#include "services/core/file.h"

namespace etude::policy {

/// The folder of the experiments: `share`/experiments when `share` is given, else the nearest
/// trainer/experiments or share/etude/experiments above `executable`. @error kNotFound.
Result<Path> FindExperiments(const std::string& share, const Path& executable);
/// The same for ETUDE_SHARE and the running program.
Result<Path> FindExperiments();

/// `name_or_file`: a path, or NAME of FOLDER/NAME.yaml ("compact", "compact/obstacle").
/// @param what  it is, for the message @error kInvalidArgument with the names there are
Result<Path> FindNamedFile(const std::string& name_or_file, const std::vector<Path>& folders, const std::string& what);

/// @error of reading and parsing
Result<OrderedJson> ReadYamlMap(const Path& path);

/// In a policy's map: `language: clip:DIR` written out, as `language: {encoder: clip:DIR}`.
void WriteOutLanguage(OrderedJson& policy);

/// The map of a policy's file, put on top of the one that it `extends`, which is looked for beside it first;
/// `language` is written out.
/// @error as FindNamedFile; kInvalidArgument: extends itself
Result<OrderedJson> ReadPolicyMap(const std::string& name_or_file, const std::vector<Path>& folders);

}  // namespace etude::policy
