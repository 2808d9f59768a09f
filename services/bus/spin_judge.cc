// SPDX-License-Identifier: Apache-2.0
#include "services/bus/spin_judge.h"

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <system_error>
#include <utility>

namespace etude::bus {

// "ID (NAME) S ...": the name may have spaces and brackets in it; utime and stime are the 14th and 15th of all fields.
std::optional<ThreadTime> ParseThreadStat(const std::string& line) {
  const std::size_t open = line.find('('), close = line.rfind(')');
  if (open == std::string::npos || close == std::string::npos || close < open) return std::nullopt;
  ThreadTime thread;
  std::istringstream id(line.substr(0, open)), rest(line.substr(close + 1));
  if (!(id >> thread.id)) return std::nullopt;
  thread.name = line.substr(open + 1, close - open - 1);
  constexpr int kBetween = 11;  // state, and ten numbers
  std::string skipped;
  for (int i = 0; i < kBetween; ++i) rest >> skipped;
  double user = 0, system = 0;
  if (!(rest >> user >> system)) return std::nullopt;
  thread.cpu_s = (user + system) / static_cast<double>(::sysconf(_SC_CLK_TCK));
  return thread;
}

std::vector<ThreadTime> ThreadTimes() {
  std::vector<ThreadTime> threads;
  std::error_code error;
  for (std::filesystem::directory_iterator it("/proc/self/task", error), end; !error && it != end;
       it.increment(error)) {
    std::ifstream file(it->path() / "stat");  // one that has ended meanwhile has none
    std::string line;
    if (!std::getline(file, line)) continue;
    if (auto thread = ParseThreadStat(line)) threads.push_back(std::move(*thread));
  }
  return threads;
}

std::optional<ThreadTime> SpinJudge::Look(const std::vector<ThreadTime>& threads, double now_s,
                                          std::uint64_t admitted) {
  if (admitted != std::exchange(admitted_, admitted)) seen_.clear();
  std::optional<ThreadTime> spinning;
  std::map<std::uint64_t, Seen> seen;
  for (const ThreadTime& thread : threads) {
    if (thread.name != "fsm" && thread.name != "gc") continue;
    Seen now{now_s, thread.cpu_s, now_s};
    if (const auto before = seen_.find(thread.id); before != seen_.end()) {
      const double passed = now_s - before->second.at_s;
      const bool busy = passed > 0 && thread.cpu_s - before->second.cpu_s >= kBusy * passed;
      if (busy) now.busy_since_s = before->second.busy_since_s;
    }
    if (!spinning && now_s - now.busy_since_s >= kSpinningS) spinning = thread;
    seen[thread.id] = now;
  }
  seen_ = std::move(seen);
  return spinning;
}

}  // namespace etude::bus
