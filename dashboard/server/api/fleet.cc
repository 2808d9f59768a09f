// SPDX-License-Identifier: Apache-2.0
// GET /fleet: hosts and their workers, from the bus, or from the journals of what has ended.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <map>
#include <set>

#include "dashboard/server/api/context.h"
#include "services/core/statistics.h"

namespace etude::api {
namespace {

using sources::Maybe;
using sources::TextOrNull;

constexpr std::size_t kMostDatasets = 40;
constexpr const char* kUnknownHost = "?";  // of a worker that committed nothing no journal says where it was

struct WorkerRow {
  std::string worker, campaign, phase, strip, last, task, target, robot, stage, print;
  std::optional<std::uint64_t> index, attempt, step;
  std::uint64_t episodes = 0, failures = 0;
  std::optional<double> per_minute;
  double steps_per_s = 0, frames_per_s = 0;
  std::int64_t age_ms = 0;
  bool silent = false;
};

struct HostRow {
  std::string host;
  std::vector<WorkerRow> workers;
  std::vector<const monitor::Heard<bus::ProcessStatus>*> processes;
  std::vector<double> plans;
  std::array<double, bus::kPlanBins> plan_bins{};  // of live workers, who publish a histogram

  std::optional<double> PerMinute() const {
    std::optional<double> sum;
    for (const auto& worker : workers)
      if (worker.per_minute) sum = sum.value_or(0) + *worker.per_minute;
    return sum;
  }
  std::optional<double> Ok() const {
    std::uint64_t good = 0, all = 0;
    for (const auto& worker : workers) good += worker.episodes, all += worker.episodes + worker.failures;
    if (all == 0) return std::nullopt;
    return static_cast<double>(good) / static_cast<double>(all);
  }
  std::int64_t AgeMs() const {
    std::int64_t age = INT64_MAX;
    for (const auto& worker : workers) age = std::min(age, worker.age_ms);
    for (const auto* process : processes) age = std::min(age, live::AgeMs(process->at));
    return age == INT64_MAX ? 0 : age;
  }
  // Plans from the journal, or from the histograms of live workers.
  std::optional<double> PlanQuantile(double q) const {
    if (!plans.empty()) return Quantile(plans, q);
    double all = 0;
    for (const double count : plan_bins) all += count;
    if (all == 0) return std::nullopt;
    double below = 0, edge = 0.01;
    for (std::size_t bin = 0; bin < plan_bins.size(); ++bin, edge *= 2) {
      if (below + plan_bins[bin] >= q * all) return edge;  // the bin's upper edge
      below += plan_bins[bin];
    }
    return edge;
  }
  // One where all agree.
  std::string Versions() const {
    std::set<std::string> versions;
    for (const auto* process : processes) versions.insert(process->message.version);
    return fmt::format("{}", fmt::join(versions, ", "));
  }
  std::string Prints() const {
    std::set<std::string> prints;
    for (const auto& worker : workers)
      if (!worker.print.empty()) prints.insert(worker.print);
    return fmt::format("{}", fmt::join(prints, ", "));
  }
  std::size_t Busy() const {
    return static_cast<std::size_t>(std::ranges::count_if(
        workers, [](const auto& worker) { return !worker.silent && !worker.phase.empty() && worker.phase != "idle"; }));
  }
};

using Hosts = std::map<std::string, HostRow>;

// The source that a campaign on the bus is shown under.
std::string SourceOf(Context& context, const live::LiveCampaign& campaign) {
  for (const auto& found : context.sources.catalog().Demonstrations(kMostDatasets)) {
    const auto source = context.sources.Dataset(found.id);
    if (!source) continue;
    const auto view = (*source)->View();
    if (view && (*view)->info.identity == campaign.presence.id) return found.id;
  }
  return BusId(campaign.presence);
}

Hosts FromBus(Context& context, const live::LiveView& live) {
  const auto now = MonotonicClock::now();
  Hosts hosts;
  for (const auto& [id, campaign] : live.campaigns) {
    if (!campaign.present || campaign.workers.empty()) continue;
    const std::string source = SourceOf(context, campaign);
    for (const auto& [name, heard] : campaign.workers) {
      const auto& status = heard.status;
      WorkerRow row;
      row.worker = name, row.campaign = source, row.phase = status.phase, row.strip = heard.strip;
      row.last = status.last_outcome.empty() ? heard.last : status.last_outcome;
      if (status.token != 0) {
        row.index = status.index, row.attempt = status.attempt;
        row.stage = status.stage;
        if (!status.stage.empty()) row.step = status.step;
      }
      if (const auto print = live.prints.find(name); print != live.prints.end()) row.print = print->second.host;
      row.episodes = status.episodes, row.failures = status.failures;
      row.per_minute = heard.PerMinute(now);
      row.steps_per_s = status.steps_per_second, row.frames_per_s = status.frames_per_second;
      row.age_ms = live::AgeMs(heard.heard), row.silent = heard.Silent(now);
      auto& host = hosts[status.host];
      host.host = status.host;
      host.workers.push_back(std::move(row));
      for (std::size_t bin = 0; bin < std::min(status.plan_histogram.size(), host.plan_bins.size()); ++bin)
        host.plan_bins[bin] += status.plan_histogram[bin];
    }
  }
  for (const auto& [name, heard] : live.processes) {
    auto& host = hosts[heard.message.host];
    host.host = heard.message.host;
    host.processes.push_back(&heard);
  }
  return hosts;
}

// A worker's row on its host, both made where there are none yet.
WorkerRow& WorkerOn(Hosts& hosts, const std::string& host, const std::string& worker, const std::string& campaign) {
  auto& row = hosts[host];
  row.host = host;
  const auto known = std::ranges::find(row.workers, worker, &WorkerRow::worker);
  if (known != row.workers.end()) return *known;
  auto& made = row.workers.emplace_back();
  made.worker = worker, made.campaign = campaign;
  return made;
}

// Of the dataset that changed last and says who made its episodes, and whose attempts failed.
Hosts FromJournals(Context& context) {
  Hosts hosts;
  std::shared_ptr<const sources::DatasetView> newest;
  std::string id;
  for (const auto& found : context.sources.catalog().Demonstrations(kMostDatasets)) {
    const auto source = context.sources.Dataset(found.id);
    if (!source) continue;
    const auto view = (*source)->View();
    if (view && (*view)->info.journal && (!newest || (*view)->info.updated > newest->info.updated))
      newest = *view, id = found.id;
  }
  if (!newest) return hosts;
  std::map<std::string, std::string> host_of;  // by worker: a failure names no host
  const auto age_ms = [](double t) { return static_cast<std::int64_t>((WallSeconds() - t) * 1000); };
  for (const auto& row : newest->rows) {
    if (row.worker.empty()) continue;
    host_of[row.worker] = row.host;
    auto& worker = WorkerOn(hosts, row.host, row.worker, id);
    ++worker.episodes;
    if (row.t) worker.age_ms = age_ms(*row.t);
    if (row.plan_s) hosts[row.host].plans.push_back(*row.plan_s);
  }
  for (const auto& row : newest->failures) {
    if (row.worker.empty()) continue;
    const auto host = host_of.find(row.worker);
    auto& worker = WorkerOn(hosts, host == host_of.end() ? kUnknownHost : host->second, row.worker, id);
    ++worker.failures;
    if (row.t && (worker.episodes == 0 || age_ms(*row.t) < worker.age_ms)) worker.age_ms = age_ms(*row.t);
  }
  return hosts;
}

OrderedJson WorkerJson(const WorkerRow& row, const std::string& host) {
  return {{"worker", row.worker},
          {"host", host},
          {"campaign", row.campaign},
          {"phase", row.phase},
          {"strip", row.strip},
          {"index", Maybe(row.index)},
          {"attempt", Maybe(row.attempt)},
          {"robot", TextOrNull(row.robot)},
          {"task", TextOrNull(row.task)},
          {"target", TextOrNull(row.target)},
          {"stage", TextOrNull(row.stage)},
          {"step", Maybe(row.step)},
          {"last", TextOrNull(row.last)},
          {"episodes", row.episodes},
          {"failures", row.failures},
          {"per_min", Maybe(row.per_minute)},
          {"steps_per_s", row.steps_per_s},
          {"frames_per_s", row.frames_per_s},
          {"age_ms", row.age_ms}};
}

OrderedJson ProcessJson(const monitor::Heard<bus::ProcessStatus>& heard) {
  const auto& status = heard.message;
  const double total = static_cast<double>(status.disk_total_bytes);
  return {{"process", status.process},
          {"role", status.role},
          {"pid", status.pid},
          {"version", status.version},
          {"since", sources::TimeJson(static_cast<double>(status.since))},
          {"rss_mb", static_cast<double>(status.rss_bytes) / 1e6},
          {"cpu", status.cpu},
          {"folder", TextOrNull(status.folder)},
          {"disk_free", total > 0 ? OrderedJson(static_cast<double>(status.disk_free_bytes) / total) : OrderedJson()},
          {"age_ms", live::AgeMs(heard.at)}};
}

// Those that are not workers first: of a host with hundreds of workers they are the ones to be seen.
OrderedJson ProcessesJson(std::vector<const monitor::Heard<bus::ProcessStatus>*> processes, std::size_t most) {
  std::stable_partition(processes.begin(), processes.end(),
                        [](const auto* process) { return process->message.role != "worker"; });
  if (processes.size() > most) processes.resize(most);
  OrderedJson json = OrderedJson::array();
  for (const auto* process : processes) json.push_back(ProcessJson(*process));
  return json;
}

// With so many of its workers, and its processes; its figures are of all of them.
OrderedJson HostJson(const HostRow& host, std::size_t most_workers) {
  OrderedJson workers = OrderedJson::array();
  std::uint64_t episodes = 0, failures = 0;
  for (const auto& worker : host.workers) {
    episodes += worker.episodes, failures += worker.failures;
    if (workers.size() < most_workers) workers.push_back(WorkerJson(worker, host.host));
  }
  std::optional<double> rss_mb, cpu;
  for (const auto* process : host.processes) {
    rss_mb = rss_mb.value_or(0) + static_cast<double>(process->message.rss_bytes) / 1e6;
    cpu = cpu.value_or(0) + process->message.cpu;
  }
  return {{"host", host.host},
          {"slots", host.workers.size()},
          {"busy", host.Busy()},
          {"episodes", episodes},
          {"failures", failures},
          {"per_min", Maybe(host.PerMinute())},
          {"ok", Maybe(host.Ok())},
          {"plan_p50_s", Maybe(host.PlanQuantile(0.5))},
          {"plan_p95_s", Maybe(host.PlanQuantile(0.95))},
          {"rss_mb", Maybe(rss_mb)},
          {"cpu", Maybe(cpu)},
          {"version", TextOrNull(host.Versions())},
          {"fingerprint", TextOrNull(host.Prints())},
          {"age_ms", host.AgeMs()},
          {"processes", ProcessesJson(host.processes, most_workers)},
          {"workers", workers}};
}

// What a worker does follows from its campaign's spec and the episode's index.
void AddTasks(Context& context, std::vector<HostRow*>& hosts) {
  std::map<std::string, std::shared_ptr<sources::DatasetSource>> datasets;  // nullptr: its files are not here
  for (auto* host : hosts)
    for (auto& worker : host->workers) {
      if (!worker.index) continue;
      const auto [dataset, is_new] = datasets.try_emplace(worker.campaign);
      if (is_new) dataset->second = context.sources.Dataset(worker.campaign).value_or(nullptr);
      if (!dataset->second) continue;
      const auto about = dataset->second->About(*worker.index);
      worker.task = about.task, worker.target = about.target, worker.robot = about.robot;
    }
}

bool Fits(const HostRow& host, const WorkerRow& worker, const std::string& text) {
  return text.empty() || host.host.find(text) != std::string::npos || worker.worker.find(text) != std::string::npos ||
         worker.task.find(text) != std::string::npos || worker.phase == text;
}

void Sort(std::vector<HostRow*>& hosts, std::string order) {
  const bool descending = order.starts_with('-');
  if (descending) order.erase(0, 1);
  std::ranges::stable_sort(hosts, [&](const HostRow* a, const HostRow* b) {
    if (descending) std::swap(a, b);
    if (order == "per_min") return a->PerMinute().value_or(-1) < b->PerMinute().value_or(-1);
    if (order == "age") return a->AgeMs() < b->AgeMs();
    if (order == "slots") return a->workers.size() < b->workers.size();
    return a->host < b->host;
  });
}

}  // namespace

namespace {

// Who works; where nobody does, who made what there is, and what runs now besides.
Hosts HostsNow(Context& context, const live::LiveView& view, bool& live) {
  Hosts hosts = FromBus(context, view);
  live = std::ranges::any_of(hosts, [](const auto& item) { return !item.second.workers.empty(); });
  if (live) return hosts;
  Hosts made = FromJournals(context);
  for (auto& [name, host] : made) {
    host.processes = std::move(hosts[name].processes);
    hosts[name] = std::move(host);
  }
  return hosts;
}

}  // namespace

Result<OrderedJson> FleetJson(Context& context, const http::Query& query) {
  ETUDE_ASSIGN_OR_RETURN(const auto offset, query.Integer("offset", 0, 0, 1'000'000));
  ETUDE_ASSIGN_OR_RETURN(const auto limit, query.Integer("limit", 50, 1, 200));
  ETUDE_ASSIGN_OR_RETURN(const auto most_workers, query.Integer("workers", 200, 1, 2000));
  const auto view = context.live();
  bool live = false;
  Hosts hosts = HostsNow(context, *view, live);
  std::vector<HostRow*> rows;
  for (auto& [name, host] : hosts) rows.push_back(&host);
  AddTasks(context, rows);
  const std::string text = query.Get("filter").value_or("");
  std::size_t workers = 0;
  std::optional<double> per_minute;
  std::uint64_t good = 0, all = 0;
  for (auto* host : rows) {
    std::erase_if(host->workers, [&](const WorkerRow& worker) { return !Fits(*host, worker, text); });
    workers += host->workers.size();
    if (const auto rate = host->PerMinute()) per_minute = per_minute.value_or(0) + *rate;
    for (const auto& worker : host->workers) good += worker.episodes, all += worker.episodes + worker.failures;
  }
  std::erase_if(rows, [&](const HostRow* host) {
    const bool named = text.empty() || host->host.find(text) != std::string::npos;
    return host->workers.empty() && (host->processes.empty() || !named);
  });
  Sort(rows, query.Get("sort").value_or("host"));
  const auto first = std::min(rows.size(), static_cast<std::size_t>(offset));
  const auto last = std::min(rows.size(), first + static_cast<std::size_t>(limit));
  OrderedJson page = OrderedJson::array();
  for (std::size_t i = first; i < last; ++i) page.push_back(HostJson(*rows[i], static_cast<std::size_t>(most_workers)));
  return OrderedJson{
      {"total", rows.size()},
      {"workers", workers},
      {"next", last < rows.size() ? OrderedJson(last) : OrderedJson()},
      {"per_min", Maybe(per_minute)},
      {"ok", all == 0 ? OrderedJson() : OrderedJson(static_cast<double>(good) / static_cast<double>(all))},
      {"live", live},
      {"hosts", page}};
}

void AddFleetRoutes(http::Router& router, Context& context) {
  router.Add("GET", kPrefix + "/fleet", http::Lane::kFiles,
             [&context](const http::Request& request) -> Result<http::Answer> {
               ETUDE_ASSIGN_OR_RETURN(const OrderedJson json, FleetJson(context, request.query));
               return http::JsonAnswer(json);
             });
}

}  // namespace etude::api
