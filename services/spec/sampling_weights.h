// SPDX-License-Identifier: Apache-2.0
// Which tasks, objects and places are drawn more often: from the errors that a trainer measures to weights, and draws
// by them. Pure values; the journal of a dataset's weights is services/store/sampling_journal.h.
//
// Weights are factored: one for each task, each noun and each place, that multiply. A table of all their combinations
// would have more cells than a validation split has episodes.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "services/core/result.h"
#include "services/core/rng.h"
#include "services/spec/campaign_spec.h"

namespace etude {

/// The table as a coarse grid, seen from the robot: columns along x, rows along y.
inline constexpr int kPlaceColumns = 6;
inline constexpr int kPlaceRows = 2;
inline constexpr int kPlaces = kPlaceColumns * kPlaceRows;

/// The place of (x, y), m in world, in 0 .. kPlaces - 1: row * kPlaceColumns + column. What lies outside of the grid is
/// in its nearest place. @pre finite
int PlaceOf(double x, double y);

/// Relative frequencies. Value type.
struct SamplingWeights {
  std::map<std::string, double> tasks;    ///< by the names in CampaignSpec::tasks
  std::map<std::string, double> objects;  ///< of the target, by noun (ObjectNoun)
  std::vector<double> places;             ///< (kPlaces), of the target's place at the start

  /// None: everything is drawn as the spec alone says.
  bool empty() const { return tasks.empty() && objects.empty() && places.empty(); }
  bool operator==(const SamplingWeights&) const = default;
  void Visit(auto& v) {
    v("tasks", tasks, "-", "by name");
    v("objects", objects, "-", "by noun");
    v("places", places, "-", "row by row");
  }
};

/// Whether the weights are of the campaign's tasks, nouns and places, all of them and no others, and within its bound:
/// each in 1/sqrt(r) .. sqrt(r), r = largest_ratio. @error kInvalidArgument, also when the campaign follows none
Status CheckWeights(const SamplingWeights& weights, const CampaignSpec& spec);
/// SHA-256; "" of none.
std::string WeightsSha256(const SamplingWeights& weights);
/// JSON; "" of none.
std::string WeightsText(const SamplingWeights& weights);
/// The inverse, of text that is not trusted. @error kInvalidArgument: not weights, or as CheckWeights
Result<SamplingWeights> ParseWeights(const std::string& text, const CampaignSpec& spec);

/// How much a policy errs where one task, one noun and one place meet.
struct ErrorCell {
  std::string task;            ///< of the campaign; "": of a sentence that nobody demonstrated, which tells of no task
  std::string object;          ///< noun
  int place = 0;               ///< of the object at the start
  std::uint64_t episodes = 0;  ///< that were looked at
  double error = 1;            ///< relative to the mean of all

  bool operator==(const ErrorCell&) const = default;
  void Visit(auto& v) {
    v("task", task, "", "of a demonstration, or none");
    v("object", object, "", "noun");
    v("place", place, "-", "of the grid");
    v("episodes", episodes, "-", "looked at");
    v("error", error, "-", "relative to the mean");
  }
};

/// What one message may hold.
inline constexpr std::size_t kMostErrorCells = 4096;
/// A larger relative error is taken for this: one picture misunderstood must not speak for a whole place.
inline constexpr double kLargestRelativeError = 10;

/// JSON. Of more than kMostErrorCells those with the most episodes.
std::string ErrorCellsText(std::vector<ErrorCell> cells);
/// The inverse, of text that is not trusted: a campaign's tasks, nouns and places, finite errors, and not too many.
/// @error kInvalidArgument
Result<std::vector<ErrorCell>> ParseErrorCells(const std::string& text, const CampaignSpec& spec);

/// Weights in proportion to the mean errors, task by task, noun by noun and place by place. Means of few episodes are
/// drawn towards the mean of all; what no cell tells of has weight 1. Of no task, noun and place is the product of
/// their weights more than largest_ratio times that of others: where they would be, all are drawn towards 1 by one
/// power.
/// @pre the spec follows weights; @returns what passes CheckWeights
SamplingWeights WeightsFor(const std::vector<ErrorCell>& cells, const CampaignSpec& spec);

/// An index of `weights`, with probabilities in proportion to them. @pre all > 0, at least one
std::size_t DrawWeighted(const std::vector<double>& weights, Rng& rng);

/// Rejection sampling of places: true with a probability in proportion to the weight of the place of (x, y), and for
/// sure in one of the largest. Without weights always, and nothing is drawn.
bool AcceptPlace(const std::vector<double>& place_weights, double x, double y, Rng& rng);

/// From which index on which weights hold.
struct SamplingEntry {
  std::uint64_t from_index = 0;
  std::string run;         ///< id of the run that asked for them, for people
  std::uint64_t step = 0;  ///< of its training, for people
  SamplingWeights weights;

  bool operator==(const SamplingEntry&) const = default;
  void Visit(auto& v) {
    v("from_index", from_index, "-", "first episode that they hold for");
    v("run", run, "", "that asked for them");
    v("step", step, "steps", "of its training");
    v("weights", weights, "", "that hold from then on");
  }
};

}  // namespace etude
