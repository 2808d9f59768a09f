// SPDX-License-Identifier: Apache-2.0
// A mutex that Clang's thread safety analysis understands (tests/check_threads): which data it guards stands beside
// the data, and who touches them without it is an error at compile time. Other compilers see plain std::mutex.
#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>

#if defined(__clang__)
#define ETUDE_THREAD_ANNOTATION(x) __attribute__((x))
#else
#define ETUDE_THREAD_ANNOTATION(x)
#endif

/// On data: only touched while `mutex` is held.
#define ETUDE_GUARDED_BY(mutex) ETUDE_THREAD_ANNOTATION(guarded_by(mutex))
/// On functions: the caller holds `mutex`.
#define ETUDE_REQUIRES(mutex) ETUDE_THREAD_ANNOTATION(requires_capability(mutex))
/// On functions: the caller does not hold `mutex`, because the function takes it.
#define ETUDE_EXCLUDES(mutex) ETUDE_THREAD_ANNOTATION(locks_excluded(mutex))

namespace etude {

class ETUDE_THREAD_ANNOTATION(capability("mutex")) Mutex {
 public:
  void lock() ETUDE_THREAD_ANNOTATION(acquire_capability()) { mutex_.lock(); }
  void unlock() ETUDE_THREAD_ANNOTATION(release_capability()) { mutex_.unlock(); }

 private:
  std::mutex mutex_;
};

/// Holds a Mutex for a scope.
class ETUDE_THREAD_ANNOTATION(scoped_lockable) MutexLock {
 public:
  explicit MutexLock(Mutex& mutex) ETUDE_THREAD_ANNOTATION(acquire_capability(mutex)) : mutex_(mutex) { mutex_.lock(); }
  ~MutexLock() ETUDE_THREAD_ANNOTATION(release_capability()) { mutex_.unlock(); }
  MutexLock(const MutexLock&) = delete;
  MutexLock& operator=(const MutexLock&) = delete;

 private:
  Mutex& mutex_;
};

/// Waits for something that a Mutex guards. The condition is written as a loop around Wait, so that the analysis
/// sees that it reads guarded data with the mutex held.
class ConditionVariable {
 public:
  void Wait(Mutex& mutex) ETUDE_REQUIRES(mutex) { condition_.wait(mutex); }
  /// @returns false when `duration` passed without a notification
  template <class Rep, class Period>
  bool WaitFor(Mutex& mutex, std::chrono::duration<Rep, Period> duration) ETUDE_REQUIRES(mutex) {
    return condition_.wait_for(mutex, duration) == std::cv_status::no_timeout;
  }
  void NotifyOne() { condition_.notify_one(); }
  void NotifyAll() { condition_.notify_all(); }

 private:
  std::condition_variable_any condition_;
};

}  // namespace etude
