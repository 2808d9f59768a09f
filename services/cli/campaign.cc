// SPDX-License-Identifier: Apache-2.0
// `etude campaign list|status|pause|drain|resume|stop`: campaigns that are live on this domain.
#include <fmt/format.h>

#include <cstdio>
#include <optional>

#include "services/bus/directory.h"
#include "services/bus/topic.h"
#include "services/cli/bus_watch.h"
#include "services/cli/command_line.h"
#include "services/cli/top_text.h"
#include "services/core/config.h"
#include "services/core/printable.h"
#include "services/core/stop.h"
#include "services/episode/bounded_json.h"

namespace etude::cli {
namespace {

using namespace std::chrono_literals;

struct CampaignArguments {
  std::string name;
  bool as_json = false;
  BusArguments bus;
};

OrderedJson StatusJson(const CampaignView& campaign) {
  OrderedJson json{{"name", campaign.presence.name},     {"id", campaign.presence.id},
                   {"host", campaign.presence.host},     {"user", campaign.presence.user},
                   {"folder", campaign.presence.folder}, {"since", campaign.presence.since}};
  if (!campaign.status) return json;
  const bus::CampaignStatus& status = campaign.status->message;
  json["state"] = status.state;
  json["committed"] = status.committed;
  json["total"] = status.total;
  json["attempts"] = status.attempts;
  json["given_up"] = status.given_up;
  json["workers"] = status.workers;
  json["episodes_per_minute"] = status.episodes_per_minute;
  json["eta_s"] = status.eta_s;
  json["failures"] = ParseBoundedJson(status.failures_json, 2).value_or(OrderedJson::object());
  json["error"] = status.error;
  return json;
}

Status ListCampaigns(const CampaignArguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open({security::Role::kGateway}));
  ETUDE_ASSIGN_OR_RETURN(auto watch, BusWatch::Open(participant));
  ETUDE_RETURN_IF_ERROR(watch.LookAround(1500ms));
  OrderedJson all = OrderedJson::array();
  for (const auto& [id, campaign] : watch.view().campaigns) {
    all.push_back(StatusJson(campaign));
    if (arguments.as_json) continue;
    const bus::CampaignStatus status = campaign.status ? campaign.status->message : bus::CampaignStatus();
    const std::string line =
        fmt::format("{}@{}  {}  {}/{}  {:.1f}/min  {} workers  host {}  {}", campaign.presence.name, id,
                    status.state.empty() ? "?" : status.state, status.committed, status.total,
                    status.episodes_per_minute, status.workers, campaign.presence.host, campaign.presence.folder);
    fmt::print("{}\n", Printable(line));
  }
  if (arguments.as_json)
    fmt::print("{}\n", JsonText(all, 1));
  else if (all.empty())
    fmt::print("no campaign is live on domain {}\n", participant.domain());
  return {};
}

// The campaign that is meant. @error kNotFound when it is not there
Result<bus::Presence> Find(const bus::Participant& participant, const std::string& name) {
  ETUDE_ASSIGN_OR_RETURN(const Selector selector, ParseSelector(name, "campaign"));
  ETUDE_ASSIGN_OR_RETURN(auto directory, bus::Directory::Open(participant));
  ETUDE_ASSIGN_OR_RETURN(const auto found, directory.Find(bus::PresenceKind::kCampaign, selector, 2s));
  if (found) return *found;
  return Fail(Code::kNotFound,
              fmt::format("campaign '{}' is not live on domain {}: `etude campaign list` shows those that are", name,
                          participant.domain()));
}

Status ShowCampaign(const CampaignArguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open({security::Role::kGateway}));
  ETUDE_ASSIGN_OR_RETURN(const bus::Presence found, Find(participant, arguments.name));
  ETUDE_ASSIGN_OR_RETURN(auto watch, BusWatch::Open(participant));
  ETUDE_RETURN_IF_ERROR(watch.LookAround(1500ms));
  BusView only{.domain = participant.domain()};
  const auto campaign = watch.view().campaigns.find(found.id);
  if (campaign == watch.view().campaigns.end())
    return Fail(Code::kNotFound, fmt::format("campaign '{}' has just ended", arguments.name));
  only.campaigns.insert(*campaign);
  if (arguments.as_json)
    fmt::print("{}\n", JsonText(StatusJson(campaign->second), 1));
  else
    fmt::print("{}", TopText(only, MonotonicClock::now()));
  return {};
}

struct Control {
  const char* word;
  bus::ControlAction action;
  const char* description;
};

constexpr Control kControls[] = {
    {"pause", bus::ControlAction::kPause, "lease nothing new; what is leased is finished and committed"},
    {"drain", bus::ControlAction::kDrain, "as pause, and wait until nothing is leased any more"},
    {"resume", bus::ControlAction::kResume, "lease again"},
    {"stop", bus::ControlAction::kStop, "end its collector; started again, it resumes"}};

// Says it again until the collector's next status answers it.
Result<bus::CampaignStatus> Ask(const bus::Participant& participant, const bus::Presence& campaign,
                                const Control& control, bus::Reader<bus::CampaignStatus>& statuses) {
  const std::string partition = bus::Owner{campaign.name, campaign.id}.partition();
  ETUDE_ASSIGN_OR_RETURN(auto controls, bus::Writer<bus::CampaignControl>::Open(participant, partition));
  const auto no_answer = [&](const char* what) {
    return Fail(Code::kUnavailable,
                Printable(fmt::format("{} campaign '{}@{}': its collector (program {}, on {}) {}", control.word,
                                      campaign.name, campaign.id, campaign.version, campaign.host, what)));
  };
  if (!controls.WaitForReaders(1, 5s)) return no_answer("does not listen to commands: end it with Ctrl-C there");
  bus::CampaignControl message;
  message.campaign = campaign.name;
  message.campaign_id = campaign.id;
  message.control_id = NewId();
  message.action = control.action;
  message.host = HostName();
  message.user = UserName();
  const auto deadline = MonotonicClock::now() + 10s;
  while (MonotonicClock::now() < deadline && !StopRequested()) {
    ETUDE_RETURN_IF_ERROR(controls.Write(message));
    statuses.Wait(1s);
    for (auto& status : statuses.Take())
      if (status.control_id == message.control_id) return std::move(status);
  }
  return no_answer("did not answer");
}

// A collector speaks once a second; one that is silent for so long has died.
constexpr auto kCollectorSilence = 30s;

// The first status in which nothing is leased any more, or somebody has told the campaign something else; after a stop
// request the last one. @error kUnavailable: the collector fell silent
Result<bus::CampaignStatus> AwaitDrained(const bus::Presence& campaign, bus::Reader<bus::CampaignStatus>& statuses,
                                         bus::CampaignStatus status) {
  auto heard = MonotonicClock::now();
  while (status.state == "draining" && !StopRequested()) {
    statuses.Wait(1s);
    for (auto& taken : statuses.Take()) {
      status = std::move(taken);
      heard = MonotonicClock::now();
    }
    if (MonotonicClock::now() - heard > kCollectorSilence)
      return Fail(
          Code::kUnavailable,
          Printable(fmt::format(
              "drain campaign '{}@{}': its collector (on {}) has said nothing for {} s, {} of {} episodes were "
              "committed then; if it has died, start it again: it resumes, and what is committed stays",
              campaign.name, campaign.id, campaign.host, kCollectorSilence.count(), status.committed, status.total)));
  }
  return status;
}

Status SendControl(const CampaignArguments& arguments, const Control& control) {
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open({security::Role::kGateway}));
  ETUDE_ASSIGN_OR_RETURN(const bus::Presence found, Find(participant, arguments.name));
  ETUDE_ASSIGN_OR_RETURN(
      auto statuses, bus::Reader<bus::CampaignStatus>::Open(participant, bus::Owner{found.name, found.id}.partition()));
  ETUDE_ASSIGN_OR_RETURN(bus::CampaignStatus status, Ask(participant, found, control, statuses));
  if (!status.control_refusal.empty())
    return Fail(Code::kInvalidArgument, Printable(fmt::format("{} campaign '{}': refused: {}", control.word,
                                                              arguments.name, status.control_refusal)));
  if (control.action == bus::ControlAction::kDrain) {
    ETUDE_ASSIGN_OR_RETURN(status, AwaitDrained(found, statuses, std::move(status)));
  }
  const std::string who = Printable(found.name + "@" + found.id);
  fmt::print("{}: {}, {} of {} committed\n", who, Printable(status.state), status.committed, status.total);
  if (status.state == "paused" || status.state == "draining") fmt::print("go on with: etude campaign resume {}\n", who);
  return {};
}

}  // namespace

void AddCampaign(CLI::App& app, Body& body) {
  auto* command = app.add_subcommand("campaign", "campaigns that are live: list, status, pause, drain, resume, stop");
  command->require_subcommand(1);
  auto arguments = std::make_shared<CampaignArguments>();
  auto* list = command->add_subcommand("list", "those that are live on this domain");
  list->add_flag("--json", arguments->as_json, "as JSON");
  arguments->bus.Add(*list);
  list->callback([=, &body] { body = [=] { return ListCampaigns(*arguments); }; });
  const auto add_name = [&](CLI::App* subcommand) {
    subcommand->add_option("campaign", arguments->name, "NAME, or NAME@ID of one of several")->required();
    arguments->bus.Add(*subcommand);
  };
  auto* status = command->add_subcommand("status", "how far one is, and what its workers do");
  status->add_flag("--json", arguments->as_json, "as JSON");
  add_name(status);
  status->callback([=, &body] { body = [=] { return ShowCampaign(*arguments); }; });
  for (const Control& control : kControls) {
    auto* subcommand = command->add_subcommand(control.word, control.description);
    add_name(subcommand);
    subcommand->callback([=, &body] { body = [=] { return SendControl(*arguments, control); }; });
  }
}

}  // namespace etude::cli
