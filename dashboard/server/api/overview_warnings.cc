// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <sys/statvfs.h>

#include <algorithm>
#include <cstdlib>
#include <map>
#include <set>
#include <string>

#include "dashboard/server/api/curriculum.h"
#include "dashboard/server/api/overview.h"

namespace etude::api {
namespace {

using sources::TextOf;
using sources::TimeJson;

OrderedJson Warning(const char* code, const std::string& text, const std::string& link, double since = 0) {
  return {{"code", code}, {"text", text}, {"since", TimeJson(since)}, {"link", link}};
}

void WarnOfCampaigns(const Overview& all, OrderedJson& warnings) {
  constexpr std::int64_t kSilent_ms = 3000, kNoCommit_ms = 60'000;
  for (const auto& [id, campaign] : all.live->campaigns) {
    if (!campaign.present || !campaign.status) continue;
    const auto& name = campaign.presence.name;
    const bool finished = campaign.complete || campaign.status->committed >= campaign.status->total;
    if (!campaign.status->error.empty())
      warnings.push_back(
          Warning("campaign_error", name + ": " + campaign.status->error, GenerationLink(all, id, campaign)));
    const auto& said = campaign.status->state;
    const bool held = said == "paused" || said == "draining" || said == "stopping";
    if (!finished && !held && campaign.status->workers > 0 && live::AgeMs(campaign.changed) > kNoCommit_ms)
      warnings.push_back(Warning("no_commits",
                                 fmt::format("{}: no commit for {} s with {} workers", name,
                                             live::AgeMs(campaign.changed) / 1000, campaign.status->workers),
                                 "/fleet", WallSeconds() - static_cast<double>(live::AgeMs(campaign.changed)) / 1000));
    for (const auto& [worker, heard] : campaign.workers)
      if (const auto age = live::AgeMs(heard.heard); !finished && age > kSilent_ms && warnings.size() < 50)
        warnings.push_back(Warning("worker_silent", fmt::format("worker {} silent for {} s", worker, age / 1000),
                                   "/fleet?filter=" + worker, WallSeconds() - static_cast<double>(age) / 1000));
  }
  for (const auto& item : all.datasets) {
    if (item.state.given_up > 0 && item.found.eval.empty())
      warnings.push_back(Warning("given_up", fmt::format("{}: {} given up", item.name, item.state.given_up),
                                 "/generation?dataset=" + item.found.id));
    if (item.view && item.view->info.unreadable > 0)
      warnings.push_back(Warning(
          "unreadable",
          fmt::format("{}: {} files unreadable; etude dataset verify says more", item.name, item.view->info.unreadable),
          "/dataset?dataset=" + item.found.id));
  }
}

void WarnOfRuns(const Overview& all, OrderedJson& warnings) {
  constexpr double kDataWait = 0.2;
  for (const auto& item : all.runs) {
    const std::string link = "/training?run=" + item.found.id;
    if (item.state.state == "running" && item.state.data_wait.value_or(0) > kDataWait)
      warnings.push_back(Warning(
          "data_wait", fmt::format("{}: waits for data {:.0f} % of the time", item.name, 100 * *item.state.data_wait),
          link));
    if (item.state.state == "failed") warnings.push_back(Warning("run_failed", item.name + ": training failed", link));
    if (!item.view) continue;
    const auto loss = item.view->metrics.series().find("train/loss");
    if (loss != item.view->metrics.series().end() && loss->second.nulls > 0)
      warnings.push_back(Warning(
          "loss_not_finite", fmt::format("{}: the loss was not finite {} times", item.name, loss->second.nulls), link));
    // the last word on each: what a life before said of it is no matter
    for (const auto& row : StagesJson(*item.view, item.state))
      if (TextOf(row, "cause") == "budget")
        warnings.push_back(Warning("stage_budget",
                                   fmt::format("{}: stage {} ended by its budget, not by its goal", item.name,
                                               sources::UnsignedOf(row, "stage").value_or(0)),
                                   link));
  }
}

// The one that a channel names. Null: none, or one that no server takes.
const sources::CheckpointHeader* HeaderOfChannel(const sources::RunView& run, const std::string& channel) {
  for (const auto& header : run.checkpoints) {
    if (std::ranges::find(header.channels, channel) == header.channels.end()) continue;
    const auto refused = header.metadata.find("refused");
    const bool taken = header.error.empty() && (refused == header.metadata.end() || refused->second.empty());
    return taken && header.metadata.contains("step") ? &header : nullptr;
  }
  return nullptr;
}

// A robot goes on with an older one, and nothing else says so. Where nobody serves the run nobody waits for it, and a
// server that follows no channel serves one file for ever.
void WarnOfUnserved(const Overview& all, OrderedJson& warnings) {
  constexpr double kPatience_s = 60;
  for (const auto& item : all.runs) {
    if (!item.view || item.view->identity.empty()) continue;
    for (const auto* server : ServersOf(*all.live, item.view->identity)) {
      const auto& channel = server->status.channel;
      const auto* newest = channel.empty() ? nullptr : HeaderOfChannel(*item.view, channel);
      if (!newest) continue;
      const std::uint64_t step = std::strtoull(newest->metadata.at("step").c_str(), nullptr, 10);
      const double age = WallSeconds() - newest->stamp.modified_s();
      if (age > kPatience_s && server->status.step < step && warnings.size() < 100)
        warnings.push_back(Warning("checkpoint_unserved",
                                   fmt::format("{}: checkpoint {} is {:.0f} s old, policy on {} serves {}", item.name,
                                               step, age, server->status.host, server->status.step),
                                   "/checkpoints?run=" + item.found.id, newest->stamp.modified_s() + kPatience_s));
    }
  }
}

// Commands that name one reach both, or refuse; shards of one campaign have their name in common on purpose.
void WarnOfNames(const Overview& all, OrderedJson& warnings) {
  const auto warn = [&](const char* kind, const auto& owners, const char* link) {
    std::map<std::string, std::set<std::string>> names;  // name -> what has it
    for (const auto& [id, owner] : owners) {
      const auto& presence = owner.presence;
      if (owner.present) names[presence.name].insert(presence.shards > 0 ? presence.spec_sha256 : id);
    }
    for (const auto& [name, ids] : names)
      if (ids.size() > 1)
        warnings.push_back(Warning(
            "same_name", fmt::format("{} {}s are named {}: say which by NAME@ID", ids.size(), kind, name), link));
  };
  warn("campaign", all.live->campaigns, "/fleet");
  warn("run", all.live->runs, "/checkpoints");
}

void WarnOfDisks(Context& context, OrderedJson& warnings) {
  constexpr double kLeast = 0.1;
  std::set<unsigned long> seen;
  for (const auto& root : context.sources.catalog().roots()) {
    struct statvfs disk {};
    if (::statvfs(root.c_str(), &disk) != 0 || disk.f_blocks == 0 || !seen.insert(disk.f_fsid).second) continue;
    const double free = static_cast<double>(disk.f_bavail) / static_cast<double>(disk.f_blocks);
    if (free < kLeast)
      warnings.push_back(
          Warning("disk", fmt::format("disk of {} {:.0f} % free", root.filename().string(), 100 * free), "/fleet"));
  }
}

// What processes and policy servers say of themselves.
void WarnOfProcesses(const Overview& all, OrderedJson& warnings) {
  constexpr double kLeast = 0.1;
  constexpr std::int64_t kSilent_ms = 3000, kRefusalStands_ms = 600'000;
  const std::set<std::string> lasting{"collector", "etude collect", "trainer", "policy", "relay"};
  std::set<std::string> disks;
  for (const auto& [process, heard] : all.live->processes) {
    const auto& status = heard.message;
    if (warnings.size() >= 100) break;
    // one without a folder says nothing of a disk
    const auto total = static_cast<double>(status.disk_total_bytes);
    const double free = total > 0 ? static_cast<double>(status.disk_free_bytes) / total : 1;
    if (free < kLeast && disks.insert(status.host + status.folder).second)
      warnings.push_back(Warning("disk",
                                 fmt::format("disk of {} on {} {:.0f} % free", status.role, status.host, 100 * free),
                                 "/fleet?filter=" + status.host));
    if (const auto age = live::AgeMs(heard.at); lasting.contains(status.role) && age > kSilent_ms)
      warnings.push_back(Warning("process_silent",
                                 fmt::format("{} on {} silent for {} s", status.role, status.host, age / 1000),
                                 "/fleet?filter=" + status.host, WallSeconds() - static_cast<double>(age) / 1000));
  }
  for (const auto* server : ServersOf(*all.live))
    if (!server->status.last_refusal.empty() && live::AgeMs(server->refused) < kRefusalStands_ms)
      warnings.push_back(
          Warning("policy_refuses",
                  fmt::format("policy on {} refused: {}", server->status.host, server->status.last_refusal), "/logs"));
  for (const auto& [id, campaign] : all.live->campaigns) {
    std::set<std::string> of_campaign;
    for (const auto& [worker, heard] : campaign.workers)
      if (const auto print = all.live->prints.find(worker); print != all.live->prints.end())
        of_campaign.insert(print->second.work);
    if (campaign.present && of_campaign.size() > 1)
      warnings.push_back(
          Warning("fingerprint",
                  campaign.presence.name + ": workers are ready for different work (other specs or files)", "/fleet"));
  }
}

}  // namespace

OrderedJson WarningsJson(Context& context, const Overview& all) {
  OrderedJson warnings = OrderedJson::array();
  WarnOfCampaigns(all, warnings);
  WarnOfRuns(all, warnings);
  WarnOfUnserved(all, warnings);
  WarnOfNames(all, warnings);
  WarnOfDisks(context, warnings);
  WarnOfProcesses(all, warnings);
  for (const auto& text : all.unreadable) warnings.push_back(Warning("unreadable", text, "/logs"));
  for (const auto& [kind, more] : all.more)
    if (more > 0)
      warnings.push_back(Warning("not_shown",
                                 fmt::format("{} more {}s, which changed before those shown, are not shown: name fewer "
                                             "folders with --dir",
                                             more, sources::ToString(kind)),
                                 "/"));
  for (const auto& root : context.sources.catalog().NotSearched())
    warnings.push_back(Warning("not_searched",
                               fmt::format("'{}' has more in it than is looked at: name the folders of datasets, runs "
                                           "and evaluations with --dir",
                                           root.string()),
                               "/"));
  return warnings;
}

}  // namespace etude::api
