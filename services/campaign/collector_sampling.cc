// SPDX-License-Identifier: Apache-2.0
// The collector's side of adaptive sampling: from a trainer's validation errors to the sampling journal.
#include <fmt/format.h>

#include "services/campaign/collector_impl.h"
#include "services/core/log.h"
#include "services/spec/sampling_weights.h"

namespace etude::campaign {

namespace {

constexpr std::size_t kLongestReason = 300;  // bytes, of what somebody else's message is refused for

}  // namespace

// What is wanted, as far as the campaign lets it: whoever speaks, and whatever is said, weights stay within its bound.
Result<SamplingEntry> Collector::Impl::WantedBy(const bus::ValidationErrors& message) {
  const auto other = [](const char* what, const std::string& theirs, const std::string& ours) {
    return Fail(Code::kInvalidArgument, fmt::format("they are of {} '{}', not '{}'", what, theirs, ours));
  };
  if (!spec.adaptive_sampling.on())
    return Fail(Code::kInvalidArgument, "the campaign does not follow them: adaptive_sampling.share is 0");
  if (message.campaign_id != id) return other("campaign", message.campaign_id, id);
  if (!IsId(message.run_id) || (!run_id.empty() && message.run_id != run_id))
    return other("run", message.run_id, run_id);
  ETUDE_ASSIGN_OR_RETURN(const auto cells, ParseErrorCells(message.errors_json, spec));
  run_id = message.run_id;
  return SamplingEntry{.run = message.run_id, .step = message.step, .weights = WeightsFor(cells, spec)};
}

void Collector::Impl::OnErrors(const bus::ValidationErrors& message) {
  auto entry = WantedBy(message);
  if (entry) {
    wanted = std::move(*entry);
    return;
  }
  {
    const MutexLock lock(mutex);
    ++counters.refused_errors;
  }
  // the same mistake may come again with every validation
  if (refusal == entry.error().message) return;
  refusal = entry.error().message;
  Log().warn("did not take validation errors campaign={}: {}", spec.name, refusal.substr(0, kLongestReason));
}

// Puts what is wanted into force where the campaign lets it, from the first index that was never leased: nothing that
// was made, or is being made, changes. False when it could not be made durable: then nothing may be leased, because
// the entry may stand in the file all the same.
bool Collector::Impl::Reweight() {
  if (!wanted) return true;
  const std::uint64_t earliest = [&] {
    const MutexLock lock(journal_mutex);
    return journal.next_from();
  }();
  wanted->from_index = [&] {
    const MutexLock lock(mutex);
    return table.frontier();
  }();
  if (wanted->from_index < earliest || wanted->from_index >= spec.episodes) return true;
  const Status appended = [&] {
    const MutexLock lock(journal_mutex);
    return journal.Append(*wanted);
  }();
  const MutexLock lock(mutex);
  journal_error = appended ? "" : appended.error().Wrap("leasing waits, it is tried again").message;
  if (!appended) return false;
  ++counters.reweighted;
  counters.reweighted_from = wanted->from_index;
  Log().info("sampling weights of run={} step={} hold from episode {}", wanted->run, wanted->step, wanted->from_index);
  wanted.reset();
  return true;
}

SamplingWeights Collector::Impl::WeightsAt(std::uint64_t index) const {
  const MutexLock lock(journal_mutex);
  return journal.At(index);
}

}  // namespace etude::campaign
