// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>
#include <sys/types.h>

#include <filesystem>
#include <fstream>
#include <system_error>
#include <vector>

namespace etude {

/// The processes whose parent it is.
inline std::vector<pid_t> ChildrenOf(pid_t parent) {
  std::vector<pid_t> children;
  std::error_code error;
  for (const auto& task : std::filesystem::directory_iterator(fmt::format("/proc/{}/task", parent), error)) {
    std::ifstream pids(task.path() / "children");  // its size is said to be 0
    for (pid_t pid = 0; pids >> pid;) children.push_back(pid);
  }
  return children;
}

}  // namespace etude
