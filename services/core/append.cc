// SPDX-License-Identifier: Apache-2.0
#include "services/core/append.h"

#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>

#include "services/core/log.h"

namespace etude {

Status AppendWhole(int fd, const Path& path, std::span<const std::uint8_t> bytes) {
  struct stat before {};
  if (::fstat(fd, &before) != 0) return Fail(ErrnoError("look at", path, errno));
  Status written = WriteAll(fd, path, bytes);
  if (!written && ::ftruncate(fd, before.st_size) != 0) Log().warn("{}", ErrnoError("cut", path, errno).message);
  return written;
}

}  // namespace etude
