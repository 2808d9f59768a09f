// SPDX-License-Identifier: Apache-2.0
// The programs, and the files that come with them: tasks, robots, objects.
#pragma once

#include <string>

#include "services/core/file.h"
#include "services/core/result.h"

namespace etude {

/// The file of the running program.
Path ProgramFile();
/// Its folder; its siblings (etude-worker, ...) lie beside it.
Path ProgramFolder();

/// The folder NAME of what comes with the programs: $ETUDE_SHARE/NAME when that variable is set; else the nearest
/// deploy/NAME (a source tree) or share/etude/NAME (an installation) above the running program.
/// @error kNotFound: neither is there; the message says where it was looked for
Result<Path> FindShared(const std::string& name);
/// The same for a given value of ETUDE_SHARE ("": not set) and a given program.
Result<Path> FindShared(const std::string& name, const std::string& share, const Path& program);

}  // namespace etude
