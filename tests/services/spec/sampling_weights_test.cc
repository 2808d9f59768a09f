// SPDX-License-Identifier: Apache-2.0
// Tests services/spec/sampling_weights.cc
#include "services/spec/sampling_weights.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "tests/support/matchers.h"

namespace etude {
namespace sampling_weights_test {

CampaignSpec Adaptive() {
  CampaignSpec spec;
  spec.adaptive_sampling.share = 0.5;
  return spec;
}

SamplingWeights Flat(const CampaignSpec& spec) {
  SamplingWeights weights;
  for (const auto& task : spec.tasks) weights.tasks[task] = 1;
  for (const auto& object : spec.objects) weights.objects[object] = 1;
  weights.places.assign(kPlaces, 1);
  return weights;
}

TEST(PlaceOf, CountsColumnsAlongXAndRowsAlongY) {
  EXPECT_EQ(PlaceOf(-0.44, 0.11), 0);
  EXPECT_EQ(PlaceOf(0.44, 0.11), 5);
  EXPECT_EQ(PlaceOf(-0.44, 0.41), 6);
  EXPECT_EQ(PlaceOf(0.44, 0.41), 11);
  EXPECT_EQ(PlaceOf(-0.31, 0.25), 0);
  EXPECT_EQ(PlaceOf(-0.29, 0.25), 1) << "columns are 15 cm wide";
  EXPECT_EQ(PlaceOf(-0.31, 0.27), 6) << "rows are 16 cm deep";
}

TEST(PlaceOf, TakesWhatLiesOutsideToTheNearestPlace) {
  EXPECT_EQ(PlaceOf(-9, -9), 0);
  EXPECT_EQ(PlaceOf(9, -9), 5);
  EXPECT_EQ(PlaceOf(1e300, 1e300), 11);
}

// by hand: mean of all 1.25; four more episodes at 1.25 for each; a weight's bound is sqrt(10), and together they stay
// below 10
TEST(WeightsFor, AreShrunkRelativeErrors) {
  CampaignSpec spec = Adaptive();
  spec.adaptive_sampling.largest_ratio = 10;

  const SamplingWeights weights = WeightsFor({{"pick", "cube", 0, 12, 2.0}, {"push", "cube", 11, 12, 0.5}}, spec);

  EXPECT_NEAR(weights.tasks.at("pick"), 1.45, 1e-9);
  EXPECT_NEAR(weights.tasks.at("push"), 0.55, 1e-9);
  EXPECT_EQ(weights.tasks.at("put_down"), 1) << "nothing is known of it";
  EXPECT_EQ(weights.objects.at("cube"), 1) << "as all";
  EXPECT_NEAR(weights.places[0], 1.45, 1e-9);
  EXPECT_NEAR(weights.places[11], 0.55, 1e-9);
}

// by hand as above, with the bound sqrt(3) for each, and 3 for all together: 1.45 is 1.45 sqrt(3) times the least, of
// each of three kinds
TEST(WeightsFor, AreWithinTheBoundTogether) {
  const CampaignSpec spec = Adaptive();
  const double power = std::log(3.0) / (3 * std::log(1.45 * std::sqrt(3.0)));
  const double most = std::pow(1.45, power), least = std::pow(3.0, -power / 2);
  EXPECT_NEAR(most / least, std::cbrt(3.0), 1e-9);

  const SamplingWeights weights =
      WeightsFor({{"pick", "cube", 0, 12, 2.0}, {"push", "milk", 11, 12, 0.5}, {"", "coke", 5, 4, 1.25}}, spec);

  EXPECT_NEAR(weights.tasks.at("pick"), most, 1e-9);
  EXPECT_NEAR(weights.tasks.at("push"), least, 1e-9);
  EXPECT_EQ(weights.tasks.at("put_down"), 1) << "nothing is known of it";
  EXPECT_NEAR(weights.objects.at("cube"), most, 1e-9);
  EXPECT_NEAR(weights.objects.at("milk"), least, 1e-9);
  EXPECT_NEAR(weights.objects.at("coke"), 1, 1e-9);
  EXPECT_EQ(weights.objects.at("bread"), 1);
  ASSERT_EQ(weights.places.size(), static_cast<std::size_t>(kPlaces));
  EXPECT_NEAR(weights.places[0], most, 1e-9);
  EXPECT_NEAR(weights.places[11], least, 1e-9);
  EXPECT_EQ(weights.places[7], 1);
  EXPECT_THAT(CheckWeights(weights, spec), IsOk());
}

TEST(WeightsFor, FewEpisodesSayLess) {
  const CampaignSpec spec = Adaptive();
  const auto of = [&](std::uint64_t episodes) {
    return WeightsFor({{"pick", "cube", 0, episodes, 1.5}, {"push", "cube", 0, 50, 1}}, spec).tasks.at("pick");
  };
  EXPECT_GT(of(1), 1);
  EXPECT_LT(of(1), of(3));
  EXPECT_LT(of(3), of(12));
}

TEST(WeightsFor, OneHugeErrorCountsAsTen) {
  const CampaignSpec spec = Adaptive();
  const auto of = [&](double error) {
    return WeightsFor({{"pick", "cube", 0, 1, error}, {"push", "milk", 1, 90, 1}}, spec);
  };
  EXPECT_EQ(of(1e6), of(kLargestRelativeError));
  EXPECT_NE(of(5), of(kLargestRelativeError));
}

TEST(WeightsFor, WithoutErrorsEverythingIsAlike) {
  const CampaignSpec spec = Adaptive();
  EXPECT_EQ(WeightsFor({{"pick", "cube", 0, 3, 0}, {"push", "milk", 1, 3, 0}}, spec), Flat(spec));
  EXPECT_EQ(WeightsFor({}, spec), Flat(spec));
}

// whatever is published, no task comes more often than the ratio times its usual share
TEST(WeightsFor, StayWithinTheBoundWhateverIsPublished) {
  CampaignSpec spec = Adaptive();
  Rng rng(5);
  for (int round = 0; round < 200; ++round) {
    spec.adaptive_sampling.largest_ratio = rng.Uniform(1, 10);
    std::vector<ErrorCell> cells;
    for (std::uint64_t n = 1 + rng.Below(30); n > 0; --n)
      cells.push_back({spec.tasks[rng.Below(3)], spec.objects[rng.Below(6)], static_cast<int>(rng.Below(kPlaces)),
                       1 + rng.Below(1'000'000), std::exp(rng.Uniform(-20, 20))});
    const SamplingWeights weights = WeightsFor(cells, spec);
    ASSERT_THAT(CheckWeights(weights, spec), IsOk());
    double total = 0;
    for (const auto& [task, weight] : weights.tasks) total += weight;
    for (const auto& [task, weight] : weights.tasks) {
      EXPECT_LE(weight / total, spec.adaptive_sampling.largest_ratio / 3 + 1e-9);
      EXPECT_GE(weight / total, 1 / spec.adaptive_sampling.largest_ratio / 3 - 1e-9);
    }
    // nor does a task with an object in a place
    double most = std::ranges::max(weights.places), least = std::ranges::min(weights.places);
    for (const auto* kind : {&weights.tasks, &weights.objects}) {
      const auto [low, high] = std::ranges::minmax_element(*kind, {}, [](const auto& entry) { return entry.second; });
      most *= high->second;
      least *= low->second;
    }
    EXPECT_LE(most / least, spec.adaptive_sampling.largest_ratio + 1e-9);
  }
}

TEST(SamplingWeights, AreTheSameAfterTheirText) {
  const CampaignSpec spec = Adaptive();
  const SamplingWeights weights = WeightsFor({{"pick", "cube", 0, 12, 2.0}, {"push", "milk", 11, 9, 0.77}}, spec);

  const auto again = ParseWeights(WeightsText(weights), spec);

  ASSERT_THAT(again, IsOk());
  EXPECT_EQ(*again, weights);
  EXPECT_EQ(WeightsSha256(*again), WeightsSha256(weights));
  EXPECT_EQ(WeightsSha256(weights).size(), 64u);
  EXPECT_NE(WeightsSha256(weights), WeightsSha256(Flat(spec)));
}

TEST(SamplingWeights, NoneHaveNoTextAndNoHash) {
  EXPECT_EQ(WeightsText({}), "");
  EXPECT_EQ(WeightsSha256({}), "");
  const auto none = ParseWeights("", CampaignSpec());
  ASSERT_THAT(none, IsOk());
  EXPECT_TRUE(none->empty());
}

TEST(ParseWeights, RefusesWhatIsNotTheCampaignsOrOutOfItsBound) {
  const CampaignSpec spec = Adaptive();
  const OrderedJson good = ToJson(Flat(spec));
  ASSERT_THAT(ParseWeights(good.dump(), spec), IsOk());
  const auto refused = [&](const char* says, const std::function<void(OrderedJson&)>& change) {
    OrderedJson bad = good;
    change(bad);
    EXPECT_THAT(ParseWeights(bad.dump(), spec), HasCode(Code::kInvalidArgument)) << bad.dump();
    EXPECT_THAT(ParseWeights(bad.dump(), spec), MessageHas(says)) << bad.dump();
  };
  refused("not in", [](OrderedJson& json) { json["tasks"]["pick"] = 1.7321; });
  refused("not in", [](OrderedJson& json) { json["objects"]["cube"] = 0.577; });
  refused("not in", [](OrderedJson& json) { json["places"][3] = -1; });
  refused("each of the campaign's tasks", [](OrderedJson& json) { json["tasks"].erase("pick"); });
  refused("each of the campaign's tasks", [](OrderedJson& json) { json["tasks"]["rotate"] = 1; });
  refused("each of the campaign's objects", [](OrderedJson& json) { json["objects"]["duck"] = 1; });
  refused("13 places", [](OrderedJson& json) { json["places"].push_back(1); });
  refused("0 places", [](OrderedJson& json) { json.erase("places"); });
  refused("robots", [](OrderedJson& json) { json["robots"] = 1; });
  refused("places", [](OrderedJson& json) { json["places"] = "all"; });
  for (const char* text : {"{", "null", "[]", "7", "[[[[[[[[]]]]]]]]"})
    EXPECT_THAT(ParseWeights(text, spec), HasCode(Code::kInvalidArgument)) << text;
  EXPECT_THAT(ParseWeights(std::string(1 << 20, ' '), spec), MessageHas("too long"));
  EXPECT_THAT(ParseWeights(good.dump(), CampaignSpec()), MessageHas("follows none"));
}

TEST(ErrorCells, AreTheSameAfterTheirText) {
  const CampaignSpec spec = Adaptive();
  const std::vector<ErrorCell> cells{{"pick", "cube", 0, 12, 2.125}, {"", "milk", 11, 1, 0}};
  const auto again = ParseErrorCells(ErrorCellsText(cells), spec);
  ASSERT_THAT(again, IsOk());
  EXPECT_EQ(*again, cells);
}

TEST(ErrorCells, OfTooManyThoseOfTheMostEpisodesAreSaid) {
  const CampaignSpec spec = Adaptive();
  std::vector<ErrorCell> cells(kMostErrorCells + 2, ErrorCell{"pick", "cube", 0, 2, 1});
  cells.front().episodes = 1;
  cells.back().episodes = 9;
  const auto said = ParseErrorCells(ErrorCellsText(cells), spec);
  ASSERT_THAT(said, IsOk());
  ASSERT_EQ(said->size(), kMostErrorCells);
  EXPECT_EQ(said->front().episodes, 9u);
  EXPECT_EQ(said->back().episodes, 2u);
}

TEST(ParseErrorCells, RefusesWhatIsNotTheCampaigns) {
  const CampaignSpec spec = Adaptive();
  const OrderedJson good = ToJson(std::vector<ErrorCell>{{"pick", "cube", 3, 2, 1.5}});
  ASSERT_THAT(ParseErrorCells(good.dump(), spec), IsOk());
  const auto refused = [&](const char* says, const char* key, const OrderedJson& value) {
    OrderedJson bad = good;
    bad.push_back(good[0]);
    bad[1][key] = value;
    EXPECT_THAT(ParseErrorCells(bad.dump(), spec), HasCode(Code::kInvalidArgument)) << bad.dump();
    EXPECT_THAT(ParseErrorCells(bad.dump(), spec), MessageHas(says)) << bad.dump();
  };
  refused("cell 1: no such task", "task", "rotate");
  refused("cell 1: no such object", "object", "");
  refused("cell 1: place 12 not in 0..11", "place", kPlaces);
  refused("cell 1: place -1 not in 0..11", "place", -1);
  refused("place", "place", 1e30);
  refused("cell 1: 0 episodes", "episodes", 0);
  refused("episodes", "episodes", -3);
  refused("cell 1: 10000001 episodes", "episodes", 10'000'001);
  refused("cell 1: error -0.5", "error", -0.5);
  refused("error", "error", "big");
  refused("colour", "colour", "red");
  for (const char* text : {"", "{}", "[", "[1]", "[[[[[[]]]]]]", "null"})
    EXPECT_THAT(ParseErrorCells(text, spec), HasCode(Code::kInvalidArgument)) << text;
  EXPECT_THAT(ParseErrorCells("[]", spec), MessageHas("0 cells"));
  OrderedJson many = OrderedJson::array();
  for (std::size_t i = 0; i <= kMostErrorCells; ++i) many.push_back(1);
  EXPECT_THAT(ParseErrorCells(many.dump(), spec), MessageHas("4097 cells"));
  EXPECT_THAT(ParseErrorCells(std::string(1 << 20, '['), spec), MessageHas("too long"));
}

// k of n within four standard deviations of a binomial with probability p
void ExpectBinomial(int k, int n, double p) { EXPECT_NEAR(k, n * p, 4 * std::sqrt(n * p * (1 - p))); }

TEST(DrawWeighted, FollowsTheWeights) {
  Rng rng(3);
  const std::vector<double> weights{0.5, 2, 1.5};
  std::vector<int> counts(3);
  for (int i = 0; i < 4000; ++i) ++counts[DrawWeighted(weights, rng)];
  for (std::size_t k = 0; k < 3; ++k) ExpectBinomial(counts[k], 4000, weights[k] / 4);
  EXPECT_EQ(DrawWeighted({0.1}, rng), 0u);
}

TEST(AcceptPlace, TakesPlacesInProportionToTheirWeights) {
  Rng rng(4);
  std::vector<double> weights(kPlaces, 0.5);
  weights[11] = 1.5;
  int light = 0;
  for (int i = 0; i < 3000; ++i) {
    EXPECT_TRUE(AcceptPlace(weights, 0.44, 0.41, rng)) << "the largest";
    light += AcceptPlace(weights, -0.44, 0.11, rng);
  }
  ExpectBinomial(light, 3000, 1.0 / 3);
}

TEST(AcceptPlace, WithoutWeightsDrawsNothing) {
  Rng rng(4);
  const auto before = rng.state();
  EXPECT_TRUE(AcceptPlace({}, 0, 0, rng));
  EXPECT_EQ(rng.state(), before);
}

}  // namespace sampling_weights_test
}  // namespace etude
