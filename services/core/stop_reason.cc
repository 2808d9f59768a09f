// SPDX-License-Identifier: Apache-2.0
#include "services/core/stop_reason.h"

#include <mutex>

#include "services/core/stop.h"

namespace etude {
namespace {

struct Reason {
  std::mutex mutex;
  std::optional<Error> error;
};

Reason& GetReason() {
  static auto* const reason = new Reason;  // outlives all threads on purpose
  return *reason;
}

}  // namespace

void StopBecause(Error error) {
  auto& reason = GetReason();
  {
    const std::scoped_lock lock(reason.mutex);
    if (!reason.error) reason.error = std::move(error);
  }
  RequestStop();
}

std::optional<Error> ReasonOfStop() {
  auto& reason = GetReason();
  const std::scoped_lock lock(reason.mutex);
  return reason.error;
}

}  // namespace etude
