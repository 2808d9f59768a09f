// SPDX-License-Identifier: Apache-2.0
#include "services/spec/sampling_weights.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <vector>

#include "services/core/check.h"
#include "services/core/hash.h"
#include "services/episode/bounded_json.h"
#include "services/spec/object_names.h"

namespace etude {
namespace {

constexpr double kAreaX = 0.45;                // m, the grid covers -kAreaX .. kAreaX
constexpr double kAreaY[] = {0.10, 0.42};      // m
constexpr double kPriorEpisodes = 4;           // that say "as all others", beside those that were looked at
constexpr double kRounding = 1000;             // weights and errors are kept to 1/kRounding
constexpr std::size_t kMostText = 512u << 10;  // bytes
constexpr int kDeepestText = 4;                // levels of JSON
constexpr std::uint64_t kMostEpisodes = 10'000'000;

// Of the weights of a spec: sqrt of its ratio, so that 1 lies in the middle.
double LargestWeight(const CampaignSpec& spec) { return std::sqrt(spec.adaptive_sampling.largest_ratio); }

double Rounded(double value) { return std::round(value * kRounding) / kRounding; }

std::set<std::string> NounsOf(const CampaignSpec& spec) {
  std::set<std::string> nouns;
  for (const auto& object : spec.objects) nouns.insert(ObjectNoun(object));
  return nouns;
}

std::set<std::string> KeysOf(const std::map<std::string, double>& weights) {
  std::set<std::string> keys;
  for (const auto& [key, weight] : weights) keys.insert(key);
  return keys;
}

/// Errors of one kind: by task, by noun or by place.
template <class Key>
class Means {
 public:
  void Add(const Key& key, const ErrorCell& cell) {
    for (Sum* sum : {&sums_[key], &all_}) {
      sum->error += static_cast<double>(cell.episodes) * std::min(cell.error, kLargestRelativeError);
      sum->episodes += static_cast<double>(cell.episodes);
    }
  }
  // relative to the mean of all, shrunk towards it
  double WeightOf(const Key& key, double largest) const {
    const auto it = sums_.find(key);
    if (it == sums_.end() || all_.error <= 0) return 1;
    const double mean = all_.error / all_.episodes;
    const double shrunk = (it->second.error + kPriorEpisodes * mean) / (it->second.episodes + kPriorEpisodes);
    return std::clamp(Rounded(shrunk / mean), 1 / largest, largest);
  }

 private:
  struct Sum {
    double error = 0, episodes = 0;
  };
  std::map<Key, Sum> sums_;
  Sum all_;
};

double SpreadOf(const std::vector<double*>& weights) {
  const auto [least, most] = std::ranges::minmax_element(weights, {}, [](const double* weight) { return *weight; });
  return **most / **least;
}

// The kinds multiply, and each within its bound would let a task, noun and place that meet come the ratio's cube as
// often: by one power, so that what errs more than another still weighs more.
void BoundProduct(double ratio, SamplingWeights& weights) {
  std::vector<double*> tasks, objects, places;
  for (auto& [name, weight] : weights.tasks) tasks.push_back(&weight);
  for (auto& [name, weight] : weights.objects) objects.push_back(&weight);
  for (double& weight : weights.places) places.push_back(&weight);
  const double spread = SpreadOf(tasks) * SpreadOf(objects) * SpreadOf(places);
  if (spread <= ratio) return;
  const double power = std::log(ratio) / std::log(spread);
  for (const auto* kind : {&tasks, &objects, &places})
    for (double* weight : *kind) *weight = std::pow(*weight, power);
}

// What is wrong with a cell; "" when nothing is.
std::string Problem(const ErrorCell& cell, const CampaignSpec& spec, const std::set<std::string>& nouns) {
  if (!cell.task.empty() && std::ranges::count(spec.tasks, cell.task) == 0) return "no such task";
  if (!nouns.contains(cell.object)) return "no such object";
  if (cell.place < 0 || cell.place >= kPlaces) return fmt::format("place {} not in 0..{}", cell.place, kPlaces - 1);
  if (cell.episodes < 1 || cell.episodes > kMostEpisodes) return fmt::format("{} episodes", cell.episodes);
  if (!(cell.error >= 0 && std::isfinite(cell.error))) return fmt::format("error {}", cell.error);
  return "";
}

}  // namespace

void AdaptiveSamplingSpec::Check(std::vector<std::string>& errors) const {
  const auto require = [&](bool good, const std::string& message) {
    if (!good) errors.push_back("adaptive_sampling." + message);
  };
  // of every kSamplingBlock episodes a whole number: less than one would be none
  require(share == 0 || (share >= 0.05 && share <= 0.9), fmt::format("share: {} not in 0.05..0.9, nor 0 (off)", share));
  require(largest_ratio >= 1 && largest_ratio <= 10, fmt::format("largest_ratio: {} not in 1..10", largest_ratio));
  require(every >= 10 && every <= 1'000'000, fmt::format("every: {} not in 10..10^6", every));
}

int PlaceOf(double x, double y) {
  ETUDE_CHECK(std::isfinite(x) && std::isfinite(y), "x={} y={}", x, y);
  const auto cell = [](double value, double low, double high, int cells) {
    return static_cast<int>(std::clamp(std::floor((value - low) / (high - low) * cells), 0.0, cells - 1.0));
  };
  return cell(y, kAreaY[0], kAreaY[1], kPlaceRows) * kPlaceColumns + cell(x, -kAreaX, kAreaX, kPlaceColumns);
}

Status CheckWeights(const SamplingWeights& weights, const CampaignSpec& spec) {
  const auto wrong = [](const std::string& what) { return Fail(Code::kInvalidArgument, "sampling weights: " + what); };
  if (!spec.adaptive_sampling.on()) return wrong("the campaign follows none (adaptive_sampling.share is 0)");
  if (KeysOf(weights.tasks) != std::set<std::string>(spec.tasks.begin(), spec.tasks.end()))
    return wrong("not one for each of the campaign's tasks");
  if (KeysOf(weights.objects) != NounsOf(spec)) return wrong("not one for each of the campaign's objects");
  if (weights.places.size() != kPlaces)
    return wrong(fmt::format("{} places, there are {}", weights.places.size(), kPlaces));
  std::vector<double> all = weights.places;
  for (const auto* named : {&weights.tasks, &weights.objects})
    for (const auto& [key, weight] : *named) all.push_back(weight);
  constexpr double kSlack = 1e-9;  // a square root need not have the same last bit elsewhere
  const double largest = LargestWeight(spec) + kSlack;
  for (const double weight : all)
    if (!(weight >= 1 / largest && weight <= largest))
      return wrong(fmt::format("{} not in {}..{}", weight, 1 / largest, largest));
  return {};
}

std::string WeightsText(const SamplingWeights& weights) { return weights.empty() ? "" : ToJson(weights).dump(); }

std::string WeightsSha256(const SamplingWeights& weights) {
  return weights.empty() ? "" : Sha256Hex(WeightsText(weights));
}

Result<SamplingWeights> ParseWeights(const std::string& text, const CampaignSpec& spec) {
  if (text.empty()) return SamplingWeights();
  const auto json = text.size() <= kMostText ? ParseBoundedJson(text, kDeepestText) : std::nullopt;
  if (!json) return Fail(Code::kInvalidArgument, "sampling weights: not JSON, or too long");
  ETUDE_ASSIGN_OR_RETURN(auto weights, FromJson<SamplingWeights>(*json, "sampling weights"));
  ETUDE_RETURN_IF_ERROR(CheckWeights(weights, spec));
  return weights;
}

std::string ErrorCellsText(std::vector<ErrorCell> cells) {
  if (cells.size() > kMostErrorCells) {
    std::ranges::stable_sort(cells, std::greater(), &ErrorCell::episodes);
    cells.resize(kMostErrorCells);
  }
  for (auto& cell : cells) cell.error = Rounded(cell.error);
  return ToJson(cells).dump();
}

Result<std::vector<ErrorCell>> ParseErrorCells(const std::string& text, const CampaignSpec& spec) {
  const auto wrong = [](const std::string& what) { return Fail(Code::kInvalidArgument, "validation errors: " + what); };
  const auto json = text.size() <= kMostText ? ParseBoundedJson(text, kDeepestText) : std::nullopt;
  if (!json || !json->is_array()) return wrong("not a list in JSON, or too long");
  if (json->empty() || json->size() > kMostErrorCells)
    return wrong(fmt::format("{} cells, not 1..{}", json->size(), kMostErrorCells));
  ETUDE_ASSIGN_OR_RETURN(auto cells, FromJson<std::vector<ErrorCell>>(*json, "validation errors"));
  const std::set<std::string> nouns = NounsOf(spec);
  for (std::size_t i = 0; i < cells.size(); ++i)
    if (const std::string problem = Problem(cells[i], spec, nouns); !problem.empty())
      return wrong(fmt::format("cell {}: {}", i, problem));
  return cells;
}

SamplingWeights WeightsFor(const std::vector<ErrorCell>& cells, const CampaignSpec& spec) {
  ETUDE_CHECK(spec.adaptive_sampling.on());
  Means<std::string> tasks, objects;
  Means<int> places;
  for (const ErrorCell& cell : cells) {
    if (!cell.task.empty()) tasks.Add(cell.task, cell);
    objects.Add(cell.object, cell);
    places.Add(cell.place, cell);
  }
  const double largest = LargestWeight(spec);
  SamplingWeights weights;
  for (const auto& task : spec.tasks) weights.tasks[task] = tasks.WeightOf(task, largest);
  for (const auto& noun : NounsOf(spec)) weights.objects[noun] = objects.WeightOf(noun, largest);
  for (int place = 0; place < kPlaces; ++place) weights.places.push_back(places.WeightOf(place, largest));
  BoundProduct(spec.adaptive_sampling.largest_ratio, weights);
  return weights;
}

std::size_t DrawWeighted(const std::vector<double>& weights, Rng& rng) {
  ETUDE_CHECK(!weights.empty());
  double total = 0;
  for (const double weight : weights) total += weight;
  double left = rng.Uniform() * total;
  for (std::size_t i = 0; i + 1 < weights.size(); ++i) {
    if (left < weights[i]) return i;
    left -= weights[i];
  }
  return weights.size() - 1;
}

bool AcceptPlace(const std::vector<double>& place_weights, double x, double y, Rng& rng) {
  if (place_weights.empty()) return true;
  const double weight = place_weights.at(static_cast<std::size_t>(PlaceOf(x, y)));
  return rng.Bernoulli(weight / std::ranges::max(place_weights));
}

}  // namespace etude
