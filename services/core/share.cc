// SPDX-License-Identifier: Apache-2.0
#include "services/core/share.h"

#include <fmt/format.h>

#include <cstdlib>

namespace etude {

Path ProgramFile() {
  std::error_code error;
  Path file = std::filesystem::read_symlink("/proc/self/exe", error);
  return error ? Path("etude") : file;
}

Path ProgramFolder() { return ProgramFile().parent_path(); }

Result<Path> FindShared(const std::string& name, const std::string& share, const Path& program) {
  std::error_code ignored;
  if (!share.empty()) {
    const Path folder = Path(share) / name;
    if (std::filesystem::is_directory(folder, ignored)) return folder;
    return Fail(Code::kNotFound, fmt::format("ETUDE_SHARE is '{}', which has no folder '{}'", share, name));
  }
  for (Path folder = std::filesystem::absolute(program, ignored).parent_path();; folder = folder.parent_path()) {
    for (const char* parent : {"deploy", "share/etude"})
      if (std::filesystem::is_directory(folder / parent / name, ignored)) return folder / parent / name;
    if (folder == folder.parent_path()) break;
  }
  return Fail(Code::kNotFound,
              fmt::format("no deploy/{0} or share/etude/{0} above '{1}': set ETUDE_SHARE to the folder that has '{0}'",
                          name, program.string()));
}

Result<Path> FindShared(const std::string& name) {
  const char* share = std::getenv("ETUDE_SHARE");
  return FindShared(name, share ? share : "", ProgramFile());
}

}  // namespace etude
