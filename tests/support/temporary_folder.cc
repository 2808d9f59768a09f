// SPDX-License-Identifier: Apache-2.0
#include "tests/support/temporary_folder.h"

#include <fmt/format.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include "services/core/check.h"

namespace etude {
namespace {

constexpr std::string_view kPrefix = "etude-test-";
constexpr std::chrono::hours kLongestScript{24};

// "ns4026531836-", by the inode of this process's namespace of process ids: containers that share a temporary folder
// have others, where a number means another process or none.
std::string Namespace() {
  struct stat info {};
  ETUDE_CHECK(::stat("/proc/self/ns/pid", &info) == 0, "stat /proc/self/ns/pid errno={}", errno);
  return fmt::format("ns{}-", static_cast<std::uint64_t>(info.st_ino));
}

// Of "PID-*", where PID is of this namespace.
bool IsOfTheDead(const char* text) {
  const int pid = std::atoi(text);
  return pid > 0 && ::kill(pid, 0) != 0 && errno == ESRCH;
}

bool IsLeft(const Path& path, const std::string& own) {
  const std::string name = path.filename().string();
  if (!name.starts_with(kPrefix)) return false;
  const std::string rest = name.substr(kPrefix.size());
  if (rest.starts_with(own)) return IsOfTheDead(rest.c_str() + own.size());
  // a script's does not say of which namespace it is: of one that lives elsewhere it is not as old as this
  std::error_code error;
  const auto written = std::filesystem::last_write_time(path, error);
  return !error && IsOfTheDead(rest.c_str()) &&
         std::filesystem::file_time_type::clock::now() - written > kLongestScript;
}

}  // namespace

void RemoveFoldersOfTheDead() {
  const std::string own = Namespace();
  std::error_code error, ignored;  // others remove theirs meanwhile
  const Path temporary = std::filesystem::temp_directory_path();
  for (std::filesystem::directory_iterator it(temporary, error), end; !error && it != end; it.increment(error))
    if (IsLeft(it->path(), own)) std::filesystem::remove_all(it->path(), ignored);
}

TemporaryFolder::TemporaryFolder() {
  static const bool cleaned = (RemoveFoldersOfTheDead(), true);
  ETUDE_CHECK(cleaned);
  std::string name =
      (std::filesystem::temp_directory_path() / fmt::format("{}{}{}-XXXXXX", kPrefix, Namespace(), ::getpid()))
          .string();
  ETUDE_CHECK(::mkdtemp(name.data()) != nullptr, "mkdtemp '{}'", name);
  path_ = name;
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

}  // namespace etude
