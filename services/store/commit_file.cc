// SPDX-License-Identifier: Apache-2.0
#include "services/store/commit_file.h"

#include <fcntl.h>
#include <sys/uio.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <map>
#include <string>
#include <utility>

#include "services/core/crash_point.h"
#include "services/core/descriptor.h"
#include "services/core/thread_annotations.h"

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

// errno, or 0
int WriteAll(int fd, const std::vector<std::span<const std::uint8_t>>& pieces) {
  constexpr std::size_t kMostAtOnce = 512;  // below IOV_MAX
  std::size_t at = 0, skip = 0;             // the piece that is next, and how much of it is written
  std::vector<iovec> vectors;
  while (at < pieces.size()) {
    vectors.clear();
    for (std::size_t i = at; i < pieces.size() && vectors.size() < kMostAtOnce; ++i) {
      const auto rest = pieces[i].subspan(i == at ? skip : 0);
      vectors.push_back({const_cast<std::uint8_t*>(rest.data()), rest.size()});
    }
    const ssize_t written = ::writev(fd, vectors.data(), static_cast<int>(vectors.size()));
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return errno;
    std::size_t left = static_cast<std::size_t>(written);
    while (at < pieces.size() && left >= pieces[at].size() - skip) {
      left -= pieces[at++].size() - skip;
      skip = 0;
    }
    skip += left;
  }
  return 0;
}

// A folder that another thread has just made may not be durable yet: whoever comes second waits until it is.
Status MakeDurableFolders(const Path& folder) {
  static Mutex making;
  const MutexLock lock(making);
  return MakeFolders(folder);
}

// A file on its way; its temporary one goes when it does not arrive.
class Pending {
 public:
  explicit Pending(const FileToCommit& file)
      : path_(file.path), temporary_(file.path.string() + std::string(kTemporarySuffix)) {
    status_ = Write(file);
  }

  void Sync() {
    if (!file_) return;
    int error_number = ::fsync(file_.get()) == 0 ? 0 : errno;
    if (::close(file_.release()) != 0 && error_number == 0) error_number = errno;
    if (error_number != 0) return Abandon(ErrnoError("write", path_, error_number));
    Reach(CommitPoint::kSynced);
  }
  void Rename() {
    if (!status_) return;
    if (::rename(temporary_.c_str(), path_.c_str()) != 0) return Abandon(ErrnoError("write", path_, errno));
    Reach(CommitPoint::kRenamed);
  }
  // It was renamed, but its folder's entry is not durable: it must not look committed.
  void TakeBack(const Error& error) {
    if (!status_) return;
    ::unlink(path_.c_str());
    status_ = Fail(error);
  }
  const Status& status() const { return status_; }
  Path folder() const { return path_.parent_path(); }

 private:
  Status Write(const FileToCommit& file) {
    ETUDE_RETURN_IF_ERROR(MakeDurableFolders(path_.parent_path()));
    file_.reset(::open(temporary_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644));
    if (!file_) return Fail(ErrnoError("create", temporary_, errno));
    Reach(CommitPoint::kCreated);
    if (const int error_number = WriteAll(file_.get(), file.pieces); error_number != 0) {
      file_.reset();
      ::unlink(temporary_.c_str());
      return Fail(ErrnoError("write", path_, error_number));
    }
    Reach(CommitPoint::kWritten);
    // the disk begins with it while the next one is written; only a hint
    (void)!::sync_file_range(file_.get(), 0, 0, SYNC_FILE_RANGE_WRITE);
    return {};
  }
  void Abandon(const Error& error) {
    ::unlink(temporary_.c_str());
    status_ = Fail(error);
  }

  Path path_, temporary_;
  Descriptor file_;
  Status status_;
};

}  // namespace

void SetCommitProbe(std::function<void(CommitPoint)> probe) { commit_probe = std::move(probe); }

std::vector<Status> CommitFiles(std::span<const FileToCommit> files) {
  std::vector<Pending> pending;
  pending.reserve(files.size());
  for (const auto& file : files) pending.emplace_back(file);
  for (auto& file : pending) file.Sync();
  for (auto& file : pending) file.Rename();
  std::map<Path, Status> folders;
  for (const auto& file : pending)
    if (file.status() && !folders.contains(file.folder())) folders.emplace(file.folder(), SyncFolder(file.folder()));
  std::vector<Status> statuses;
  for (auto& file : pending) {
    if (const auto folder = folders.find(file.folder()); folder != folders.end() && !folder->second)
      file.TakeBack(folder->second.error());
    if (file.status()) Reach(CommitPoint::kDone);
    statuses.push_back(file.status());
  }
  return statuses;
}

}  // namespace etude::store::internal
