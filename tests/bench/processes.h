// SPDX-License-Identifier: Apache-2.0
// Benchmarks that run both sides as processes of their own.
#pragma once

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "services/core/clock.h"

namespace etude::bench {

/// A process whose output can be read; ended by SIGTERM, then SIGKILL, when this goes.
class Child {
 public:
  explicit Child(std::vector<std::string> arguments) {
    int fds[2] = {-1, -1};
    if (::pipe2(fds, O_CLOEXEC) != 0) std::abort();
    output_ = fds[0];
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, fds[1], STDOUT_FILENO);
    std::vector<char*> argv;
    for (auto& argument : arguments) argv.push_back(argument.data());
    argv.push_back(nullptr);
    if (::posix_spawnp(&pid_, argv[0], &actions, nullptr, argv.data(), environ) != 0) {
      std::fprintf(stderr, "cannot start %s\n", argv[0]);
      std::exit(3);
    }
    posix_spawn_file_actions_destroy(&actions);
    ::close(fds[1]);
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;
  ~Child() {
    ::close(output_);
    if (pid_ <= 0) return;
    ::kill(pid_, SIGTERM);
    for (const Stopwatch watch; watch.Seconds() < 2.0;) {
      if (::waitpid(pid_, nullptr, WNOHANG) != 0) return;
      ::usleep(2000);
    }
    ::kill(pid_, SIGKILL);
    ::waitpid(pid_, nullptr, 0);
  }
  pid_t pid() const { return pid_; }
  /// The next line without its end; empty when there is no more.
  std::string ReadLine() {
    std::string line;
    for (char c = 0; ::read(output_, &c, 1) == 1 && c != '\n';) line.push_back(c);
    return line;
  }
  /// Everything it prints until it ends.
  std::string ReadAll() {
    std::string text;
    char buffer[4096];
    for (ssize_t count = 0; (count = ::read(output_, buffer, sizeof(buffer))) > 0;) {
      text.append(buffer, static_cast<std::size_t>(count));
    }
    ::waitpid(std::exchange(pid_, 0), nullptr, 0);
    return text;
  }

 private:
  pid_t pid_ = 0;
  int output_ = -1;
};

/// CPU seconds: RUSAGE_SELF; RUSAGE_CHILDREN, of all that have ended.
inline double CpuSeconds(int who) {
  rusage usage{};
  ::getrusage(who, &usage);
  const auto seconds = [](const timeval& time) {
    return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

/// Most that this process had in memory, MB. getrusage's ru_maxrss is no less than what the parent had before exec.
inline double PeakResidentMb() {
  double kb = 0;
  if (std::FILE* const status = std::fopen("/proc/self/status", "re")) {
    for (char line[256]; std::fgets(line, sizeof(line), status) != nullptr;)
      if (std::sscanf(line, "VmHWM: %lf", &kb) == 1) break;
    std::fclose(status);
  }
  return kb / 1024;
}

inline double ChildrenCpuSeconds() { return CpuSeconds(RUSAGE_CHILDREN); }

/// Of a process that runs; 0 where it does not.
inline double CpuSecondsOf(pid_t pid) {
  unsigned long user = 0, system = 0;
  const std::string path = "/proc/" + std::to_string(pid) + "/stat";
  if (std::FILE* const stat = std::fopen(path.c_str(), "re")) {
    // behind the name, which is ours and holds no ")"
    if (std::fscanf(stat, "%*d (%*[^)]) %*c %*d %*d %*d %*d %*d %*u %*u %*u %*u %*u %lu %lu", &user, &system) != 2)
      user = system = 0;
    std::fclose(stat);
  }
  return static_cast<double>(user + system) / static_cast<double>(::sysconf(_SC_CLK_TCK));
}

/// This program again, in another role.
inline std::vector<std::string> Self(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), "/proc/self/exe");
  return arguments;
}

/// Every DDS process started from here on uses this file.
inline void UseProfile(const std::string& path) {
  const auto uri = "file://" + std::filesystem::absolute(path).string();
  ::setenv("CYCLONEDDS_URI", uri.c_str(), 1);
}

inline double Median(std::vector<double> values) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  const std::size_t half = values.size() / 2;
  return values.size() % 2 == 1 ? values[half] : (values[half - 1] + values[half]) / 2;
}

/// "median (min-max)".
inline std::string Summary(const std::vector<double>& values) {
  if (values.empty()) return "none";
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  char text[96];
  std::snprintf(text, sizeof(text), "%.6g (%.6g-%.6g)", Median(values), *low, *high);
  return text;
}

/// Samples of `size` bytes (its header is part of them) that `ddsperf` moves from one process to another,
/// reliable and keep-all, in each one-second window after the first.
inline std::vector<double> DdsperfRates(std::uint32_t domain, std::size_t size, double seconds) {
  const std::string duration = std::to_string(static_cast<int>(seconds + 1.99));
  std::string text;
  {
    Child publisher({"ddsperf", "-i", std::to_string(domain), "-D", "60", "pub", "size", std::to_string(size)});
    Child subscriber({"ddsperf", "-i", std::to_string(domain), "-D", duration, "sub"});
    text = subscriber.ReadAll();
  }
  std::vector<double> rates;
  for (std::size_t at = 0; (at = text.find(" delta ", at)) != std::string::npos; at += 7)
    rates.push_back(std::strtod(text.c_str() + at + 7, nullptr));
  if (rates.size() > 1) rates.erase(rates.begin());
  return rates;
}

namespace internal {

inline double SpinRate(double seconds) {
  volatile double value = 1;
  std::uint64_t rounds = 0;
  const Stopwatch watch;
  while (watch.Seconds() < seconds) {
    for (int i = 0; i < 10'000; ++i) value = value * 1.0000001 + 1e-9;
    ++rounds;
  }
  return static_cast<double>(rounds) / watch.Seconds();
}

}  // namespace internal

/// Speed of two busy processes together over that of one: 2 when the machine has two free cores. Call
/// before any thread is started.
inline double TwoProcessSpin() {
  const double alone = internal::SpinRate(0.3);
  int fds[2] = {-1, -1};
  if (::pipe(fds) != 0) return 0;
  const pid_t pid = ::fork();
  if (pid == 0) {
    const double rate = internal::SpinRate(0.3);
    [[maybe_unused]] const auto written = ::write(fds[1], &rate, sizeof(rate));
    ::_exit(0);
  }
  double together = internal::SpinRate(0.3);
  double other = 0;
  [[maybe_unused]] const auto got = ::read(fds[0], &other, sizeof(other));
  ::waitpid(pid, nullptr, 0);
  ::close(fds[0]);
  ::close(fds[1]);
  together += other;
  return alone > 0 ? together / alone : 0;
}

inline void PrintCalibration(double before, double after) {
  std::fprintf(stderr, "two busy processes over one: %.2f before, %.2f after%s\n", before, after,
               std::abs(before - after) > 0.25 || std::min(before, after) < 1.7
                   ? " - other load on the machine: do not trust these figures"
                   : "");
}

}  // namespace etude::bench
