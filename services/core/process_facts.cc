// SPDX-License-Identifier: Apache-2.0
#include "services/core/process_facts.h"

#include <sys/resource.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>

namespace etude {
namespace {

double CpuSeconds() {
  struct rusage usage {};
  if (::getrusage(RUSAGE_SELF, &usage) != 0) return 0;
  const auto seconds = [](const timeval& time) {
    return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

std::uint64_t ResidentBytes() {
  std::ifstream file("/proc/self/statm");
  std::uint64_t all = 0, resident = 0;
  if (!(file >> all >> resident)) return 0;
  return resident * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
}

}  // namespace

ProcessMeter::ProcessMeter(const Path& folder)
    : folder_(std::filesystem::absolute(folder.empty() ? Path(".") : folder).lexically_normal()),
      cpu_s_(CpuSeconds()) {}

ProcessFacts ProcessMeter::Measure() {
  ProcessFacts facts;
  const double cpu_s = CpuSeconds(), seconds = since_last_.Seconds();
  if (seconds > 0) facts.cpu = std::max(0.0, (cpu_s - cpu_s_) / seconds);
  cpu_s_ = cpu_s;
  since_last_.Restart();
  facts.rss_bytes = ResidentBytes();
  struct statvfs disk {};
  Path folder = folder_;
  while (::statvfs(folder.c_str(), &disk) != 0 && folder != folder.parent_path()) folder = folder.parent_path();
  facts.disk_free_bytes = std::uint64_t{disk.f_bavail} * disk.f_frsize;
  facts.disk_total_bytes = std::uint64_t{disk.f_blocks} * disk.f_frsize;
  return facts;
}

}  // namespace etude
