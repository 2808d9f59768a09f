// SPDX-License-Identifier: Apache-2.0
#include "services/core/file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <utility>

#include "services/core/append.h"
#include "services/core/crash_point.h"
#include "services/core/descriptor.h"
#include "services/core/identity.h"

namespace etude {
namespace {

std::span<const std::uint8_t> BytesOf(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

// To its end: a pipe has no size, and one of the kernel's files says 0.
template <class Container>
Result<Container> ReadStream(int fd, const Path& path, std::uint64_t max_bytes) {
  Container content;
  char block[1 << 16];
  while (true) {
    const ssize_t got = ::read(fd, block, sizeof block);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return Fail(ErrnoError("read", path, errno));
    if (got == 0) return content;
    content.insert(content.end(), block, block + got);
    if (content.size() > max_bytes)
      return Fail(Code::kExhausted,
                  fmt::format("read '{}': more than the limit of {} bytes", path.string(), max_bytes));
  }
}

template <class Container>
Result<Container> ReadWhole(const Path& path, std::uint64_t max_bytes) {
  Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (file.get() < 0) return Fail(ErrnoError("open", path, errno));
  struct stat info {};
  if (::fstat(file.get(), &info) != 0) return Fail(ErrnoError("stat", path, errno));
  if (static_cast<std::uint64_t>(info.st_size) > max_bytes)
    return Fail(Code::kExhausted,
                fmt::format("read '{}': {} bytes, more than the limit of {}", path.string(), info.st_size, max_bytes));
  if (info.st_size == 0) return ReadStream<Container>(file.get(), path, max_bytes);
  Container content;
  content.resize(static_cast<std::size_t>(info.st_size));
  const std::span<std::uint8_t> bytes(reinterpret_cast<std::uint8_t*>(content.data()), content.size());
  ETUDE_ASSIGN_OR_RETURN(const std::size_t size, ReadAt(file.get(), path, 0, bytes));
  content.resize(size);
  return content;
}

// A pipe, a terminal, /dev/null: what is renamed over it would be a file from then on. So would /dev/stdout be.
bool IsDevice(const Path& path, const struct stat& there) {
  if (S_ISDIR(there.st_mode)) return false;
  return !S_ISREG(there.st_mode) || path.lexically_normal().parent_path() == "/dev";
}

Status WriteInto(const Path& path, const struct stat& there, const std::function<Status(int fd)>& write) {
  std::fflush(stdout);
  // a file that is our own stdout has a place where what is written goes on
  for (const int fd : {STDOUT_FILENO, STDERR_FILENO}) {
    struct stat ours {};
    if (::fstat(fd, &ours) == 0 && ours.st_dev == there.st_dev && ours.st_ino == there.st_ino) return write(fd);
  }
  const Descriptor device(::open(path.c_str(), O_WRONLY | O_APPEND | O_CLOEXEC));
  if (device.get() < 0) return Fail(ErrnoError("open", path, errno));
  return write(device.get());
}

}  // namespace

Error ErrnoError(std::string_view attempted, const Path& path, int error_number) {
  Code code = Code::kInternal;
  switch (error_number) {
    case ENOENT:
      code = Code::kNotFound;
      break;
    case ENOSPC:
    case EDQUOT:
    case EFBIG:  // beyond the limit of the process or the file system: as full as a full disk
    case EROFS:
    case EACCES:
    case EPERM:
    case EIO:
    case EMFILE:
    case ENFILE:
    case ENOMEM:
    case EAGAIN:
    case ESTALE:  // a network file system's server came back
    case ETIMEDOUT:
    case ENOTCONN:      // whoever serves a file system of FUSE has gone
    case ECONNABORTED:  // ... while it was asked
    case EHOSTDOWN:
      code = Code::kUnavailable;
      break;
    default:
      break;
  }
  return {code, fmt::format("{} '{}': {}", attempted, path.string(), std::strerror(error_number))};
}

Result<std::size_t> ReadAt(int fd, const Path& path, std::uint64_t offset, std::span<std::uint8_t> bytes) {
  std::size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t got = ::pread(fd, bytes.data() + done, bytes.size() - done, static_cast<off_t>(offset + done));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return Fail(ErrnoError("read", path, errno));
    if (got == 0) break;
    done += static_cast<std::size_t>(got);
  }
  return done;
}

Status WriteAll(int fd, const Path& path, std::span<const std::uint8_t> bytes) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(fd, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return Fail(ErrnoError("write", path, written < 0 ? errno : EIO));
    bytes = bytes.subspan(static_cast<std::size_t>(written));
  }
  return {};
}

Status WriteAll(int fd, const Path& path, std::string_view text) { return WriteAll(fd, path, BytesOf(text)); }

Status WriteSecret(const Path& path, std::string_view text) {
  const Descriptor file(::open(path.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0600));
  if (!file && errno == EEXIST)
    return Fail(Code::kUnavailable,
                fmt::format("'{}' is there already, and a secret is not overwritten", path.string()));
  if (!file) return Fail(ErrnoError("create", path, errno));
  Status written = WriteAll(file.get(), path, BytesOf(text));
  if (written && ::fsync(file.get()) != 0) written = Fail(ErrnoError("fsync", path, errno));
  if (written) return SyncFolder(path.parent_path());
  ::unlink(path.c_str());  // half a key would only be in the way of the next attempt
  return written;
}

Result<std::string> ReadTextFile(const Path& path, std::uint64_t max_bytes) {
  return ReadWhole<std::string>(path, max_bytes);
}

Result<std::vector<std::uint8_t>> ReadBinaryFile(const Path& path, std::uint64_t max_bytes) {
  return ReadWhole<std::vector<std::uint8_t>>(path, max_bytes);
}

Result<std::optional<std::string>> ReadTextFileIfThere(const Path& path, std::uint64_t max_bytes) {
  auto text = ReadTextFile(path, max_bytes);
  if (text) return std::optional(std::move(*text));
  if (text.error().code == Code::kNotFound) return std::optional<std::string>();
  return Fail(std::move(text).error());
}

Status MakeFolders(const Path& folder) {
  std::error_code error;
  if (folder.empty() || std::filesystem::is_directory(folder, error)) return {};
  // what cannot be asked (a file system that is away) is not to be made: mkdir would say that it exists
  if (error && error != std::errc::no_such_file_or_directory && error != std::errc::not_a_directory)
    return Fail(ErrnoError("look for folder", folder, error.value()));
  if (!folder.has_filename()) return MakeFolders(folder.parent_path());  // "a/" is "a"
  ETUDE_RETURN_IF_ERROR(MakeFolders(folder.parent_path()));
  std::filesystem::create_directory(folder, error);
  if (error) return Fail(ErrnoError("make folder", folder, error.value()));
  // a folder whose entry is not on the disk takes all that is in it along
  return SyncFolder(folder.parent_path());
}

Status SyncFolder(const Path& folder) {
  const Path name = folder.empty() ? Path(".") : folder;
  Descriptor handle(::open(name.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (handle.get() < 0) return Fail(ErrnoError("open folder", name, errno));
  if (::fsync(handle.get()) != 0) return Fail(ErrnoError("fsync folder", name, errno));
  return {};
}

Status SyncFile(const Path& path) {
  Descriptor handle(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (handle.get() < 0) return Fail(ErrnoError("open", path, errno));
  if (::fsync(handle.get()) != 0) return Fail(ErrnoError("fsync", path, errno));
  return {};
}

Status WriteFileAtomically(const Path& path, std::span<const std::uint8_t> bytes) {
  return WriteFileAtomically(path, [&](int fd) { return WriteAll(fd, path, bytes); });
}

Status WriteFileAtomically(const Path& path, const std::function<Status(int fd)>& write) {
  struct stat there {};
  if (::stat(path.c_str(), &there) == 0 && IsDevice(path, there)) return WriteInto(path, there, write);
  ETUDE_RETURN_IF_ERROR(MakeFolders(path.parent_path()));
  // threads share a pid, and so do containers on one volume
  const Path temporary = path.string() + fmt::format(".tmp-{}-{:.8}", ::getpid(), NewId());
  {
    Descriptor file(::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644));
    if (file.get() < 0) return Fail(ErrnoError("create", temporary, errno));
    Status written = write(file.get());
    CrashPoint("file.written");
    if (written && ::fsync(file.get()) != 0) written = Fail(ErrnoError("write", path, errno));
    if (!written) {
      ::unlink(temporary.c_str());
      return written;
    }
  }
  CrashPoint("file.synced");
  if (::rename(temporary.c_str(), path.c_str()) != 0) {
    const int error_number = errno;
    ::unlink(temporary.c_str());
    return Fail(ErrnoError("rename to", path, error_number));
  }
  CrashPoint("file.renamed");
  return SyncFolder(path.parent_path());
}

Status WriteFileAtomically(const Path& path, std::string_view text) { return WriteFileAtomically(path, BytesOf(text)); }

Result<LineAppender> LineAppender::Open(const Path& path) {
  ETUDE_RETURN_IF_ERROR(MakeFolders(path.parent_path()));
  const int fd = ::open(path.c_str(), O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
  if (fd < 0) return Fail(ErrnoError("open", path, errno));
  return LineAppender(path, fd);
}

Status LineAppender::Append(std::string_view line) {
  struct stat info {};
  if (::fstat(file_.get(), &info) != 0) return Fail(ErrnoError("stat", path_, errno));
  // what a crash, or a write that was cut short, left without an end is ended here, so that this line stands alone
  char last = '\n';
  const bool torn = info.st_size > 0 && ::pread(file_.get(), &last, 1, info.st_size - 1) == 1 && last != '\n';
  std::string text = torn ? "\n" : "";
  text += line;
  text += '\n';
  return AppendWhole(file_.get(), path_, BytesOf(text));
}

Status LineAppender::Sync() const {
  if (::fsync(file_.get()) != 0) return Fail(ErrnoError("fsync", path_, errno));
  return {};
}

Result<LineAppender> LineAppender::Duplicate() const {
  const int fd = ::fcntl(file_.get(), F_DUPFD_CLOEXEC, 0);
  if (fd < 0) return Fail(ErrnoError("open once more", path_, errno));
  return LineAppender(path_, fd);
}

std::string StampOf(std::span<const Path> files) {
  std::string stamp;
  for (const Path& file : files) {
    std::error_code error;
    stamp += fmt::format("{} {} ", std::filesystem::last_write_time(file, error).time_since_epoch().count(),
                         std::filesystem::file_size(file, error));
  }
  return stamp;
}

bool IsPlainName(std::string_view name) {
  return !name.empty() && name.size() <= 64 && std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
  });
}

}  // namespace etude
