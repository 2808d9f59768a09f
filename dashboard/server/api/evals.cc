// SPDX-License-Identifier: Apache-2.0
// Evaluations: reports, rows, videos, and two of them paired.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>

#include "dashboard/server/api/context.h"
#include "services/campaign/eval_comparison.h"
#include "services/core/statistics.h"

namespace etude::api {
namespace {

using sources::Maybe;
using sources::PartOf;
using sources::TextOf;
using sources::TextOrNull;
using sources::UnsignedOf;

// ---- the report ---------------------------------------------------------------------------------

// A row of per_task with what older reports lack filled in.
OrderedJson TaskJson(const OrderedJson& summary, const char* task) {
  OrderedJson json = summary.is_object() ? summary : OrderedJson::object();
  const OrderedJson nothing{{"successes", 0}, {"share", 0.0}, {"low", 0.0}, {"high", 1.0}};
  if (!json.contains("task")) json["task"] = task;
  if (!json.contains("n")) json["n"] = 0;
  if (!json.contains("success")) json["success"] = nothing;
  return json;
}

// What the checkpoint was, as far as the report says: its own words, or the name of a run that eval made of a file,
// "eval-<12 hex digits of its sha256>", and the step of the rows.
OrderedJson CheckpointJson(const sources::EvalView& view) {
  const auto& policy = PartOf(view.report, "policy");
  std::optional<std::uint64_t> step = UnsignedOf(policy, "step");
  std::string sha256 = TextOf(policy, "sha256");
  constexpr std::string_view kPrefix = "eval-";
  if (const auto run = TextOf(view.report, "run"); sha256.empty() && run.starts_with(kPrefix) && run.size() == 17)
    sha256 = run.substr(kPrefix.size());
  if (!step && !view.rows.empty()) step = UnsignedOf(view.rows.back(), "checkpoint_step");
  if (!step && sha256.empty()) return nullptr;
  return {{"step", Maybe(step)}, {"sha256", TextOrNull(sha256)}, {"file", TextOrNull(TextOf(policy, "file"))}};
}

constexpr std::size_t kMostRuns = 1000;  // whose id is looked at
constexpr std::size_t kMostLooked = 40;  // of which checkpoints are

// The run below the folders of which a checkpoint was evaluated: by its id, its hash, or its name.
std::string RunOf(Context& context, const OrderedJson& report, const OrderedJson& checkpoint) {
  const std::string run_id = TextOf(PartOf(report, "policy"), "run_id");
  const std::string hash = TextOf(checkpoint, "sha256");
  const std::string name = TextOf(PartOf(report, "policy"), "run", TextOf(report, "run"));
  const auto all = context.sources.catalog().NewestOf(sources::Kind::kRun, kMostRuns).found;
  if (!run_id.empty())
    for (const auto& found : all)
      if (context.sources.identities().Of(found.folder) == run_id) return found.id;
  std::string by_name;
  for (std::size_t i = 0; i < std::min(all.size(), kMostLooked); ++i) {
    const auto source = context.sources.Run(all[i].id);
    if (!source) continue;
    const auto view = (*source)->View();
    if (!view) continue;
    for (const auto& header : (*view)->checkpoints)
      if (!hash.empty() && header.sha256.starts_with(hash)) return all[i].id;
    if (by_name.empty() && all[i].name == name) by_name = all[i].id;
  }
  return run_id.empty() ? by_name : "";  // one that has an id and is not here is none of the same name
}

OrderedJson ModulesWithErrors(const OrderedJson& overall) {
  std::vector<std::string> modules;
  const auto& errors = PartOf(overall, "error_cm");
  if (errors.is_object())
    for (const auto& [module, error] : errors.items()) modules.push_back(module);
  return modules;
}

// What a report has beyond the usual.
OrderedJson Extra(const OrderedJson& report) {
  static const std::set<std::string> known{"campaign", "run",     "seed",    "episodes", "done",
                                           "per_task", "overall", "latency", "scenes",   "per_episode"};
  OrderedJson extra = OrderedJson::object();
  for (const auto& [key, value] : report.items())
    if (!known.contains(key)) extra[key] = http::ForBrowsers(value);
  return extra;
}

OrderedJson PartOrNull(const OrderedJson& json, const char* key) {
  return PartOf(json, key).is_object() ? http::ForBrowsers(PartOf(json, key)) : OrderedJson();
}

// ---- rows ---------------------------------------------------------------------------------------

// Whether what its policy said was kept; which file that is follows from its index alone.
bool HasInsight(const OrderedJson& row) { return !TextOf(row, "insight").empty(); }

OrderedJson RowJson(const OrderedJson& row, const std::string& id, const std::map<std::uint64_t, std::string>& videos) {
  OrderedJson json = http::ForBrowsers(row);
  for (const char* key : {"task", "target", "reference", "robot", "instruction", "outcome", "seed"})
    if (!json.contains(key) || !json[key].is_string()) json[key] = "";
  for (const char* key : {"index", "steps", "decisions", "latency_steps", "checkpoint_step"})
    if (!json.contains(key) || !json[key].is_number()) json[key] = 0;
  for (const char* key : {"success", "success_latched"})
    if (!json.contains(key) || !json[key].is_boolean()) json[key] = false;
  for (const char* key : {"violations", "disturbed_objects"})
    if (!json.contains(key) || !json[key].is_array()) json[key] = OrderedJson::array();
  for (const char* key : {"error_cm", "error_before_contact_cm"})
    if (!json.contains(key) || !json[key].is_object()) json[key] = OrderedJson::object();
  const auto video = videos.find(UnsignedOf(row, "index").value_or(0));
  json["video"] =
      video == videos.end() ? OrderedJson() : OrderedJson(kPrefix + "/evals/" + id + "/videos/" + video->second);
  json["insight"] = HasInsight(row);
  return json;
}

// "000031-push-timeout.mp4" -> 31; the one with an overlay where there is one
std::map<std::uint64_t, std::string> VideosByIndex(const std::vector<std::string>& names) {
  std::map<std::uint64_t, std::string> videos;
  for (const auto& name : names) {
    char* end = nullptr;
    const auto index = std::strtoull(name.c_str(), &end, 10);
    if (end == name.c_str() || *end != '-') continue;
    // "-overlay.mp4" is sorted before ".mp4"
    if (std::string& known = videos[index]; !known.ends_with("-overlay.mp4")) known = name;
  }
  return videos;
}

Result<http::Answer> RolloutRows(Context& context, const http::Request& request) {
  constexpr std::int64_t kMostRollout = 1'000'000'000;
  const std::string id = request.Parameter("id");
  ETUDE_ASSIGN_OR_RETURN(const OpenedEval opened, OpenEval(context, id));
  ETUDE_ASSIGN_OR_RETURN(const auto offset, request.query.Integer("offset", 0, 0, 10'000'000));
  ETUDE_ASSIGN_OR_RETURN(const auto limit, request.query.Integer("limit", 400, 1, 1000));
  const auto tasks = request.query.All("task"), outcomes = request.query.All("outcome");
  const auto listed = [](const std::vector<std::string>& wanted, const std::string& value) {
    return wanted.empty() || std::ranges::find(wanted, value) != wanted.end();
  };
  const bool one = request.query.Get("index").has_value();
  ETUDE_ASSIGN_OR_RETURN(const auto index, request.query.Integer("index", 0, 0, kMostRollout));
  std::vector<const OrderedJson*> rows;
  for (const auto& row : opened.view->rows)
    if (listed(tasks, TextOf(row, "task")) && listed(outcomes, TextOf(row, "outcome")) &&
        (!one || UnsignedOf(row, "index") == static_cast<std::uint64_t>(index)))
      rows.push_back(&row);
  const auto judged = [](const OrderedJson* row) {
    return std::pair(sources::FlagOf(*row, "success"), sources::FlagOf(*row, "success_latched"));
  };
  if (request.query.Get("sort") == "failures") std::ranges::stable_sort(rows, {}, judged);
  const auto failed = std::ranges::count_if(rows, [&](const auto* row) { return !judged(row).first; });
  const auto first = std::min(rows.size(), static_cast<std::size_t>(offset));
  const auto last = std::min(rows.size(), first + static_cast<std::size_t>(limit));
  const auto videos = VideosByIndex(opened.view->videos);
  OrderedJson page = OrderedJson::array();
  for (std::size_t i = first; i < last; ++i) page.push_back(RowJson(*rows[i], id, videos));
  return http::JsonAnswer({{"total", rows.size()},
                           {"failed", failed},
                           {"next", last < rows.size() ? OrderedJson(last) : OrderedJson()},
                           {"rows", page}});
}

Result<http::Answer> RolloutVideo(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const OpenedEval opened, OpenEval(context, request.Parameter("id")));
  const std::string name = request.Parameter("file");
  if (std::ranges::find(opened.view->videos, name) == opened.view->videos.end())
    return Fail(Code::kNotFound, fmt::format("the evaluation has no video '{:.100}'", name));
  ETUDE_ASSIGN_OR_RETURN(auto open, sources::OpenBelow(opened.source->found().folder / "videos", name));
  http::Answer answer;
  answer.content_type = "video/mp4";
  answer.file = http::FileBody{std::make_shared<Descriptor>(std::move(open.file)), open.stamp.size};
  answer.etag = open.stamp.tag();
  return answer;
}

// ---- pairs --------------------------------------------------------------------------------------

struct PairRow {
  std::uint64_t index = 0, seed = 0;
  std::string task, target;
  bool a = false, b = false, latched_a = false, latched_b = false;
};

// Index -> row; those without one are left out.
std::map<std::uint64_t, const OrderedJson*> ByIndex(const sources::EvalView& view) {
  std::map<std::uint64_t, const OrderedJson*> rows;
  for (const auto& row : view.rows)
    if (const auto index = UnsignedOf(row, "index")) rows[*index] = &row;
  return rows;
}

// @returns what differs where two rollouts of one index are not of the same scene
std::string Difference(const OrderedJson& a, const OrderedJson& b) {
  for (const char* key : {"seed", "task", "target", "robot"})
    if (PartOf(a, key) != PartOf(b, key) && !PartOf(a, key).is_null() && !PartOf(b, key).is_null())
      return fmt::format("{} ({}, there {})", key, PartOf(a, key).dump(), PartOf(b, key).dump());
  return "";
}

// {n, both, only_a, only_b, neither, share_a, share_b, difference, low, high, p}; a is the first
OrderedJson PairJson(const campaign::PairedCounts& counts) {
  const auto share = [&](std::uint64_t successes) {
    return counts.n() == 0 ? 0.0 : static_cast<double>(successes) / static_cast<double>(counts.n());
  };
  const double a = share(counts.both + counts.only_first), b = share(counts.both + counts.only_second);
  const Interval interval = NewcombePairedInterval(counts.both, counts.only_first, counts.only_second, counts.neither);
  return {{"n", counts.n()},
          {"both", counts.both},
          {"only_a", counts.only_first},
          {"only_b", counts.only_second},
          {"neither", counts.neither},
          {"share_a", a},
          {"share_b", b},
          {"difference", a - b},
          {"low", interval.low},
          {"high", interval.high},
          {"p", McNemarExactP(counts.only_first, counts.only_second)}};
}

OrderedJson Counted(const std::vector<PairRow>& rows, const std::string& task, bool PairRow::*a, bool PairRow::*b) {
  campaign::PairedCounts counts;
  for (const auto& row : rows) {
    if (!task.empty() && row.task != task) continue;
    ++(row.*a ? (row.*b ? counts.both : counts.only_first) : (row.*b ? counts.only_second : counts.neither));
  }
  OrderedJson json{{"task", task.empty() ? "overall" : task}};
  json.update(PairJson(counts));
  return json;
}

http::Answer OtherScenes(const std::string& a, const std::string& b, const std::vector<std::string>& differences) {
  const std::string detail =
      fmt::format("{} and {} were not evaluated in the same scenes and by the same rules; different: {}", a, b,
                  fmt::join(differences, ", "));
  http::Answer answer =
      http::Problem(409, "Other scenes or rules", detail,
                    "only evaluations of the same scenes can be paired: the same --seed, tasks and --scenes, and one "
                    "version of Etude and of the tasks' files");
  OrderedJson json = OrderedJson::parse(answer.body);
  json["differences"] = differences;
  answer.body = JsonText(json);
  return answer;
}

// Keys of the specs that make other scenes; none where a spec cannot be had.
std::vector<std::string> SpecDifferences(const OpenedEval& a, const OpenedEval& b) {
  const auto spec = [](const OpenedEval& opened) { return FromJson<CampaignSpec>(opened.view->spec, "spec"); };
  const auto first = spec(a), second = spec(b);
  return first && second ? campaign::SceneDifferences(*first, *second) : std::vector<std::string>{};
}

OrderedJson PairRowsJson(std::vector<PairRow> rows) {
  constexpr std::size_t kMost = 1000;
  std::stable_partition(rows.begin(), rows.end(), [](const PairRow& row) { return row.a != row.b; });
  OrderedJson json = OrderedJson::array();
  for (const auto& row : rows)
    if (json.size() < kMost)
      json.push_back({{"index", row.index},
                      {"seed", std::to_string(row.seed)},
                      {"task", row.task},
                      {"target", row.target},
                      {"a", row.a},
                      {"b", row.b}});
  return json;
}

Result<http::Answer> Pair(Context& context, const http::Request& request) {
  const std::string id_a = request.Parameter("a"), id_b = request.Parameter("b");
  ETUDE_ASSIGN_OR_RETURN(const OpenedEval a, OpenEval(context, id_a));
  ETUDE_ASSIGN_OR_RETURN(const OpenedEval b, OpenEval(context, id_b));
  if (const auto differences = SpecDifferences(a, b); !differences.empty()) return OtherScenes(id_a, id_b, differences);
  if (const auto differences = campaign::RuleDifferences(a.view->report, b.view->report); !differences.empty())
    return OtherScenes(id_a, id_b, differences);
  const auto first = ByIndex(*a.view), second = ByIndex(*b.view);
  std::vector<PairRow> rows;
  std::set<std::string> tasks;
  for (const auto& [index, row] : first) {
    const auto other = second.find(index);
    if (other == second.end()) continue;
    if (const auto difference = Difference(*row, *other->second); !difference.empty())
      return OtherScenes(id_a, id_b, {fmt::format("rollout {}: {}", index, difference)});
    rows.push_back({index, UnsignedOf(*row, "seed").value_or(0), TextOf(*row, "task"), TextOf(*row, "target"),
                    sources::FlagOf(*row, "success"), sources::FlagOf(*other->second, "success"),
                    sources::FlagOf(*row, "success_latched"), sources::FlagOf(*other->second, "success_latched")});
    tasks.insert(rows.back().task);
  }
  OrderedJson json{{"a", id_a}, {"b", id_b}, {"unpaired", first.size() + second.size() - 2 * rows.size()}};
  OrderedJson overall = Counted(rows, "", &PairRow::a, &PairRow::b);
  overall.erase("task");
  json.update(overall);
  json["latched"] = Counted(rows, "", &PairRow::latched_a, &PairRow::latched_b);
  json["per_task"] = OrderedJson::array();
  for (const auto& task : tasks) json["per_task"].push_back(Counted(rows, task, &PairRow::a, &PairRow::b));
  json["rows"] = PairRowsJson(std::move(rows));
  return http::JsonAnswer(json);
}

}  // namespace

std::string RolloutsOf(Context& context, const std::string& eval) {
  std::string rollouts;
  const auto all = context.sources.catalog().List();  // what is shared must outlive the loop
  for (const auto& found : *all)
    if (found.kind == sources::Kind::kDataset && found.eval == eval) rollouts = found.id;
  return rollouts;
}

Result<OrderedJson> EvalJson(Context& context, const std::string& id) {
  ETUDE_ASSIGN_OR_RETURN(const OpenedEval opened, OpenEval(context, id));
  const auto& [source, view] = opened;
  const auto& report = view->report;
  OrderedJson tasks = OrderedJson::array();
  for (const auto& summary : PartOf(report, "per_task")) tasks.push_back(TaskJson(summary, ""));
  const OrderedJson checkpoint = CheckpointJson(*view);
  return OrderedJson{{"id", id},
                     {"name", source->found().name},
                     {"folder", source->found().shown},
                     {"path", source->found().folder.string()},
                     {"state", EvalState(context, source->found(), *view)},
                     {"updated", sources::TimeJson(view->updated)},
                     {"age_ms", AgeOf(view->updated)},
                     {"campaign", TextOf(report, "campaign")},
                     {"run", TextOf(report, "run")},
                     {"run_id", TextOrNull(RunOf(context, report, checkpoint))},
                     {"checkpoint", checkpoint},
                     {"seed", std::to_string(UnsignedOf(report, "seed").value_or(0))},
                     {"episodes", UnsignedOf(report, "episodes").value_or(0)},
                     {"done", view->rows.size()},
                     {"per_task", tasks},
                     {"overall", TaskJson(PartOf(report, "overall"), "overall")},
                     {"modules", ModulesWithErrors(PartOf(report, "overall"))},
                     {"latency", PartOrNull(report, "latency")},
                     {"scenes", PartOrNull(report, "scenes")},
                     {"extra", Extra(report)},
                     {"dataset", TextOrNull(RolloutsOf(context, id))},
                     {"insights", std::ranges::count_if(view->rows, HasInsight)},
                     {"spec", view->spec.is_object() ? http::ForBrowsers(view->spec) : OrderedJson()}};
}

void AddEvalRoutes(http::Router& router, Context& context) {
  const auto add = [&](const std::string& path, auto handler) {
    router.Add("GET", kPrefix + path, http::Lane::kFiles,
               [&context, handler](const http::Request& request) { return handler(context, request); });
  };
  add("/evals/{id}", [](Context& of, const http::Request& request) -> Result<http::Answer> {
    ETUDE_ASSIGN_OR_RETURN(const OrderedJson json, EvalJson(of, request.Parameter("id")));
    return http::JsonAnswer(json);
  });
  add("/evals/{id}/rows", RolloutRows);
  add("/evals/{id}/videos/{file}", RolloutVideo);
  add("/evals/{a}/pair/{b}", Pair);
}

}  // namespace etude::api
