// SPDX-License-Identifier: Apache-2.0
// `etude campaign list|status|pause|drain|resume|stop`: campaigns that are live on this domain.
#include <fmt/format.h>

#include <cstdio>
#include <optional>
#include <vector>

#include "services/bus/directory.h"
#include "services/bus/topic.h"
#include "services/cli/bus_watch.h"
#include "services/cli/campaign_control.h"
#include "services/cli/command_line.h"
#include "services/cli/top_json.h"
#include "services/cli/top_text.h"
#include "services/core/config.h"
#include "services/core/printable.h"
#include "services/core/stop.h"

namespace etude::cli {
namespace {

using namespace std::chrono_literals;

struct CampaignArguments {
  std::string name;
  bool as_json = false;
  BusArguments bus;
};

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
        fmt::format("{}@{}{}  {}  {}/{}  {:.1f}/min  {} workers  host {}  {}", campaign.presence.name, id,
                    campaign.presence.shards > 1 ? "  " + bus::ShardText(campaign.presence) : "",
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

// The collectors of the campaign that is meant: one, or those of its shards that are there.
// @error kNotFound when none is
Result<std::vector<bus::Presence>> Find(const bus::Participant& participant, const std::string& name) {
  ETUDE_ASSIGN_OR_RETURN(const Selector selector, ParseSelector(name, "campaign"));
  ETUDE_ASSIGN_OR_RETURN(auto directory, bus::Directory::Open(participant));
  ETUDE_ASSIGN_OR_RETURN(auto found, directory.FindCampaign(selector, 2s));
  if (!found.empty()) return found;
  if (StopRequested()) return Fail(Code::kTimeout, "stopped");
  return Fail(Code::kNotFound,
              fmt::format("campaign '{}' is not live on domain {}: `etude campaign list` shows those that are", name,
                          participant.domain()));
}

// What the shards that are there have come to together. A worker that goes from one to the next is one at a time.
OrderedJson SumJson(const BusView& view) {
  bus::CampaignStatus sum;
  OrderedJson shards = OrderedJson::array();
  for (const auto& [id, campaign] : view.campaigns) {
    shards.push_back(StatusJson(campaign));
    if (!campaign.status) continue;
    const bus::CampaignStatus& status = campaign.status->message;
    sum.committed += status.committed;
    sum.total += status.total;
    sum.attempts += status.attempts;
    sum.given_up += status.given_up;
    sum.workers += status.workers;
    sum.rechecked += status.rechecked;
    sum.mismatched += status.mismatched;
    sum.episodes_per_minute += status.episodes_per_minute;
  }
  const bus::Presence& any = view.campaigns.begin()->second.presence;
  return {{"name", any.name},           {"shard_count", any.shards},
          {"committed", sum.committed}, {"total", sum.total},
          {"attempts", sum.attempts},   {"given_up", sum.given_up},
          {"workers", sum.workers},     {"episodes_per_minute", sum.episodes_per_minute},
          {"rechecked", sum.rechecked}, {"mismatched", sum.mismatched},
          {"shards", std::move(shards)}};
}

std::string SumLine(const OrderedJson& sum) {
  return Printable(
      fmt::format("campaign {}  {} of {} shards are there: {} of their {} committed, {} given up  {:.1f}/min",
                  sum["name"].get<std::string>(), sum["shards"].size(), sum["shard_count"].get<std::uint32_t>(),
                  sum["committed"].get<std::uint64_t>(), sum["total"].get<std::uint64_t>(),
                  sum["given_up"].get<std::uint64_t>(), sum["episodes_per_minute"].get<double>()));
}

Status ShowCampaign(const CampaignArguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open({security::Role::kGateway}));
  ETUDE_ASSIGN_OR_RETURN(const auto found, Find(participant, arguments.name));
  ETUDE_ASSIGN_OR_RETURN(auto watch, BusWatch::Open(participant));
  ETUDE_RETURN_IF_ERROR(watch.LookAround(1500ms));
  BusView only{.domain = participant.domain()};
  for (const auto& presence : found)
    if (const auto campaign = watch.view().campaigns.find(presence.id); campaign != watch.view().campaigns.end())
      only.campaigns.insert(*campaign);
  if (only.campaigns.empty()) return Fail(Code::kNotFound, fmt::format("campaign '{}' has just ended", arguments.name));
  const bool shards = found.size() > 1;
  if (arguments.as_json) {
    const OrderedJson json = shards ? SumJson(only) : StatusJson(only.campaigns.begin()->second);
    fmt::print("{}\n", JsonText(json, 1));
    return {};
  }
  fmt::print("{}", TopText(only, MonotonicClock::now()));
  if (shards) fmt::print("{}\n", SumLine(SumJson(only)));
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

// All shards of a campaign are told, also where one of them refuses or does not answer; then its words are the end.
Status SendControl(const CampaignArguments& arguments, const Control& control) {
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open({security::Role::kGateway}));
  ETUDE_ASSIGN_OR_RETURN(const auto found, Find(participant, arguments.name));
  std::vector<Told> all;
  Status ended;
  for (const auto& collector : found) {
    auto told = TellCollector(participant, collector, control.word, {.action = control.action});
    if (told)
      all.push_back(std::move(*told));
    else
      ended = Fail(told.error());
  }
  bool waits = false;
  for (Told& told : all) {
    if (control.action == bus::ControlAction::kDrain) {
      ETUDE_ASSIGN_OR_RETURN(told.status, AwaitDrained(told.collector, told.statuses, std::move(told.status)));
    }
    const bus::CampaignStatus& status = told.status;
    fmt::print("{}: {}, {} of {} committed\n", Printable(told.collector.name + "@" + told.collector.id),
               Printable(status.state), status.committed, status.total);
    waits = waits || status.state == "paused" || status.state == "draining";
  }
  const std::string& name = found.front().name;
  if (waits)
    fmt::print("go on with: etude campaign resume {}{}\n",
               Printable(found.size() > 1 ? name : name + "@" + found.front().id), arguments.bus.Words());
  return ended;
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
