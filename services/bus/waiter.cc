// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "services/bus/participant_state.h"
#include "services/core/clock.h"
#include "services/core/stop.h"

namespace etude::bus {

Status Waiter::Open(const Participant& participant) {
  ETUDE_ASSIGN_OR_RETURN(waitset_,
                         CheckEntity(dds_create_waitset(participant.state()->participant.get()), "make a waitset"));
  return {};
}

Status Waiter::AddReader(const Endpoint& reader) {
  ETUDE_ASSIGN_OR_RETURN(Entity condition,
                         CheckEntity(dds_create_readcondition(reader.get(), DDS_ANY_STATE), "make a read condition"));
  const dds_return_t code = dds_waitset_attach(waitset_.get(), condition.get(), 0);
  if (code != DDS_RETCODE_OK) return Fail(DdsError(code, "attach a reader to a waitset"));
  conditions_.push_back(std::move(condition));
  return {};
}

Status Waiter::AddMatched(const Endpoint& endpoint) {
  dds_return_t code = dds_set_status_mask(
      endpoint.get(), endpoint.is_writer ? DDS_PUBLICATION_MATCHED_STATUS : DDS_SUBSCRIPTION_MATCHED_STATUS);
  if (code == DDS_RETCODE_OK) code = dds_waitset_attach(waitset_.get(), endpoint.get(), 0);
  if (code != DDS_RETCODE_OK) return Fail(DdsError(code, "attach an endpoint to a waitset"));
  return {};
}

bool Waiter::Wait(std::chrono::nanoseconds timeout) {
  // a stop request is a flag and a pipe, which a waitset cannot watch: look at it between short waits
  constexpr std::chrono::nanoseconds kSlice = std::chrono::milliseconds(50);
  const auto end = Deadline(timeout);
  while (!StopRequested()) {
    const auto left = std::max<std::chrono::nanoseconds>(end - MonotonicClock::now(), {});
    const auto slice = std::min(left, kSlice);
    if (dds_waitset_wait(waitset_.get(), nullptr, 0, slice.count()) > 0) return true;
    if (left <= kSlice) return false;
  }
  return false;
}

}  // namespace etude::bus
