// SPDX-License-Identifier: Apache-2.0
#include "services/cli/results_folder.h"

#include <fmt/format.h>

#include <filesystem>
#include <set>
#include <sstream>

#include "services/campaign/eval_report.h"
#include "services/campaign/history.h"
#include "services/core/config.h"
#include "services/core/hash.h"
#include "services/store/dataset.h"

namespace etude::cli {
namespace {

// Of the first `wanted` episodes: those that the next collector would not try again.
Result<std::uint64_t> CountGivenUp(const store::DatasetReader& dataset, const Path& data, std::uint64_t wanted) {
  ETUDE_ASSIGN_OR_RETURN(const auto indices, dataset.List());
  const std::set<std::uint64_t> committed(indices.begin(), indices.end());
  const auto most = static_cast<std::uint32_t>(dataset.spec().max_attempts);
  std::uint64_t given_up = 0;
  for (const auto& [index, past] : campaign::ReadHistory(data, dataset.spec()).indices)
    if (index < wanted && past.failures >= most && !committed.contains(index)) ++given_up;
  return given_up;
}

}  // namespace

Result<Demonstrations> CountDemonstrations(const Path& data) {
  ETUDE_ASSIGN_OR_RETURN(const auto dataset, store::DatasetReader::Open(data));
  ETUDE_ASSIGN_OR_RETURN(const auto indices, dataset.List());
  Demonstrations count;
  for (const std::uint64_t index : indices) {
    const std::string split = SplitOf(dataset.spec(), index);
    ++(split == "train" ? count.train : split == "valid" ? count.valid : count.test);
  }
  return count;
}

Status CheckWholeDataset(const Path& data, std::uint64_t wanted) {
  ETUDE_ASSIGN_OR_RETURN(const auto dataset, store::DatasetReader::Open(data));
  ETUDE_ASSIGN_OR_RETURN(const Demonstrations count, CountDemonstrations(data));
  if (wanted == 0) wanted = dataset.spec().episodes;
  ETUDE_ASSIGN_OR_RETURN(const std::uint64_t given_up, CountGivenUp(dataset, data, wanted));
  if (count.all() + given_up >= wanted) return {};
  return Fail(Code::kNotFound,
              fmt::format("'{}' has {} of {} demonstrations, and gave {} up: begin again to go on (why attempts "
                          "failed: {})",
                          data.string(), count.all(), wanted, given_up, (data / "attempts.jsonl").string()));
}

Status CheckEvaluated(const Path& evaluation, const Path& checkpoint) {
  const std::string evaluated = campaign::SubjectOf(campaign::ReadReport(evaluation)).sha256;
  std::error_code ignored;
  if (evaluated.empty() || !std::filesystem::exists(checkpoint, ignored)) return {};
  ETUDE_ASSIGN_OR_RETURN(const auto bytes, ReadBinaryFile(checkpoint));
  if (Sha256Hex(bytes) == evaluated) return {};
  return Fail(Code::kInvalidArgument,
              fmt::format("'{}' is of another checkpoint than '{}' is now: to evaluate that one, remove the former",
                          evaluation.string(), checkpoint.string()));
}

namespace {

// What RUN/metrics.jsonl says under `key` in its last line of that kind where that is of the type asked for; null:
// nothing.
OrderedJson AtLastEnd(const Path& run, const char* key, bool (OrderedJson::*is_type)() const noexcept) {
  OrderedJson last;
  const auto text = ReadTextFile(run / "metrics.jsonl");
  if (!text) return last;
  std::istringstream lines(*text);
  for (std::string line; std::getline(lines, line);) {
    // steps, by far the most of the lines, are not parsed
    if (line.find("\"end\"") == std::string::npos) continue;
    const auto json = OrderedJson::parse(line, nullptr, /*allow_exceptions=*/false);
    const auto is = [&](const char* name) { return json.is_object() && json.contains(name); };
    if (is("kind") && json["kind"] == "end" && is(key) && (json[key].*is_type)()) last = json[key];
  }
  return last;
}

}  // namespace

std::optional<double> TrainingSeconds(const Path& run) {
  const OrderedJson seconds = AtLastEnd(run, "elapsed_s", &OrderedJson::is_number);
  return seconds.is_null() ? std::nullopt : std::optional(seconds.get<double>());
}

bool HasFinished(const Path& run) { return AtLastEnd(run, "cause", &OrderedJson::is_string) == "finished"; }

Status CheckFinished(const Path& run) {
  if (HasFinished(run)) return {};
  return Fail(
      Code::kExhausted,
      fmt::format("the training in '{}' was stopped before its end: the same command goes on with it", run.string()));
}

}  // namespace etude::cli
