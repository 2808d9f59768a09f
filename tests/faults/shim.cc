// SPDX-License-Identifier: Apache-2.0
// Preloaded into a program under test (LD_PRELOAD): a disk that fails, a record of what reaches it, a wall clock that
// jumps. Only files below ETUDE_SHIM_FOLDER are concerned.
//
//   ETUDE_SHIM_FAIL=CALL:ERRNO:FROM:COUNT  CALL is write, fsync or rename, ERRNO EIO or ENOSPC: the FROM-th call (from
//   1)
//                                          and the COUNT - 1 after it fail
//   ETUDE_SHIM_TRACE=FILE                  appends each operation that succeeded (disk_model.h reads it)
//   ETUDE_SHIM_CLOCK=FILE                  8 bytes, a double: seconds that CLOCK_REALTIME is off; may change any time
//
// Several processes may share a trace: each record is one append. No C++ runtime is used beyond the language.
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

namespace {

template <class Function>
Function* Real(const char* name) {
  return reinterpret_cast<Function*>(::dlsym(RTLD_NEXT, name));
}

const char* Folder() {
  static const char* folder = ::getenv("ETUDE_SHIM_FOLDER");
  return folder;
}

// The part of `path` below the folder, or null. Paths are absolute or found through /proc.
const char* Below(const char* path) {
  const char* folder = Folder();
  if (folder == nullptr || path == nullptr) return nullptr;
  const size_t size = ::strlen(folder);
  if (::strncmp(path, folder, size) != 0 || path[size] != '/') return nullptr;
  return path + size + 1;
}

// Of an open file.
const char* BelowOf(int fd, char (&buffer)[PATH_MAX]) {
  char link[64];
  ::snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
  const ssize_t size = ::readlink(link, buffer, sizeof buffer - 1);
  if (size <= 0) return nullptr;
  buffer[size] = 0;
  const char* folder = Folder();
  if (folder != nullptr && ::strcmp(buffer, folder) == 0) return "";
  return Below(buffer);
}

unsigned long long InodeOf(int fd) {
  struct stat info {};
  return ::fstat(fd, &info) == 0 ? info.st_ino : 0;
}

// "KIND a b size path\n" and `size` bytes, in one append
void Trace(char kind, unsigned long long a, unsigned long long b, const char* path, const void* data, size_t size) {
  static const char* file = ::getenv("ETUDE_SHIM_TRACE");
  if (file == nullptr || path == nullptr) return;
  static const int fd =
      static_cast<int>(::syscall(SYS_openat, AT_FDCWD, file, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644));
  char head[PATH_MAX + 128];
  const int length = ::snprintf(head, sizeof head, "%c %llu %llu %zu %s\n", kind, a, b, size, path);
  const iovec parts[2] = {{head, static_cast<size_t>(length)}, {const_cast<void*>(data), size}};
  const int saved = errno;
  (void)::syscall(SYS_writev, fd, parts, 2);
  errno = saved;
}

// Counts calls of the kind that ETUDE_SHIM_FAIL names; true: this one fails, errno is set.
bool Fails(const char* call) {
  static char wanted[16], error_name[16];
  static long from = 0, count = 0;
  static const bool armed = [] {
    const char* text = ::getenv("ETUDE_SHIM_FAIL");
    return text != nullptr && ::sscanf(text, "%15[^:]:%15[^:]:%ld:%ld", wanted, error_name, &from, &count) == 4;
  }();
  if (!armed || ::strcmp(call, wanted) != 0) return false;
  static long calls = 0;
  const long number = __atomic_add_fetch(&calls, 1, __ATOMIC_SEQ_CST);
  if (number < from || number >= from + count) return false;
  errno = ::strcmp(error_name, "ENOSPC") == 0 ? ENOSPC : EIO;
  return true;
}

int Opened(int fd, int flags) {
  char buffer[PATH_MAX];
  if (fd >= 0 && (flags & (O_CREAT | O_TRUNC)) != 0) {
    const char* path = BelowOf(fd, buffer);
    if (path != nullptr) Trace('C', InodeOf(fd), (flags & O_TRUNC) != 0, path, nullptr, 0);
  }
  return fd;
}

// Seconds that the wall clock is off by now.
time_t ClockOffset() {
  static const volatile double* const offset = []() -> const double* {
    const char* file = ::getenv("ETUDE_SHIM_CLOCK");
    const int fd = file == nullptr ? -1 : static_cast<int>(::syscall(SYS_openat, AT_FDCWD, file, O_RDONLY | O_CLOEXEC));
    if (fd < 0) return nullptr;
    void* const page = ::mmap(nullptr, sizeof(double), PROT_READ, MAP_SHARED, fd, 0);
    ::close(fd);
    return page == MAP_FAILED ? nullptr : static_cast<const double*>(page);
  }();
  return offset == nullptr ? 0 : static_cast<time_t>(*offset);
}

mode_t ModeOf(int flags, va_list arguments) {
  return (flags & (O_CREAT | O_TMPFILE)) != 0 ? static_cast<mode_t>(va_arg(arguments, int)) : 0;
}

}  // namespace

extern "C" {

int open(const char* path, int flags, ...) {
  va_list arguments;
  va_start(arguments, flags);
  const mode_t mode = ModeOf(flags, arguments);
  va_end(arguments);
  return Opened(static_cast<int>(::syscall(SYS_openat, AT_FDCWD, path, flags, mode)), flags);
}

int open64(const char* path, int flags, ...) {
  va_list arguments;
  va_start(arguments, flags);
  const mode_t mode = ModeOf(flags, arguments);
  va_end(arguments);
  return Opened(static_cast<int>(::syscall(SYS_openat, AT_FDCWD, path, flags, mode)), flags);
}

int openat(int folder, const char* path, int flags, ...) {
  va_list arguments;
  va_start(arguments, flags);
  const mode_t mode = ModeOf(flags, arguments);
  va_end(arguments);
  return Opened(static_cast<int>(::syscall(SYS_openat, folder, path, flags, mode)), flags);
}

ssize_t write(int fd, const void* data, size_t size) {
  char buffer[PATH_MAX];
  const char* path = Folder() == nullptr || fd <= 2 ? nullptr : BelowOf(fd, buffer);
  if (path != nullptr && Fails("write")) return -1;
  const ssize_t written = ::syscall(SYS_write, fd, data, size);
  if (path != nullptr && written > 0) {
    const off_t end = ::lseek(fd, 0, SEEK_CUR);
    Trace('W', InodeOf(fd), static_cast<unsigned long long>(end - written), path, data, static_cast<size_t>(written));
  }
  return written;
}

ssize_t pwrite(int fd, const void* data, size_t size, off_t offset) {
  char buffer[PATH_MAX];
  const char* path = Folder() == nullptr ? nullptr : BelowOf(fd, buffer);
  if (path != nullptr && Fails("write")) return -1;
  const ssize_t written = ::syscall(SYS_pwrite64, fd, data, size, offset);
  if (path != nullptr && written > 0)
    Trace('W', InodeOf(fd), static_cast<unsigned long long>(offset), path, data, static_cast<size_t>(written));
  return written;
}

ssize_t pwrite64(int fd, const void* data, size_t size, off_t offset) { return pwrite(fd, data, size, offset); }

ssize_t writev(int fd, const iovec* parts, int count) {
  // as single writes: what a trace says is then exact
  ssize_t sum = 0;
  char buffer[PATH_MAX];
  if (Folder() == nullptr || BelowOf(fd, buffer) == nullptr) return ::syscall(SYS_writev, fd, parts, count);
  for (int i = 0; i < count; ++i) {
    const ssize_t written = write(fd, parts[i].iov_base, parts[i].iov_len);
    if (written < 0) return sum > 0 ? sum : -1;
    sum += written;
    if (static_cast<size_t>(written) < parts[i].iov_len) break;
  }
  return sum;
}

int ftruncate(int fd, off_t size) {
  char buffer[PATH_MAX];
  const int result = static_cast<int>(::syscall(SYS_ftruncate, fd, size));
  const char* path = result == 0 ? BelowOf(fd, buffer) : nullptr;
  if (path != nullptr) Trace('T', InodeOf(fd), static_cast<unsigned long long>(size), path, nullptr, 0);
  return result;
}

int fsync(int fd) {
  char buffer[PATH_MAX];
  const char* path = BelowOf(fd, buffer);
  if (path != nullptr && Fails("fsync")) return -1;
  struct stat info {};
  const bool folder = path != nullptr && ::fstat(fd, &info) == 0 && S_ISDIR(info.st_mode);
  // what other threads do from here on may not be in it
  const auto thread = static_cast<unsigned long long>(::syscall(SYS_gettid));
  Trace(folder ? 'd' : 's', info.st_ino, thread, path, nullptr, 0);
  const int result = static_cast<int>(::syscall(SYS_fsync, fd));
  if (result == 0) Trace(folder ? 'D' : 'S', info.st_ino, thread, path, nullptr, 0);
  return result;
}

int fdatasync(int fd) { return fsync(fd); }

int rename(const char* from, const char* to) {
  const char* a = Below(from);
  const char* b = Below(to);
  if (a != nullptr && Fails("rename")) return -1;
  const int result = static_cast<int>(::syscall(SYS_rename, from, to));
  if (result == 0 && a != nullptr && b != nullptr) Trace('R', 0, 0, b, a, ::strlen(a));
  return result;
}

int symlink(const char* target, const char* path) {
  const int result = static_cast<int>(::syscall(SYS_symlinkat, target, AT_FDCWD, path));
  if (result == 0) Trace('L', 0, 0, Below(path), target, ::strlen(target));
  return result;
}

int unlink(const char* path) {
  const int result = static_cast<int>(::syscall(SYS_unlink, path));
  if (result == 0) Trace('U', 0, 0, Below(path), nullptr, 0);
  return result;
}

int remove(const char* path) {
  int result = static_cast<int>(::syscall(SYS_unlink, path));
  if (result != 0 && errno == EISDIR) result = static_cast<int>(::syscall(SYS_rmdir, path));
  if (result == 0) Trace('U', 0, 0, Below(path), nullptr, 0);
  return result;
}

int mkdir(const char* path, mode_t mode) {
  const int result = static_cast<int>(::syscall(SYS_mkdir, path, mode));
  if (result == 0) Trace('M', 0, 0, Below(path), nullptr, 0);
  return result;
}

int clock_gettime(clockid_t clock, timespec* time) {
  using Function = int(clockid_t, timespec*);
  static Function* const real = Real<Function>("clock_gettime");
  const int result = real(clock, time);
  if (result == 0 && clock == CLOCK_REALTIME) time->tv_sec += ClockOffset();
  return result;
}

// Until a wall-clock time that was computed with the moved clock; the kernel's own has not moved.
int pthread_cond_timedwait(pthread_cond_t* condition, pthread_mutex_t* mutex, const timespec* until) {
  using Function = int(pthread_cond_t*, pthread_mutex_t*, const timespec*);
  static Function* const real =
      reinterpret_cast<Function*>(::dlvsym(RTLD_NEXT, "pthread_cond_timedwait", "GLIBC_2.3.2"));
  timespec unmoved = *until;
  constexpr time_t kSurelyWallClock = 500'000'000;  // what is smaller counts from the machine's start
  if (unmoved.tv_sec > kSurelyWallClock) unmoved.tv_sec -= ClockOffset();
  return real(condition, mutex, &unmoved);
}

}  // extern "C"
