// SPDX-License-Identifier: Apache-2.0
// A training run: state, series, curriculum, graph, checkpoints.
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <limits>
#include <set>

#include "dashboard/server/api/arrays.h"
#include "dashboard/server/api/context.h"
#include "dashboard/server/api/curriculum.h"
#include "dashboard/server/api/graph.h"
#include "dashboard/server/api/series_csv.h"
#include "services/episode/bounded_json.h"
#include "services/monitor/topics.h"

namespace etude::api {
namespace {

using sources::Maybe;
using sources::PartOf;
using sources::TextOf;
using sources::TextOrNull;

// ---- names of figures ---------------------------------------------------------------------------

struct KeyParts {
  std::string kind, name, module, figure;  // "valid", "TAR3D.cm", "TAR3D", "cm"
};

KeyParts PartsOf(const std::string& key) {
  KeyParts parts;
  const auto slash = key.find('/');
  parts.kind = key.substr(0, slash);
  parts.name = key.substr(slash + 1);
  const auto dot = parts.name.find('.');
  if (dot == std::string::npos) return parts;
  parts.module = parts.name.substr(0, dot);
  parts.figure = parts.name.substr(dot + 1);
  return parts;
}

OrderedJson UnitOf(const KeyParts& parts) {
  const auto& figure = parts.figure;
  if (figure == "cm" || figure.ends_with("_cm")) return "cm";
  if (figure == "px" || figure == "deg") return figure;
  if (figure == "accuracy" || figure == "hit" || figure == "noisy" || figure == "unseen" || figure == "gripper" ||
      parts.name == "data_wait")
    return "share";
  if (parts.name == "samples_per_second") return "1/s";
  return nullptr;
}

OrderedJson KeysJson(const sources::MetricsTable& metrics) {
  OrderedJson keys = OrderedJson::array();
  for (const auto& [key, series] : metrics.series()) {
    const auto parts = PartsOf(key);
    keys.push_back({{"key", key},
                    {"kind", parts.kind},
                    {"name", parts.name},
                    {"module", TextOrNull(parts.module)},
                    {"unit", UnitOf(parts)},
                    {"n", series.value.size()},
                    {"nulls", series.nulls},
                    {"last", Maybe(metrics.Last(key))}});
  }
  return keys;
}

std::uint64_t CountOfNulls(const sources::MetricsTable& metrics) {
  std::uint64_t count = 0;
  for (const auto& [key, series] : metrics.series()) count += series.nulls;
  return count;
}

OrderedJson NullsJson(const sources::MetricsTable& metrics) {
  constexpr std::size_t kMost = 100;
  OrderedJson nulls = OrderedJson::array();
  for (const auto& [key, series] : metrics.series())
    for (std::size_t i = 0; i < series.value.size() && series.nulls > 0 && nulls.size() < kMost; ++i)
      if (!std::isfinite(series.value[i]))
        nulls.push_back({{"step", static_cast<std::uint64_t>(series.step[i])}, {"key", key}});
  return nulls;
}

std::vector<std::string> Modules(const OrderedJson& config) {
  std::vector<std::string> names;
  for (const auto& module : PartOf(PartOf(config, "policy"), "modules")) names.push_back(TextOf(module, "name"));
  return names;
}

// How the errors of a quantity are shown: `figure` is its name in validations.
struct ErrorShape {
  const char *figure, *unit;
  double scale;  // shown per unit of the file
  bool from_accuracy;
};

// What a module decodes; "": the config has no such module.
std::string QuantityOf(const OrderedJson& config, const std::string& module) {
  for (const auto& one : PartOf(PartOf(config, "policy"), "modules"))
    if (TextOf(one, "name") == module) return TextOf(PartOf(one, "decoder"), "quantity");
  return "";
}

// By what the module decodes: before its first validation nothing else tells.
ErrorShape ShapeOf(const OrderedJson& config, const std::string& module) {
  const std::string quantity = QuantityOf(config, module);
  if (quantity == "class" || quantity == "task") return {"accuracy", "-", 1, true};
  if (quantity == "pixel") return {"px", "px", 1, false};
  return {"cm", "cm", 100, false};
}

// A goal in the unit that is shown, and the figure of validation that it is held against.
OrderedJson GoalJson(const sources::RunView& view, const std::string& module, double goal) {
  const ErrorShape shape = ShapeOf(view.config, module);
  OrderedJson json{{"module", module},   {"goal", goal * shape.scale}, {"value", nullptr},
                   {"unit", shape.unit}, {"reached", nullptr},         {"key", nullptr}};
  const std::string key = "valid/" + module + "." + shape.figure;
  if (!view.metrics.series().contains(key)) return json;
  json["key"] = key;
  const auto last = view.metrics.Last(key);
  if (!last) return json;
  const double value = shape.from_accuracy ? 1 - *last : *last;
  json["value"] = value;
  json["reached"] = value <= goal * shape.scale;
  return json;
}

OrderedJson GoalsJson(const sources::RunView& view) {
  OrderedJson goals = OrderedJson::array();
  const auto& configured = PartOf(PartOf(view.config, "curriculum"), "goals");
  if (!configured.is_object()) return goals;
  for (const auto& [module, goal] : configured.items())
    if (goal.is_number()) goals.push_back(GoalJson(view, module, goal.get<double>()));
  return goals;
}

// ---- /runs/{id} ---------------------------------------------------------------------------------

// @param id  as it was asked for   @param found  its folder empty: on the bus alone
OrderedJson RunJson(const std::string& id, const sources::Found& found, const sources::RunView& view,
                    const RunState& state) {
  OrderedJson lives = OrderedJson::array();
  for (const auto& life : view.metrics.lives())
    lives.push_back({{"from_step", life.from_step}, {"t", sources::TimeJson(life.t)}});
  OrderedJson end;
  if (const auto& said = view.metrics.end())
    end = {{"cause", said->cause}, {"step", Maybe(said->step)}, {"t", sources::TimeJson(said->t)}};
  OrderedJson json{{"id", id},
                   {"name", found.name},
                   {"folder", TextOrNull(found.shown)},
                   {"path", TextOrNull(found.folder.string())},
                   {"identity", TextOrNull(view.identity)},
                   {"state", state.state},
                   {"updated", sources::TimeJson(state.updated)},
                   {"age_ms", AgeOf(state.updated)},
                   {"live", state.live}};
  json.update(ProgressJson(state));
  json.update(OrderedJson{{"steps", Maybe(state.steps)},
                          {"elapsed_s", Maybe(state.elapsed_s)},
                          {"episodes", Maybe(state.episodes)},
                          {"modules", Modules(view.config)},
                          {"goals", GoalsJson(view)},
                          {"keys", KeysJson(view.metrics)},
                          {"nulls", NullsJson(view.metrics)},
                          {"nulls_total", CountOfNulls(view.metrics)},
                          {"lives", lives},
                          {"end", end},
                          {"dataset", nullptr},
                          {"config", view.config.is_null() ? OrderedJson() : http::ForBrowsers(view.config)},
                          {"torn", view.torn}});
  return json;
}

// What is heard of a run under its name on the bus; null: nothing.
const live::LiveRun* OnBus(const live::LiveView& live, const std::string& id) {
  for (const auto& [identity, run] : live.runs)
    if (BusId(run.presence) == id) return &run;
  return nullptr;
}

Result<http::Answer> Run(Context& context, const http::Request& request) {
  const std::string id = request.Parameter("id");
  const auto live = context.live();
  const auto opened = OpenRun(context, id);
  if (opened) {
    const auto state = StateOf(opened->view.get(), LiveOf(*live, *opened->view));
    return http::JsonAnswer(RunJson(id, opened->source->found(), *opened->view, state));
  }
  const auto* const heard = OnBus(*live, id);
  if (!heard) return Fail(opened.error());
  sources::Found nowhere;
  nowhere.kind = sources::Kind::kRun, nowhere.name = heard->presence.name;
  return http::JsonAnswer(RunJson(id, nowhere, {}, StateOf(nullptr, heard)));
}

// ---- series -------------------------------------------------------------------------------------

std::vector<std::string> KeysOf(const http::Query& query) {
  std::vector<std::string> keys;
  const std::string text = query.Get("keys").value_or("train/loss,valid/loss");
  for (std::size_t begin = 0; begin <= text.size();) {
    const auto comma = std::min(text.find(',', begin), text.size());
    if (comma > begin) keys.push_back(text.substr(begin, comma - begin));
    begin = comma + 1;
  }
  return keys;
}

// "" or a number.
Result<double> Bound(const http::Query& query, const char* key, double fallback) {
  const auto text = query.Get(key);
  if (!text || text->empty()) return fallback;
  if (const auto number = sources::ParseTime(*text)) return *number;
  return Fail(Code::kInvalidArgument, fmt::format("{}={:.40}: not a number", key, *text));
}

Result<std::vector<double>> Abscissa(const sources::Series& series, const std::string& x, double samples_a_step) {
  if (x == "step") return series.step;
  if (x == "time") return series.time;
  if (x == "elapsed") return series.elapsed;
  if (x != "samples")
    return Fail(Code::kInvalidArgument, "x: " + NotKnown(x.substr(0, 40), {"step", "time", "elapsed", "samples"}));
  std::vector<double> samples = series.step;
  for (double& value : samples) value *= samples_a_step;
  return samples;
}

// The step of each bucket's last value.
std::vector<double> StepsOf(const sources::Series& series, const sources::Buckets& buckets) {
  std::vector<double> steps;
  for (const std::size_t index : buckets.index) steps.push_back(series.step[index]);
  return steps;
}

Result<http::Answer> SeriesAnswer(Context& context, const http::Request& request) {
  constexpr std::size_t kMostKeys = 32;
  ETUDE_ASSIGN_OR_RETURN(const OpenedRun opened, OpenRun(context, request.Parameter("id")));
  const double infinity = std::numeric_limits<double>::infinity();
  ETUDE_ASSIGN_OR_RETURN(const double from, Bound(request.query, "from", -infinity));
  ETUDE_ASSIGN_OR_RETURN(const double to, Bound(request.query, "to", infinity));
  ETUDE_ASSIGN_OR_RETURN(const auto points, request.query.Integer("points", 600, 2, 2000));
  const std::string x = request.query.Get("x").value_or("step");
  const double batch = sources::NumberOf(PartOf(opened.view->config, "data"), "batch").value_or(1);
  const auto keys = KeysOf(request.query);
  if (keys.size() > kMostKeys) return Fail(Code::kInvalidArgument, fmt::format("keys: at most {}", kMostKeys));
  store::Safetensors content;
  OrderedJson listed = OrderedJson::array(), nulls = OrderedJson::object();
  for (const auto& key : keys) {
    const auto found = opened.view->metrics.series().find(key);
    if (found == opened.view->metrics.series().end()) continue;  // a module's figures begin with its stage
    ETUDE_ASSIGN_OR_RETURN(const auto abscissa, Abscissa(found->second, x, batch));
    const auto buckets = sources::Bucketed(abscissa, found->second.value, from, to, static_cast<std::size_t>(points));
    content.tensors[key + "/x"] = TensorOf(store::DType::kF64, buckets.x);
    content.tensors[key + "/min"] = TensorOf(store::DType::kF64, buckets.min);
    content.tensors[key + "/max"] = TensorOf(store::DType::kF64, buckets.max);
    content.tensors[key + "/last"] = TensorOf(store::DType::kF64, buckets.last);
    content.tensors[key + "/step"] = TensorOf(store::DType::kF64, StepsOf(found->second, buckets));
    listed.push_back(key);
    nulls[key] = found->second.nulls;
  }
  content.metadata = {{"x", x}, {"keys", listed.dump()}, {"nulls", nulls.dump()}};
  return ArraysAnswer(content);
}

// ---- curriculum, graph --------------------------------------------------------------------------

Result<http::Answer> Curriculum(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const OpenedRun opened, OpenRun(context, request.Parameter("id")));
  const auto state = StateOf(opened.view.get(), LiveOf(*context.live(), *opened.view));
  OrderedJson advances = OrderedJson::array();
  for (const auto& line : opened.view->curriculum) advances.push_back(http::ForBrowsers(line));
  return http::JsonAnswer({{"stages", StagesJson(*opened.view, state)}, {"advances", advances}});
}

Result<http::Answer> Graph(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const OpenedRun opened, OpenRun(context, request.Parameter("id")));
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson json, GraphJson(*opened.view));
  return http::JsonAnswer(json);
}

// ---- checkpoints --------------------------------------------------------------------------------

class Metadata {
 public:
  explicit Metadata(const std::map<std::string, std::string>& values) : values_(values) {}
  std::string Text(const char* key) const {
    const auto found = values_.find(key);
    return found == values_.end() ? "" : found->second;
  }
  OrderedJson TextOrNull(const char* key) const { return sources::TextOrNull(Text(key)); }
  OrderedJson Number(const char* key) const {
    const std::string text = Text(key);
    if (text.empty() || !std::ranges::all_of(text, [](char c) { return c >= '0' && c <= '9'; })) return nullptr;
    return std::strtoull(text.c_str(), nullptr, 10);
  }
  OrderedJson Part(const char* key) const {
    auto json = ParseBoundedJson(Text(key));
    return json && json->is_object() ? std::move(*json) : OrderedJson::object();
  }

 private:
  const std::map<std::string, std::string>& values_;
};

OrderedJson ModulesJson(const OrderedJson& modules, const OrderedJson& config) {
  OrderedJson json = OrderedJson::object();
  for (const auto& [name, record] : modules.items())
    json[name] = {{"quantity", TextOrNull(QuantityOf(config, name))},
                  {"trained_steps", Maybe(sources::UnsignedOf(record, "trained_steps"))},
                  {"error", Maybe(sources::NumberOf(record, "error"))}};
  return json;
}

OrderedJson CheckpointJson(const sources::CheckpointHeader& header, const OrderedJson& config,
                           const OrderedJson& served_by) {
  const Metadata metadata(header.metadata);
  const OrderedJson embodiment = metadata.Part("embodiment");
  const OrderedJson said = metadata.Part("metrics");
  OrderedJson metrics = OrderedJson::object();
  for (const auto& [name, value] : said.items())
    if (value.is_number() || value.is_null()) metrics[name] = value;
  const OrderedJson stage = metadata.Number("stage"), stages = metadata.Number("stages");
  const std::string refused = metadata.Text("refused");
  return {{"file", header.file},
          {"step", metadata.Number("step")},
          {"stage", stage},
          {"stages", stages},
          {"stage_name", metadata.TextOrNull("stage_name")},
          {"bytes", header.stamp.size},
          {"modified", sources::Rfc3339(header.stamp.modified_s())},
          {"sha256", TextOrNull(header.sha256)},
          {"channels", header.channels},
          {"metrics", metrics},
          {"modules", ModulesJson(metadata.Part("modules"), config)},
          {"parameters", header.parameters},
          {"dataset", metadata.TextOrNull("dataset")},
          {"architecture", metadata.TextOrNull("architecture")},
          {"robot", TextOrNull(TextOf(embodiment, "robot"))},
          {"joints", Maybe(sources::UnsignedOf(embodiment, "joints"))},
          {"train_episodes", metadata.Number("train_episodes")},
          {"version", metadata.TextOrNull("version")},
          {"run", metadata.TextOrNull("run")},
          {"control_trained", header.error.empty() && refused.empty() && !stage.is_null() && stage == stages},
          {"refused", TextOrNull(refused)},
          {"error", TextOrNull(header.error)},
          {"served_by", served_by}};
}

// By the hash of what a server says that it serves, or by its step until the file is hashed.
OrderedJson ServedBy(const live::LiveView& live, const std::string& run_id, const sources::CheckpointHeader& header) {
  OrderedJson servers = OrderedJson::array();
  const auto step = Metadata(header.metadata).Number("step");
  for (const auto* server : ServersOf(live, run_id)) {
    const auto& status = server->status;
    if (header.sha256.empty() ? step != status.step : header.sha256 != status.sha256) continue;
    servers.push_back({{"host", status.host}, {"since", sources::TimeJson(static_cast<double>(status.since))}});
  }
  return servers;
}

// Who reads what the run publishes, servers and relays among them: by process, as DDS has discovered it.
OrderedJson SubscribersOf(const live::LiveView& live, const std::string& run_id) {
  constexpr std::size_t kMost = 200;
  OrderedJson subscribers = OrderedJson::array();
  if (run_id.empty()) return subscribers;
  const auto names = monitor::PeerNames(live.processes);
  std::set<std::string> seen{live.participant};
  for (const auto& endpoint : *live.endpoints) {
    if (endpoint.is_writer || endpoint.topic != "etude/blob/published_manifest") continue;
    // bus::Owner::partition: NAME/ID
    const bool of_run =
        std::ranges::any_of(endpoint.partitions, [&](const auto& name) { return name.ends_with("/" + run_id); });
    if (!of_run || !seen.insert(endpoint.participant).second || subscribers.size() >= kMost) continue;
    const auto name = names.find(endpoint.participant);
    subscribers.push_back({{"peer", name == names.end() ? OrderedJson() : OrderedJson(name->second)},
                           {"participant", endpoint.participant}});
  }
  return subscribers;
}

Result<http::Answer> Checkpoints(Context& context, const http::Request& request) {
  const std::string id = request.Parameter("id");
  ETUDE_ASSIGN_OR_RETURN(const OpenedRun opened, OpenRun(context, id));
  context.HashInBackground(opened.source);
  const auto live = context.live();
  OrderedJson rows = OrderedJson::array();
  for (const auto& header : opened.view->checkpoints)
    rows.push_back(CheckpointJson(header, opened.view->config, ServedBy(*live, opened.view->identity, header)));
  const auto state = StateOf(opened.view.get(), LiveOf(*live, *opened.view));
  OrderedJson next;
  const auto every = sources::UnsignedOf(PartOf(opened.view->config, "checkpoint"), "every_steps").value_or(0);
  if (every > 0 && state.state == "running") next = (state.step / every + 1) * every;
  return http::JsonAnswer({{"run", id},
                           {"checkpoints", rows},
                           {"next_step", next},
                           {"subscribers", SubscribersOf(*live, opened.view->identity)}});
}

// What whoever saves it may call it: a name from a folder may have quotes and line ends.
std::string Attachment(const std::string& name) {
  std::string plain = name;
  for (char& c : plain)
    if (!std::isalnum(static_cast<unsigned char>(c)) && c != '-' && c != '_' && c != '.') c = '_';
  return fmt::format("attachment; filename=\"{}\"", plain);
}

Result<http::Answer> CheckpointFile(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const OpenedRun opened, OpenRun(context, request.Parameter("id")));
  const std::string name = request.Parameter("file");
  const auto& headers = opened.view->checkpoints;
  const auto header = std::ranges::find(headers, name, &sources::CheckpointHeader::file);
  if (header == headers.end())
    return Fail(Code::kNotFound, fmt::format("the run has no checkpoint file '{:.100}'", name));
  ETUDE_ASSIGN_OR_RETURN(auto open, sources::OpenBelow(opened.source->found().folder / "checkpoints", header->file));
  http::Answer answer;
  answer.content_type = "application/vnd.safetensors";
  answer.file = http::FileBody{std::make_shared<Descriptor>(std::move(open.file)), open.stamp.size};
  answer.etag = open.stamp.tag();
  answer.headers.emplace_back("Content-Disposition", Attachment(opened.source->found().id + "-" + header->file));
  return answer;
}

// ---- differences --------------------------------------------------------------------------------

void Flatten(const OrderedJson& json, const std::string& path, std::map<std::string, OrderedJson>& leaves) {
  const bool list_of_maps =
      json.is_array() && std::ranges::any_of(json, [](const auto& item) { return item.is_object(); });
  if (json.is_object() && !json.empty()) {
    for (const auto& [key, value] : json.items()) Flatten(value, path.empty() ? key : path + "." + key, leaves);
  } else if (list_of_maps) {
    for (std::size_t i = 0; i < json.size(); ++i) {
      const std::string name = TextOf(json[i], "name");
      Flatten(json[i], fmt::format("{}[{}]", path, name.empty() ? std::to_string(i) : name), leaves);
    }
  } else {
    leaves[path] = http::ForBrowsers(json);
  }
}

// The config of a run, the spec of a dataset or of an evaluation.
Result<OrderedJson> SettingsOf(Context& context, const std::string& id) {
  if (const auto run = OpenRun(context, id)) return run->view->config;
  if (const auto dataset = OpenDataset(context, id)) return dataset->view->info.spec_json;
  ETUDE_ASSIGN_OR_RETURN(const OpenedEval eval, OpenEval(context, id));
  return eval.view->spec;
}

Result<http::Answer> Diff(Context& context, const http::Request& request) {
  constexpr std::size_t kMost = 500;
  const std::string a = request.query.Get("a").value_or(""), b = request.query.Get("b").value_or("");
  std::map<std::string, OrderedJson> first, second;
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson settings_a, SettingsOf(context, a));
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson settings_b, SettingsOf(context, b));
  Flatten(settings_a, "", first);
  Flatten(settings_b, "", second);
  for (const auto& [key, value] : second) first.try_emplace(key);
  OrderedJson keys = OrderedJson::array();
  std::size_t total = 0;
  for (const auto& [key, value] : first) {
    const auto other = second.find(key);
    const OrderedJson theirs = other == second.end() ? OrderedJson() : other->second;
    if (value == theirs) continue;
    if (++total <= kMost) keys.push_back({{"key", key}, {"a", value}, {"b", theirs}});
  }
  return http::JsonAnswer({{"a", a}, {"b", b}, {"total", total}, {"keys", keys}});
}

}  // namespace

Result<OrderedJson> TrainNews(Context& context, const std::string& id, std::uint64_t since) {
  constexpr std::size_t kMost = 20;
  const auto live = context.live();
  const auto opened = OpenRun(context, id);
  const auto* const view = opened ? opened->view.get() : nullptr;
  const auto* const heard = view ? LiveOf(*live, *view) : OnBus(*live, id);
  if (!view && !heard) return Fail(opened.error());
  const RunState state = StateOf(view, heard);
  OrderedJson lines = OrderedJson::array();
  if (view)
    for (const auto& line : view->metrics.LinesAfter(since, kMost)) lines.push_back(http::ForBrowsers(line));
  OrderedJson json{{"run", id}, {"state", state.state}};
  json.update(ProgressJson(state));
  json["lines"] = std::move(lines);
  return json;
}

void AddRunRoutes(http::Router& router, Context& context) {
  const auto add = [&](const std::string& path, auto handler) {
    router.Add("GET", kPrefix + path, http::Lane::kFiles,
               [&context, handler](const http::Request& request) { return handler(context, request); });
  };
  add("/runs/{id}", Run);
  add("/runs/{id}/series", SeriesAnswer);
  add("/runs/{id}/series.csv", SeriesCsv);
  add("/runs/{id}/curriculum", Curriculum);
  add("/runs/{id}/graph", Graph);
  add("/runs/{id}/checkpoints", Checkpoints);
  add("/runs/{id}/checkpoints/{file}", CheckpointFile);
  add("/diff", Diff);
}

}  // namespace etude::api
