// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/api/series_csv.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

namespace etude::api {
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
