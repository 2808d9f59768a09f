// SPDX-License-Identifier: Apache-2.0
#include "services/cli/evaluation_record.h"

#include <fmt/format.h>

#include <charconv>
#include <map>
#include <set>
#include <utility>

#include "services/core/config.h"
#include "services/core/hash.h"
#include "services/core/log.h"
#include "services/episode/bounded_json.h"
#include "services/store/safetensors.h"

namespace etude::cli {
namespace {

template <class Number>
Number NumberOf(const std::string& text) {
  Number value = 0;
  std::from_chars(text.data(), text.data() + text.size(), value);
  return value;
}

// The index that a file's name begins with.
std::map<std::uint64_t, std::string> ByIndex(const Path& out, const std::vector<Path>& files) {
  std::map<std::uint64_t, std::string> names;
  for (const auto& file : files)
    names[NumberOf<std::uint64_t>(file.filename().string())] = file.lexically_relative(out).generic_string();
  return names;
}

// Steps of the checkpoints that rollouts ended with.
std::set<std::uint64_t> StepsOf(const OrderedJson& rows) {
  std::set<std::uint64_t> steps;
  for (const auto& row : rows)
    if (row.is_object() && row.contains("checkpoint_step") && row["checkpoint_step"].is_number_unsigned())
      steps.insert(row["checkpoint_step"].get<std::uint64_t>());
  steps.erase(0);  // nothing was decided
  return steps;
}

void NameCheckpoint(const Path& run_folder, const std::set<std::uint64_t>& steps, OrderedJson& report) {
  campaign::EvalSubject subject = campaign::SubjectOf(report);
  if (steps.empty() || (steps.size() == 1 && subject.step == *steps.begin() && !subject.sha256.empty())) return;
  OrderedJson& policy = report["policy"];
  policy["sha256"] = "";
  policy["file"] = "";
  policy["step"] = steps.size() == 1 ? *steps.begin() : 0;
  if (steps.size() > 1 || run_folder.empty()) return;
  const Path file = run_folder / "checkpoints" / fmt::format("{:08}.safetensors", *steps.begin());
  const auto bytes = ReadBinaryFile(file);
  const auto found = bytes ? FactsOfCheckpoint(*bytes, file) : Result<CheckpointFacts>(Fail(bytes.error()));
  if (!found) {
    Log().info("the checkpoint of the evaluation is not named: {}", found.error().message);
    return;
  }
  policy["sha256"] = found->subject.sha256;
  policy["file"] = found->subject.file;
  report["dataset"] = found->subject.dataset;
}

}  // namespace

Result<CheckpointFacts> FactsOfCheckpoint(std::span<const std::uint8_t> bytes, const Path& file) {
  ETUDE_ASSIGN_OR_RETURN(const auto content, store::DecodeSafetensors(bytes, [](std::string_view) { return false; }));
  const auto word = [&](const char* key) {
    const auto found = content.metadata.find(key);
    return found == content.metadata.end() ? std::string() : found->second;
  };
  CheckpointFacts facts;
  facts.refused = word("refused");
  campaign::EvalSubject& subject = facts.subject;
  subject.run = word("run");
  subject.sha256 = Sha256Hex(bytes);
  subject.step = NumberOf<std::uint64_t>(word("step"));
  subject.file = std::filesystem::absolute(file).lexically_normal().string();
  subject.dataset = word("dataset");
  return facts;
}

Result<OrderedJson> CompleteReport(const Path& out, const Path& run_folder, const std::vector<Path>& videos,
                                   const std::vector<Path>& insights) {
  ETUDE_ASSIGN_OR_RETURN(const std::string text, ReadTextFile(out / "eval.json"));
  auto report = ParseBoundedJson(text);
  if (!report || !report->is_object() || !report->contains("per_episode"))
    return Fail(Code::kCorrupt, fmt::format("'{}' is no report of an evaluation", (out / "eval.json").string()));
  const std::pair<const char*, std::map<std::uint64_t, std::string>> files[] = {{"video", ByIndex(out, videos)},
                                                                                {"insight", ByIndex(out, insights)}};
  std::string lines;
  for (auto& row : (*report)["per_episode"]) {
    for (const auto& [key, names] : files)
      if (const auto file = names.find(row.value("index", std::uint64_t{0})); file != names.end())
        row[key] = file->second;
    lines += JsonText(row) + "\n";
  }
  NameCheckpoint(run_folder, StepsOf((*report)["per_episode"]), *report);
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(out / "eval.json", JsonText(*report, 1) + "\n"));
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(out / "eval.jsonl", lines));
  return std::move(*report);
}

}  // namespace etude::cli
