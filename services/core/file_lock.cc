// SPDX-License-Identifier: Apache-2.0
#include "services/core/file_lock.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <string>

#include "services/core/identity.h"

namespace etude {

Result<FileLock> FileLock::Take(const Path& file, std::string_view what) {
  const int fd = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (fd < 0) return Fail(ErrnoError("open", file, errno));
  FileLock lock{Descriptor(fd)};
  if (::flock(fd, LOCK_EX | LOCK_NB) != 0) {
    if (errno != EWOULDBLOCK) return Fail(ErrnoError("lock", file, errno));
    std::array<char, 128> owner{};
    const ssize_t size = ::pread(fd, owner.data(), owner.size(), 0);
    return Fail(Code::kUnavailable,
                fmt::format("{} by another process ({}); stop it first", what,
                            std::string_view(owner.data(), static_cast<std::size_t>(std::max<ssize_t>(size, 0)))));
  }
  const std::string owner = fmt::format("pid {} on {}", ::getpid(), HostName());

  // only for the message above; a full disk must not keep anyone out
  if (::ftruncate(fd, 0) == 0) (void)!::pwrite(fd, owner.data(), owner.size(), 0);
  return lock;
}

}  // namespace etude
