// SPDX-License-Identifier: Apache-2.0
// Asking a process to stop: SIGINT, SIGTERM and SIGHUP set one flag; long work looks at it and drains.
#pragma once

#include <chrono>

namespace etude {

/// Installs handlers for SIGINT and SIGTERM that request a stop (a second signal ends the process at
/// once), one for SIGHUP that does so too, unless it is ignored (nohup), and sends what is printed from then on to a
/// terminal that has gone to /dev/null; and ignores SIGPIPE and SIGXFSZ: a write to what nobody reads fails with EPIPE,
/// one beyond the limit on files with EFBIG. Call once, first thing in main.
void InstallStopSignals();

/// True after a signal or RequestStop(). Async-signal-safe, thread-safe.
bool StopRequested();
void RequestStop();

/// Waits until a stop is requested or `timeout` is over; returns StopRequested().
bool WaitForStop(std::chrono::nanoseconds timeout);

}  // namespace etude
