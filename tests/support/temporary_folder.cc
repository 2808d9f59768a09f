// SPDX-License-Identifier: Apache-2.0
#include "tests/support/temporary_folder.h"

#include <fmt/format.h>
#include <signal.h>
#include <stdlib.h>
#include <unistd.h>

#include <cerrno>
#include <string>

#include "services/core/check.h"

namespace etude {
namespace {

constexpr std::string_view kPrefix = "etude-test-";

}  // namespace

void RemoveFoldersOfTheDead() {
  std::error_code ignored;
  for (const auto& entry : std::filesystem::directory_iterator(std::filesystem::temp_directory_path(), ignored)) {
    const std::string name = entry.path().filename().string();
    if (!name.starts_with(kPrefix)) continue;
    const int pid = std::atoi(name.c_str() + kPrefix.size());
    if (pid > 0 && ::kill(pid, 0) != 0 && errno == ESRCH) std::filesystem::remove_all(entry.path(), ignored);
  }
}

TemporaryFolder::TemporaryFolder() {
  static const bool cleaned = (RemoveFoldersOfTheDead(), true);
  ETUDE_CHECK(cleaned);
  std::string name =
      (std::filesystem::temp_directory_path() / fmt::format("{}{}-XXXXXX", kPrefix, ::getpid())).string();
  ETUDE_CHECK(::mkdtemp(name.data()) != nullptr, "mkdtemp '{}'", name);
  path_ = name;
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

}  // namespace etude
