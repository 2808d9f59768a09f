// SPDX-License-Identifier: Apache-2.0
#include "services/cli/results_record.h"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <thread>

#include "services/cli/results_report.h"

namespace etude::cli {
namespace {

Path DefinitionFile(const Path& out, const ResultRow& row) { return out / "rows" / (row.name + ".json"); }

// `json` without the keys that have the value of `defaults`, and without maps that are empty then.
OrderedJson WithoutDefaults(const OrderedJson& json, const OrderedJson& defaults) {
  if (!json.is_object()) return json;
  OrderedJson left = OrderedJson::object();
  for (const auto& [key, value] : json.items())
    if (!defaults.contains(key) || defaults[key] != value) left[key] = value;
  return left;
}

// Of what this or an earlier version wrote.
OrderedJson Normalised(const OrderedJson& definition) {
  if (!definition.is_object()) return definition;
  OrderedJson normal = definition;
  ResultTraining train;
  train.seeds.clear();
  const OrderedJson defaults{
      {"data", ToJson(ResultData())}, {"train", ToJson(train)}, {"eval", ToJson(ResultEvaluation())}};
  for (const auto& [part, values] : defaults.items())
    if (normal.contains(part)) normal[part] = WithoutDefaults(normal[part], values);
  if (normal.contains("begins_with")) {
    normal["begins_with"] = Normalised(normal["begins_with"]);
    // in which scenes that was rolled out changes nothing of what begins with it
    if (normal["begins_with"].is_object()) normal["begins_with"].erase("eval");
  }
  return normal;
}

bool AreOneTraining(const OrderedJson& before, const OrderedJson& now) {
  const OrderedJson first = Normalised(before), second = Normalised(now);
  return first.is_object() && second.is_object() &&
         std::ranges::all_of(std::array{"data", "train", "begins_with"}, [&](const char* part) {
           return first.value(part, OrderedJson()) == second.value(part, OrderedJson());
         });
}

// From the first step on that was another one, what was made: a row that is only evaluated otherwise keeps its runs.
std::vector<std::string> MadeOfAnother(const OrderedJson& written, const ResultRow& row) {
  const OrderedJson now = DefinitionOf(row), before = Normalised(written);
  const auto differs = [&](const char* part) {
    return !before.is_object() || before.value(part, OrderedJson()) != now.value(part, OrderedJson());
  };
  std::vector<std::string> made{fmt::format("rows/{}.json", row.name), fmt::format("eval/{}-[0-9]*", row.name)};
  if (!AreOneTraining(before, now)) made.push_back(fmt::format("runs/{}-[0-9]*", row.name));
  if (differs("data")) made.push_back(fmt::format("data/{}", DatasetName(row)));
  return made;
}

// What OUT says that it holds of the row is `same` as the row now, or it says nothing.
Status CheckWritten(const Path& out, const ResultRow& row,
                    bool (*same)(const OrderedJson& before, const OrderedJson& now)) {
  const Path file = DefinitionFile(out, row);
  std::error_code ignored;
  if (!std::filesystem::exists(file, ignored)) return {};
  ETUDE_ASSIGN_OR_RETURN(const std::string text, ReadTextFile(file));
  const auto before = OrderedJson::parse(text, nullptr, /*allow_exceptions=*/false);
  if (same(before, DefinitionOf(row))) return {};
  return Fail(Code::kInvalidArgument,
              fmt::format("row '{}' is not what '{}' holds of it, made as {} says: to make it "
                          "again, remove there {}; or give another --out",
                          row.name, out.string(), file.string(), fmt::join(MadeOfAnother(before, row), ", ")));
}

// Rollouts that are the same: what they are compared with may have come later.
bool AreOneMeasurement(OrderedJson first, OrderedJson second) {
  for (auto* report : {&first, &second})
    if (report->is_object()) report->erase("comparison");
  return first == second;
}

// Null where it is not there.
OrderedJson ComparisonPart(const OrderedJson& report, const char* key) {
  const OrderedJson* part = FindPart(report, "comparison", key);
  return part ? *part : OrderedJson();
}

// What the folders of the training and its data, which may have been removed, do not say any more.
void KeepTraining(const ResultReport& old, ResultReport* now) {
  if (now->training_s == 0) now->training_s = old.training_s;
  if (now->train > 0) return;
  now->train = old.train;
  now->valid = old.valid;
}

ResultReport ReadAgain(const ResultReport& old, ResultReport now) {
  now.made = old.made;
  // the other row's evaluation may lie in another folder
  const OrderedJson with = ComparisonPart(now.report, "with");
  const bool lost = !ComparisonPart(old.report, "overall").is_null() && ComparisonPart(now.report, "overall").is_null();
  if (lost && (with.is_null() || with == ComparisonPart(old.report, "with")))
    now.report["comparison"] = old.report["comparison"];
  return now;
}

// With AVX-512 training is two to four times as fast (bf16), so that the instruction set belongs to the name.
std::string ProcessorName() {
  std::ifstream lines("/proc/cpuinfo");  // whose size is said to be 0
  std::string name = "unknown processor";
  for (std::string line; std::getline(lines, line);) {
    const auto colon = line.find(": ");
    if (line.starts_with("model name") && colon != std::string::npos) name = line.substr(colon + 2);
    if (line.starts_with("flags")) return name + (line.find(" avx512bw") != std::string::npos ? " with AVX-512" : "");
  }
  return name;
}

}  // namespace

Result<ResultRecords> ResultRecords::Load(const Path& file) {
  std::error_code ignored;
  if (!std::filesystem::exists(file, ignored)) return ResultRecords{};
  ETUDE_ASSIGN_OR_RETURN(const std::string text, ReadTextFile(file));
  const auto json = OrderedJson::parse(text, nullptr, /*allow_exceptions=*/false);
  if (json.is_discarded())
    return Fail(Code::kInvalidArgument, fmt::format("{}: no JSON; move it away to begin a new table", file.string()));
  return FromJson<ResultRecords>(json, file.string());
}

Status ResultRecords::Save(const Path& file) const { return WriteFileAtomically(file, ToJson(*this).dump(1) + "\n"); }

void ResultRecords::Keep(const ResultRow& row, ResultReport report) {
  auto record = std::ranges::find(rows, row.name, &ResultRecord::row);
  if (record == rows.end()) record = rows.insert(rows.end(), ResultRecord{.row = row.name});
  const OrderedJson definition = DefinitionOf(row);
  const auto old = std::ranges::find(record->reports, report.seed, &ResultReport::seed);
  const bool is_known = old != record->reports.end();
  if (is_known && AreOneTraining(record->definition, definition)) KeepTraining(*old, &report);
  if (!IsDefinition(record->definition, definition)) {
    *record = {.row = row.name, .definition = definition};
  } else if (is_known) {
    if (AreOneMeasurement(old->report, report.report)) report = ReadAgain(*old, std::move(report));
    record->reports.erase(old);
  }
  record->reports.push_back(std::move(report));
  std::ranges::sort(record->reports, {}, &ResultReport::seed);
}

std::vector<ResultReport> ResultRecords::Find(const ResultRow& row) const {
  const auto record = std::ranges::find(rows, row.name, &ResultRecord::row);
  if (record == rows.end() || !IsDefinition(record->definition, DefinitionOf(row))) return {};
  return record->reports;
}

OrderedJson DefinitionOf(const ResultRow& row) {
  ResultTraining train = row.train;
  train.seeds.clear();
  OrderedJson definition{{"data", ToJson(row.data)}, {"train", ToJson(train)}, {"eval", ToJson(row.eval)}};
  if (!row.begins_with.is_null()) definition["begins_with"] = row.begins_with;
  return Normalised(definition);
}

bool IsDefinition(const OrderedJson& before, const OrderedJson& now) { return Normalised(before) == Normalised(now); }

Status CheckDefinition(const Path& out, const ResultRow& row) { return CheckWritten(out, row, IsDefinition); }

Status CheckRuns(const Path& out, const ResultRow& row) { return CheckWritten(out, row, AreOneTraining); }

Status KeepDefinition(const Path& out, const ResultRow& row) {
  ETUDE_RETURN_IF_ERROR(CheckDefinition(out, row));
  const Path file = DefinitionFile(out, row);
  std::error_code ignored;
  if (std::filesystem::exists(file, ignored)) return {};
  return WriteFileAtomically(file, DefinitionOf(row).dump(1) + "\n");
}

std::string MadeHere() {
  const auto now = std::chrono::system_clock::to_time_t(std::chrono::system_clock::now());
  return fmt::format("{:%Y-%m-%d}, {}, {} CPUs", fmt::gmtime(now), ProcessorName(),
                     std::max(1U, std::thread::hardware_concurrency()));
}

}  // namespace etude::cli
