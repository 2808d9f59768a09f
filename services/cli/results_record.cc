// SPDX-License-Identifier: Apache-2.0
#include "services/cli/results_record.h"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <thread>

namespace etude::cli {
namespace {

// what changes a row's figures; its words, the paper's figure and the goal do not
OrderedJson DefinitionOf(const ResultRow& row) {
  ResultTraining train = row.train;
  train.seeds.clear();
  return {{"data", ToJson(row.data)}, {"train", ToJson(train)}, {"eval", ToJson(row.eval)}};
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
  if (record->definition != definition) *record = {.row = row.name, .definition = definition};
  std::erase_if(record->reports, [&](const ResultReport& old) { return old.seed == report.seed; });
  record->reports.push_back(std::move(report));
  std::ranges::sort(record->reports, {}, &ResultReport::seed);
}

std::vector<ResultReport> ResultRecords::Find(const ResultRow& row) const {
  const auto record = std::ranges::find(rows, row.name, &ResultRecord::row);
  if (record == rows.end() || record->definition != DefinitionOf(row)) return {};
  return record->reports;
}

OrderedJson BriefReport(const OrderedJson& report) {
  OrderedJson brief = OrderedJson::object();
  for (const char* part : {"overall", "per_task"})
    if (report.is_object() && report.contains(part)) brief[part] = report[part];
  return brief;
}

std::string MadeHere() {
  const auto now = std::chrono::system_clock::to_time_t(std::chrono::system_clock::now());
  return fmt::format("{:%Y-%m-%d}, {}, {} CPUs", fmt::gmtime(now), ProcessorName(),
                     std::max(1U, std::thread::hardware_concurrency()));
}

}  // namespace etude::cli
