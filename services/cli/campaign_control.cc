// SPDX-License-Identifier: Apache-2.0
#include "services/cli/campaign_control.h"

#include <fmt/format.h>

#include <utility>

#include "services/core/clock.h"
#include "services/core/identity.h"
#include "services/core/printable.h"
#include "services/core/stop.h"

namespace etude::cli {
namespace {

using namespace std::chrono_literals;

Result<bus::CampaignStatus> Ask(const bus::Participant& participant, const bus::Presence& campaign,
                                const std::string& word, const bus::CampaignControl& message,
                                std::chrono::seconds patience, bus::Reader<bus::CampaignStatus>& statuses) {
  const std::string partition = bus::Owner{campaign.name, campaign.id}.partition();
  ETUDE_ASSIGN_OR_RETURN(auto controls, bus::Writer<bus::CampaignControl>::Open(participant, partition));
  const auto no_answer = [&](const char* what) {
    return Fail(Code::kUnavailable,
                Printable(fmt::format("{} campaign '{}@{}': its collector (program {}, on {}) {}", word, campaign.name,
                                      campaign.id, campaign.version, campaign.host, what)));
  };
  if (!controls.WaitForReaders(1, 5s)) return no_answer("does not listen to commands: end it with Ctrl-C there");
  const auto deadline = MonotonicClock::now() + patience;
  while (MonotonicClock::now() < deadline && !StopRequested()) {
    ETUDE_RETURN_IF_ERROR(controls.Write(message));
    statuses.Wait(1s);
    for (auto& status : statuses.Take())
      if (status.control_id == message.control_id) return std::move(status);
  }
  if (StopRequested()) return Fail(Code::kTimeout, "stopped before the collector answered: it may have obeyed");
  return no_answer("did not answer");
}

}  // namespace

Result<Told> TellCollector(const bus::Participant& participant, const bus::Presence& collector, const std::string& word,
                           bus::CampaignControl message, std::chrono::seconds patience) {
  message.campaign = collector.name;
  message.campaign_id = collector.id;
  message.control_id = NewId();
  message.host = HostName();
  message.user = UserName();
  const std::string partition = bus::Owner{collector.name, collector.id}.partition();
  ETUDE_ASSIGN_OR_RETURN(auto statuses, bus::Reader<bus::CampaignStatus>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(bus::CampaignStatus status, Ask(participant, collector, word, message, patience, statuses));
  if (!status.control_refusal.empty())
    return Fail(Code::kInvalidArgument, Printable(fmt::format("{} campaign '{}@{}': refused: {}", word, collector.name,
                                                              collector.id, status.control_refusal)));
  return Told{collector, std::move(statuses), std::move(status)};
}

}  // namespace etude::cli
