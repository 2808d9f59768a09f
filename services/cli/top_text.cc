// SPDX-License-Identifier: Apache-2.0
#include "services/cli/top_text.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>
#include <vector>

#include "services/bus/directory.h"
#include "services/core/printable.h"
#include "services/episode/bounded_json.h"
#include "services/monitor/sentence.h"

namespace etude::cli {
namespace {

using Time = MonotonicClock::time_point;
using monitor::FactsOf;
using monitor::Grouped;
using monitor::Text;

constexpr double kStale = 3;  // s of silence that are worth a word
constexpr std::size_t kLeastWorkers = 3, kLeastHosts = 2;

template <class Message>
std::string Age(const Heard<Message>& heard, Time now) {
  const double age_s = heard.AgeSeconds(now);
  return age_s > kStale ? fmt::format("silent {:.0f} s", age_s) : fmt::format("{:.1f} s", age_s);
}

std::vector<std::string> CampaignLines(const CampaignView& campaign, Time now) {
  std::string name = campaign.presence.name + "@" + campaign.presence.id;
  if (campaign.presence.shards > 1) name += " " + bus::ShardText(campaign.presence);
  if (!campaign.status) return {fmt::format("campaign {}  on {}: no word yet", name, campaign.presence.host)};
  const bus::CampaignStatus& status = campaign.status->message;
  std::vector<std::string> lines{
      fmt::format("campaign {}  {}  {} attempts, {} given up  {:.1f}/min  {} workers  heard {}", name,
                  Text(FactsOf(campaign.presence.name, status)), Grouped(status.attempts), status.given_up,
                  status.episodes_per_minute, status.workers, Age(*campaign.status, now))};
  if (!status.error.empty()) lines.push_back("  WAITING: " + status.error);
  if (status.rechecked > 0 || status.mismatched > 0)
    lines.push_back(fmt::format("  made again on another host: {}{}", Grouped(status.rechecked),
                                status.mismatched > 0
                                    ? fmt::format("  OTHER BYTES: {} (`recheck_mismatch` in attempts.jsonl names "
                                                  "the hosts)",
                                                  Grouped(status.mismatched))
                                    : ", the same bytes"));
  std::vector<std::string> failures;
  if (const auto json = ParseBoundedJson(status.failures_json, 2); json && json->is_object())
    for (const auto& [reason, count] : json->items())
      if (count.is_number_unsigned()) failures.push_back(fmt::format("{} {}", reason, count.get<std::uint64_t>()));
  if (!failures.empty()) lines.push_back(fmt::format("  failed: {}", fmt::join(failures, "  ")));
  return lines;
}

std::vector<std::string> WorkerLines(const CampaignView& campaign, Time now) {
  std::vector<std::string> lines;
  for (const auto& [name, heard] : campaign.workers) {
    const bus::WorkerStatus& status = heard.message;
    const double planned = status.plan_s / std::max<double>(1, static_cast<double>(status.episodes + status.failures));
    const std::string at = status.token == 0 ? "-" : fmt::format("#{} a{}", status.index, status.attempt);
    lines.push_back(fmt::format("  {:<28} {:<5} {:<10} {:<12} {:>5} {:>6} {:>5}  {:>6.2f} s {:>6.0f}/s  {:<16} {}",
                                name, status.phase, at, status.stage.empty() ? "-" : status.stage, status.step,
                                status.episodes, status.failures, planned, status.steps_per_second,
                                status.last_outcome.empty() ? "-" : status.last_outcome, Age(heard, now)));
  }
  return lines;
}

// Workers by host, each as it was heard last: one that goes from shard to shard is heard in several campaigns.
using Slots = std::map<std::string, const Heard<bus::WorkerStatus>*>;

std::map<std::string, Slots> SlotsByHost(const BusView& view) {
  std::map<std::string, Slots> hosts;
  for (const auto& [id, campaign] : view.campaigns) {
    for (const auto& [name, heard] : campaign.workers) {
      if (heard.message.phase == bus::kGonePhase) continue;
      const auto*& newest = hosts[heard.message.host.empty() ? "?" : heard.message.host][name];
      if (newest == nullptr || newest->at < heard.at) newest = &heard;
    }
  }
  return hosts;
}

std::string HostLine(const std::string& name, const Slots& slots, Time now) {
  std::size_t busy = 0, silent = 0;
  std::uint64_t episodes = 0, failures = 0;
  double steps_per_second = 0;
  for (const auto& [worker, heard] : slots) {
    const bus::WorkerStatus& status = heard->message;
    if (heard->AgeSeconds(now) > kStale)
      ++silent;
    else if (!status.phase.empty() && status.phase != "idle")
      ++busy;
    episodes += status.episodes;
    failures += status.failures;
    steps_per_second += status.steps_per_second;
  }
  return fmt::format("  host {:<23} {} slots, {} busy{}  {} done, {} failed  {:.0f} steps/s", name, slots.size(), busy,
                     silent == 0 ? "" : fmt::format(", {} silent", silent), Grouped(episodes), Grouped(failures),
                     steps_per_second);
}

// At most `most` lines, the last of them how many are left out.
void Shorten(std::vector<std::string>& lines, std::size_t most, const char* what) {
  if (lines.size() <= most) return;
  const std::size_t hidden = lines.size() - most;
  lines.resize(most);
  lines.push_back(fmt::format("  and {} more{}", hidden, what));
}

std::vector<std::string> RunLines(const RunView& run, Time now) {
  std::vector<std::string> lines;
  if (run.status) {
    const bus::TrainStatus& status = run.status->message;
    std::string line = fmt::format("run {}@{}  {}  loss {:.4g}  {:.0f} samples/s  waits {:.1f} %  {} episodes",
                                   run.name, run.id, Text(FactsOf(status)), status.loss, status.samples_per_second,
                                   100 * status.data_wait, Grouped(status.episodes));
    if (!status.finished) line += "  heard " + Age(*run.status, now);
    lines.push_back(line);
    std::string errors;
    if (const auto json = ParseBoundedJson(status.metrics_json, 2); json && json->is_object())
      for (const auto& [name, value] : json->items())
        if (value.is_number() && (name.ends_with(".cm") || name.ends_with(".px") || name.ends_with(".accuracy")))
          errors += fmt::format("  {} {:.3g}", name, value.get<double>());
    if (!errors.empty()) lines.push_back("  validation:" + errors);
  }
  for (const auto& [server, heard] : run.policies) {
    const bus::PolicyStatus& status = heard.message;
    lines.push_back(fmt::format(
        "policy {}@{}  {}  sha256 {:.12}  answered {}, refused {}  p50 {:.1f} ms, p95 {:.1f} ms  on {}  heard {}",
        run.name, run.id, Text(FactsOf(status)), status.sha256, Grouped(status.answered), status.refused, status.p50_ms,
        status.p95_ms, status.host, Age(heard, now)));
    if (!status.last_refusal.empty()) lines.push_back("  refused last: " + status.last_refusal);
  }
  return lines;
}

}  // namespace

std::string StateSentence(const BusView& view, Time now) {
  std::vector<std::string> parts;
  for (const auto& [id, campaign] : view.campaigns) {
    std::string part = campaign.presence.name + ": ";
    part += campaign.status ? Text(FactsOf(campaign.presence.name, campaign.status->message)) : "no word yet";
    if (campaign.status && campaign.status->AgeSeconds(now) > kStale)
      part += fmt::format(" ({})", Age(*campaign.status, now));
    parts.push_back(part);
  }
  for (const auto& [id, run] : view.runs) {
    if (run.status) parts.push_back(run.name + ": " + Text(FactsOf(run.status->message)));
    for (const auto& [server, policy] : run.policies) parts.push_back(run.name + ": " + Text(FactsOf(policy.message)));
  }
  if (parts.empty()) return fmt::format("nothing is live on domain {}", view.domain);
  return fmt::format("{}", fmt::join(parts, "; "));
}

std::string TopText(const BusView& view, Time now, std::size_t rows, std::size_t columns) {
  std::vector<std::string> head{StateSentence(view, now), ""}, workers, tail;
  for (const auto& [id, campaign] : view.campaigns) {
    for (auto& line : CampaignLines(campaign, now)) head.push_back(std::move(line));
    for (auto& line : WorkerLines(campaign, now)) workers.push_back(std::move(line));
  }
  for (const auto& [id, run] : view.runs)
    for (auto& line : RunLines(run, now)) tail.push_back(std::move(line));
  std::vector<std::string> hosts;
  for (const auto& [name, slots] : SlotsByHost(view)) hosts.push_back(HostLine(name, slots, now));
  if (rows > 0) Shorten(hosts, std::max(kLeastHosts, rows / 4), " hosts");
  for (auto& line : hosts) head.push_back(std::move(line));
  if (!workers.empty())
    head.push_back(fmt::format("  {:<28} {:<5} {:<10} {:<12} {:>5} {:>6} {:>5}  {:>8} {:>8}  {:<16} {}", "worker",
                               "does", "episode", "stage", "step", "done", "fail", "plan", "steps", "last", "heard"));
  const std::size_t others = head.size() + tail.size() + 2;
  std::size_t shown = workers.size();
  if (rows > 0 && shown + others > rows)
    shown = std::min(shown, rows > others + kLeastWorkers ? rows - others : kLeastWorkers);
  Shorten(workers, shown, "");
  std::string text;
  for (const auto* part : {&head, &workers, &tail})
    for (const auto& line : *part) text += Printable(line).substr(0, columns > 0 ? columns : line.size()) + "\n";
  return text;
}

}  // namespace etude::cli
