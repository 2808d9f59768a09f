// SPDX-License-Identifier: Apache-2.0
// Where the programs that tests start lie.
#pragma once

#include <cstdlib>

#include "services/core/share.h"

namespace etude {

/// $ETUDE_BIN; without it bin/ of the build that this program is of.
inline Path ProgramsFolder() {
  const char* folder = std::getenv("ETUDE_BIN");
  return folder ? Path(folder) : ProgramFolder().parent_path() / "bin";
}

}  // namespace etude
