// SPDX-License-Identifier: Apache-2.0
#include "services/store/commit_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <string>
#include <utility>

#include "services/core/crash_point.h"

namespace etude::store::internal {
namespace {

std::function<void(CommitPoint)> commit_probe;

constexpr std::string_view NameOf(CommitPoint point) {
  switch (point) {
    case CommitPoint::kCreated:
      return "commit.created";
    case CommitPoint::kWritten:
      return "commit.written";
    case CommitPoint::kSynced:
      return "commit.synced";
    case CommitPoint::kRenamed:
      return "commit.renamed";
    case CommitPoint::kDone:
      break;
  }
  return "commit.done";
}

void Reach(CommitPoint point) {
  CrashPoint(NameOf(point));
  if (commit_probe) commit_probe(point);
}

int WriteAndSync(int fd, std::span<const std::uint8_t> bytes) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(fd, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return errno;
    bytes = bytes.subspan(static_cast<std::size_t>(written));
  }
  Reach(CommitPoint::kWritten);
  return ::fsync(fd) == 0 ? 0 : errno;
}

}  // namespace

void SetCommitProbe(std::function<void(CommitPoint)> probe) { commit_probe = std::move(probe); }

Status CommitFile(const Path& path, std::span<const std::uint8_t> bytes) {
  ETUDE_RETURN_IF_ERROR(MakeFolders(path.parent_path()));
  const Path temporary = path.string() + std::string(kTemporarySuffix);
  const int fd = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (fd < 0) return Fail(ErrnoError("create", temporary, errno));
  Reach(CommitPoint::kCreated);
  int error_number = WriteAndSync(fd, bytes);
  if (::close(fd) != 0 && error_number == 0) error_number = errno;
  Reach(CommitPoint::kSynced);
  if (error_number == 0 && ::rename(temporary.c_str(), path.c_str()) != 0) error_number = errno;
  if (error_number != 0) {
    ::unlink(temporary.c_str());
    return Fail(ErrnoError("write", path, error_number));
  }
  Reach(CommitPoint::kRenamed);
  if (Status synced = SyncFolder(path.parent_path()); !synced) {
    ::unlink(path.c_str());  // not durable, so it must not look committed
    return synced;
  }
  Reach(CommitPoint::kDone);
  return {};
}

}  // namespace etude::store::internal
