// SPDX-License-Identifier: Apache-2.0
#include "services/relay/relay_thread.h"

#include "services/core/log.h"
#include "services/core/stop.h"
#include "services/core/without_throwing.h"

namespace etude::relay {

RelayThread::RelayThread(const bus::Participant& participant, const Selector& selector, const RelayOptions& options)
    : thread_([this, &participant, selector, options] {
        const Status ended = WithoutThrowing(
            [&] { return RelayRuns(participant, selector, options, [this] { return stop_ || StopRequested(); }); });
        if (!ended) Log().error("no relay any more of run {}: {}", selector.text(), ended.error().message);
      }) {}

RelayThread::~RelayThread() {
  stop_ = true;
  thread_.join();
}

}  // namespace etude::relay
