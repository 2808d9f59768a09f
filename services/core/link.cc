// SPDX-License-Identifier: Apache-2.0
#include "services/core/link.h"

namespace etude {

Status PointLink(const Path& link, const Path& target) {
  const Path temporary = link.string() + ".new";
  std::error_code error;
  std::filesystem::remove(temporary, error);
  std::filesystem::create_symlink(target, temporary, error);
  if (!error) std::filesystem::rename(temporary, link, error);
  if (error) return Fail(ErrnoError("point", link, error.value()));
  return SyncFolder(link.parent_path());
}

}  // namespace etude
