// SPDX-License-Identifier: Apache-2.0
#include "services/core/cores.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>
#include <string>
#include <thread>

namespace etude {

int CoresOf(int hardware_threads, const std::string& cpu_max) {
  const int threads = std::max(1, hardware_threads);
  std::istringstream text(cpu_max);
  double quota = 0, period = 0;  // microseconds
  if (!(text >> quota >> period) || quota <= 0 || period <= 0) return threads;
  return std::clamp(static_cast<int>(std::ceil(quota / period)), 1, threads);
}

int Cores() {
  std::ifstream file("/sys/fs/cgroup/cpu.max");
  std::string cpu_max;
  std::getline(file, cpu_max);
  return CoresOf(static_cast<int>(std::thread::hardware_concurrency()), cpu_max);
}

}  // namespace etude
