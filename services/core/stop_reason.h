// SPDX-License-Identifier: Apache-2.0
// A stop that is a failure: work drains as after a signal, and then the process ends with an error, so that whoever
// supervises it starts it again; or it starts itself again, where only that helps.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "services/core/result.h"

namespace etude {

/// Requests a stop for a reason; the first one counts. Thread-safe.
void StopBecause(Error error);
/// What RunMain ends the process with when its body had no error of its own.
std::optional<Error> ReasonOfStop();

/// Seconds between two times that a process starts itself again: what comes back at once is not cured by it.
inline constexpr std::int64_t kLeastLifeS = 120;

/// As StopBecause, and RunMain then starts this program again in the same process, with the same arguments; under a
/// service manager ($NOTIFY_SOCKET), which does so itself, it ends. Nothing after a stop was requested already.
/// Thread-safe.
void RestartBecause(Error error);
/// Whether kLeastLifeS have passed since this process started itself again, or it never did, and no RestartHold lives.
/// Under a service manager, which starts it again without telling: since it began.
bool MayStartAgain();
/// While one lives, what is under way here is worth more than starting again. Thread-safe.
class RestartHold {
 public:
  RestartHold();
  ~RestartHold();
  RestartHold(const RestartHold&) = delete;
  RestartHold& operator=(const RestartHold&) = delete;
};
/// What the program needs to be told beside its own arguments when it is started again (a trainer: --resume); nothing
/// where it cannot be. Asked at the end; what is among its arguments already is left out. Thread-safe.
using MoreArguments = std::function<std::optional<std::vector<std::string>>()>;
void RestartWith(MoreArguments more);
/// After the body's end: starts the program again where RestartBecause was the reason of the stop, else returns; also
/// where that fails. RunMain calls it.
void StartAgainIfWanted();

}  // namespace etude
