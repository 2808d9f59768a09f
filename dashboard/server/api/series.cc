// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/api/series.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "dashboard/server/api/arrays.h"

namespace etude::api {
namespace {

using sources::PartOf;

// ---- in buckets ---------------------------------------------------------------------------------

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

}  // namespace

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

// ---- as one table -------------------------------------------------------------------------------

namespace {

// The lines of one kind of a run.
struct CsvPart {
  std::string run, kind;
  std::map<std::string, const sources::Series*> columns;
};

void AddParts(const OpenedRun& opened, const std::string& run, const std::string& kind, std::vector<CsvPart>& parts) {
  std::map<std::string, CsvPart> own;
  for (const auto& [key, series] : opened.view->metrics.series()) {
    const auto slash = key.find('/');
    if (slash == std::string::npos || (!kind.empty() && key.substr(0, slash) != kind)) continue;
    CsvPart& part = own[key.substr(0, slash)];
    part.run = run;
    part.kind = key.substr(0, slash);
    part.columns[key.substr(slash + 1)] = &series;
  }
  for (auto& [name, part] : own) parts.push_back(std::move(part));
}

// A row for each step at which a line stands.
void AddCsvRows(const CsvPart& part, const std::set<std::string>& names, std::string& text) {
  std::map<double, std::pair<double, double>> rows;  // step -> time, elapsed
  for (const auto& [name, series] : part.columns)
    for (std::size_t i = 0; i < series->step.size(); ++i) rows[series->step[i]] = {series->time[i], series->elapsed[i]};
  std::map<std::string, std::size_t> at;
  for (const auto& [step, moment] : rows) {
    text += fmt::format("{},{},{:.0f},{},{}", part.run, part.kind, step, moment.first, moment.second);
    for (const auto& name : names) {
      text += ",";
      const auto column = part.columns.find(name);
      if (column == part.columns.end()) continue;
      const sources::Series& series = *column->second;
      std::size_t& i = at[name];
      if (i < series.step.size() && series.step[i] == step && std::isfinite(series.value[i]))
        text += fmt::format("{}", series.value[i]);
      while (i < series.step.size() && series.step[i] <= step) ++i;
    }
    text += "\n";
  }
}

}  // namespace

Result<http::Answer> SeriesCsv(Context& context, const http::Request& request) {
  constexpr std::size_t kMostRuns = 8;
  std::vector<std::string> ids{request.Parameter("id")};
  for (const auto& id : request.query.All("run"))
    if (std::ranges::find(ids, id) == ids.end()) ids.push_back(id);
  if (ids.size() > kMostRuns) return Fail(Code::kInvalidArgument, fmt::format("run: at most {} in all", kMostRuns));
  std::vector<OpenedRun> runs;
  std::vector<CsvPart> parts;
  for (const auto& id : ids) {
    ETUDE_ASSIGN_OR_RETURN(auto opened, OpenRun(context, id));
    runs.push_back(std::move(opened));  // it keeps what the parts point at
    AddParts(runs.back(), id, request.query.Get("kind").value_or(""), parts);
  }
  std::set<std::string> names;
  for (const auto& part : parts)
    for (const auto& [name, series] : part.columns) names.insert(name);
  std::string text = "run,kind,step,time,elapsed_s";
  for (const auto& name : names) text += "," + name;
  text += "\n";
  for (const auto& part : parts) AddCsvRows(part, names, text);
  return http::BytesAnswer(std::move(text), "text/csv; charset=utf-8");
}

}  // namespace etude::api
