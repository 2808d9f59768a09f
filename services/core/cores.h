// SPDX-License-Identifier: Apache-2.0
// How much of the machine a process may use.
#pragma once

#include <string>

namespace etude {

/// Hardware threads that this process may use, at least 1: those it may run on, and no more than the quota of its
/// control group is worth (a container's --cpus, a service's CPUQuota=). Thread-safe.
int Cores();

/// The same of so many, with what /sys/fs/cgroup/cpu.max says: "QUOTA PERIOD" in microseconds, "max PERIOD", or
/// nothing.
int CoresOf(int hardware_threads, const std::string& cpu_max);

}  // namespace etude
