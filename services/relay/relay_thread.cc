// SPDX-License-Identifier: Apache-2.0
#include "services/relay/relay_thread.h"

#include <utility>

#include "services/core/clock.h"
#include "services/core/log.h"
#include "services/core/stop.h"
#include "services/core/without_throwing.h"

namespace etude::relay {
namespace {

using namespace std::chrono_literals;

constexpr auto kAgain = 3s;  // until what failed is tried again

}  // namespace

RelayThread::RelayThread(const bus::Participant& participant, const Selector& selector, const RelayOptions& options)
    : thread_([this, &participant, selector, options] {
        const auto stopping = [this] { return stop_ || StopRequested(); };
        std::string told;
        // what is in its way may pass, and the process that it stands beside goes on: two runs of one name, another
        // relay that holds the folder, a disk that fails
        while (!stopping()) {
          const Status ended = WithoutThrowing([&] { return RelayRuns(participant, selector, options, stopping); });
          if (ended) return;
          if (std::exchange(told, ended.error().message) != ended.error().message)
            Log().error("no relay of run {} until it can be: {}", selector.text(), ended.error().message);
          for (const auto again = Deadline(kAgain); MonotonicClock::now() < again && !stopping();) WaitForStop(100ms);
        }
      }) {}

RelayThread::~RelayThread() {
  stop_ = true;
  thread_.join();
}

}  // namespace etude::relay
