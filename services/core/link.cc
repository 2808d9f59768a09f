// SPDX-License-Identifier: Apache-2.0
#include "services/core/link.h"

#include <fmt/format.h>
#include <unistd.h>

#include "services/core/identity.h"

namespace etude {

Status PointLink(const Path& link, const Path& target) {
  const Path temporary = link.string() + fmt::format(".tmp-{}-{:.8}", ::getpid(), NewId());  // as of files
  std::error_code error, ignored;
  std::filesystem::create_symlink(target, temporary, error);
  if (!error) std::filesystem::rename(temporary, link, error);
  if (error) std::filesystem::remove(temporary, ignored);
  if (error) return Fail(ErrnoError("point", link, error.value()));
  return SyncFolder(link.parent_path());
}

}  // namespace etude
