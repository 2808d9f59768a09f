// SPDX-License-Identifier: Apache-2.0
#include "trainer/learn/error_cells.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <tuple>

#include "services/spec/object_names.h"
#include "trainer/policy/loss.h"
#include "trainer/policy/names.h"

namespace etude::learn {
namespace {

struct Mean {
  double sum = 0, count = 0;
  void Add(double value) { sum += value, ++count; }
  double value() const { return sum / count; }
};

/// What a sentence of a sample is about, but for the module and its error; nothing where the object's place is unknown.
std::optional<SentenceError> SentenceErrorOf(const data::EpisodeEntry& entry, const language::Command& command,
                                             bool demonstrated) {
  const Episode& episode = entry.episode();
  const ObjectTrack* const object = episode.FindObject(command.target);
  if (object == nullptr || object->pose.rows() == 0) return std::nullopt;
  const auto pose = object->pose.row(0);
  if (!std::isfinite(pose[0]) || !std::isfinite(pose[1])) return std::nullopt;
  return SentenceError{.episode = entry.number(),
                       .task = demonstrated ? episode.task : "",
                       .object = ObjectNoun(command.target),
                       .place = PlaceOf(pose[0], pose[1])};
}

/// Of each sentence of each sample: (B, S).
using Questions = std::vector<std::vector<std::optional<SentenceError>>>;

Questions QuestionsOf(const ValidationSet& set, const std::vector<data::Sample>& samples) {
  Questions questions;
  for (const data::Sample& sample : samples) {
    const data::EpisodeEntry& entry = *set.snapshot.episodes()[sample.frame.episode];
    auto& asked = questions.emplace_back();
    for (const auto& command : set.maker.CommandsOf(entry.episode(), sample, data::Augment::kNo))
      asked.push_back(SentenceErrorOf(entry, command, asked.empty()));
  }
  return questions;
}

// Whether its error depends on what the sentence names: not the hand's place, not one fixed object's.
bool IsAboutTheSentence(const policy::ModuleConfig& module) {
  const auto entity = data::ParseEntity(module.decoder.entity);
  return entity && (entity->per_sentence() || module.decoder.quantity == "trajectory");
}

// Adds the errors of one metric, (B, S | 1, ...), each as the mean of what is valid of it.
void AddMetric(const std::string& module, const policy::Metric& metric, const Questions& questions,
               std::vector<SentenceError>& errors) {
  const auto shape = metric.values.sizes();
  const auto valid = metric.valid.expand(shape).to(torch::kFloat64).reshape({shape[0], shape[1], -1});
  const auto values = torch::where(valid > 0, metric.values.to(torch::kFloat64).reshape({shape[0], shape[1], -1}),
                                   torch::zeros({}, valid.options()));
  const auto sum = values.sum(-1).to(torch::kCPU), count = valid.sum(-1).to(torch::kCPU);
  const auto sums = sum.accessor<double, 2>(), counts = count.accessor<double, 2>();
  for (std::size_t b = 0; b < questions.size(); ++b) {
    const std::size_t sentences = std::min(questions[b].size(), static_cast<std::size_t>(shape[1]));
    for (std::size_t s = 0; s < sentences; ++s) {
      const auto row = static_cast<std::int64_t>(b), column = static_cast<std::int64_t>(s);
      if (!questions[b][s] || counts[row][column] == 0) continue;
      SentenceError error = *questions[b][s];
      error.module = module;
      error.error = sums[row][column] / counts[row][column];
      if (std::isfinite(error.error)) errors.push_back(std::move(error));
    }
  }
}

void AddModule(const policy::PolicyConfig& config, const policy::ModuleConfig& module,
               const policy::ModuleOutput& output, const policy::Labels& labels, const Questions& questions,
               std::vector<SentenceError>& errors) {
  const policy::Quantity* const quantity = policy::QuantityOf(module);
  if (quantity == nullptr || !IsAboutTheSentence(module)) return;
  const policy::Target target = policy::FindTarget(labels, module.decoder.label());
  if (!target.value.defined()) return;
  for (const auto& metric : quantity->Measure(policy::HeadOf(config, module), output, target))
    if (metric.role == policy::Metric::Role::kError) AddMetric(module.name, metric, questions, errors);
}

}  // namespace

std::vector<ErrorCell> ToErrorCells(const std::vector<SentenceError>& errors) {
  std::map<std::string, Mean> modules;
  for (const auto& error : errors) modules[error.module].Add(error.error);
  struct Cell {
    Mean relative;
    std::set<std::uint64_t> episodes;
  };
  std::map<std::tuple<std::string, std::string, int>, Cell> cells;
  for (const auto& error : errors) {
    const double mean = modules.at(error.module).value();
    if (!(mean > 0)) continue;
    Cell& cell = cells[{error.task, error.object, error.place}];
    cell.relative.Add(std::min(error.error / mean, kLargestRelativeError));
    cell.episodes.insert(error.episode);
  }
  std::vector<ErrorCell> result;
  for (const auto& [key, cell] : cells)
    result.push_back(
        {std::get<0>(key), std::get<1>(key), std::get<2>(key), cell.episodes.size(), cell.relative.value()});
  return result;
}

Result<std::vector<ErrorCell>> MeasureErrors(policy::Policy& policy, const ValidationSet& set) {
  std::vector<SentenceError> errors;
  const auto measure = [&](const std::vector<data::Sample>& samples, const Part& part, const policy::Outputs& outputs) {
    const Questions questions = QuestionsOf(set, samples);
    for (const auto& module : policy.config().modules)
      if (const auto output = outputs.find(module.name); output != outputs.end())
        AddModule(policy.config(), module, output->second, part.labels, questions, errors);
  };
  ETUDE_RETURN_IF_ERROR(VisitBatches(policy, set, measure));
  return ToErrorCells(errors);
}

}  // namespace etude::learn
