// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/results_config.cc and the shipped table
#include "services/cli/results_config.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "services/core/config_reference.h"

namespace etude::cli {
namespace results_config_test {

using ::testing::HasSubstr;

// "a", "b" and so on: each collects and trains for itself
ResultsConfig Rows(int count) {
  ResultsConfig config;
  for (int k = 0; k < count; ++k) {
    ResultRow row;
    row.name = std::string(1, static_cast<char>('a' + k));
    row.title = "UR5";
    row.data = {.campaign = "quickstart", .episodes = 600};
    row.train.minutes = 10;
    config.rows.push_back(row);
  }
  return config;
}

// "a", and "b", which evaluates its runs
ResultsConfig RunsAndTheirEvaluation() {
  ResultsConfig config = Rows(2);
  config.rows[1].data = {};
  config.rows[1].train = {.runs_of = "a"};
  config.rows[1].compare = "a";
  return config;
}

TEST(ResultsConfig, TheShippedTableIsValid) {
  const auto config = LoadConfig<ResultsConfig>("deploy/docs/results.yaml");
  ASSERT_TRUE(config) << config.error().message;
  const Status valid = config->Validate();
  EXPECT_TRUE(valid) << valid.error().message;
  EXPECT_THAT(MissingFromReference(ConfigReference<ResultsConfig>()), testing::IsEmpty());
}

TEST(ResultsConfig, NamesEveryProblem) {
  ResultsConfig config = Rows(2);
  config.rows[0].train.minutes = 0;
  config.rows[1].name = "a";
  config.rows[1].data.campaign.clear();
  config.rows[1].train.init = "base";
  const Status status = config.Validate();
  ASSERT_FALSE(status);
  for (const char* part : {"a: train: needs minutes or steps", "a: data.campaign: missing", "'a' stands twice",
                           "'base' is no row before it"})
    EXPECT_THAT(status.error().message, HasSubstr(part));
}

TEST(ResultsConfig, GoalsAreThoseThatCanBeMeasured) {
  ResultsConfig config = RunsAndTheirEvaluation();
  config.rows[0].goals = {{"latched", 82.4}, {"minutes", 5}, {"TAR3D", 0.2}};
  config.rows[1].goals = {{"drop", 1.1}, {"p", 0.05}};
  EXPECT_TRUE(config.Validate());
  config.rows[0].goals = {{"lached", 82.4}, {"drop", 1.1}, {"p", 1.0}, {"EE3D", 0}};
  config.rows[1].goals = {{"minutes", 5}};
  const Status status = config.Validate();
  ASSERT_FALSE(status);
  for (const char* part :
       {"a: goals.lached: neither", "a: goals.drop: needs compare", "a: goals.p: needs compare",
        "a: goals.p: must be < 1", "a: goals.EE3D: must be > 0", "b: goals.minutes: not with train.runs_of"})
    EXPECT_THAT(status.error().message, HasSubstr(part));
}

TEST(ResultsConfig, RowsThatAreComparedHaveTheSameSeeds) {
  ResultsConfig config = RunsAndTheirEvaluation();
  config.rows[1].train.seeds = {1, 2};
  EXPECT_THAT(config.Validate().error().message, HasSubstr("b: compare: 'a' has no seed 2"));
  config.rows[0].train.seeds = {2, 1, 3};
  EXPECT_TRUE(config.Validate());
}

// the second of them would train on what the first collected, or not collect at all
TEST(ResultsConfig, RowsThatShareADatasetAskForTheSameOne) {
  ResultsConfig config = Rows(3);
  config.rows[1].data.name = "a";
  EXPECT_TRUE(config.Validate());
  const auto problem = [&](const ResultData& data) {
    ResultsConfig other = config;
    other.rows[1].data = data;
    const Status status = other.Validate();
    return status ? "" : status.error().message;
  };
  const auto differs = HasSubstr("b: data: 'a' is collected for a with another campaign, episodes or set");
  EXPECT_THAT(problem({.name = "a", .campaign = "compact", .episodes = 600}), differs);
  EXPECT_THAT(problem({.name = "a", .campaign = "quickstart", .episodes = 80}), differs);
  EXPECT_THAT(problem({.name = "a", .campaign = "quickstart", .episodes = 600, .set = {"seed=2"}}), differs);
  EXPECT_THAT(problem({.name = "../a", .campaign = "quickstart", .episodes = 600}),
              HasSubstr("b: data.name: '../a' is not a plain name"));
}

TEST(ResultsConfig, ARowMayBeginWithOneThatCameBefore) {
  ResultsConfig config = Rows(2);
  config.rows[1].train.init = "a";
  EXPECT_TRUE(config.Validate());
  std::swap(config.rows[0], config.rows[1]);
  EXPECT_THAT(config.Validate().error().message, HasSubstr("b: train.init: 'a' is no row before it"));
  config.rows[1].train.init = "a";
  EXPECT_THAT(config.Validate().error().message, HasSubstr("a: train.init: 'a' is no row before it")) << "nor itself";
}

// before, hours of other rows passed until it was said of runs that there never are that they had not come to their end
TEST(ResultsConfig, NoRowNeedsRunsThatThereNeverAre) {
  const auto problem = [](ResultTraining train) {
    ResultsConfig config = RunsAndTheirEvaluation();
    config.rows.push_back(config.rows[train.runs_of.empty() ? 0 : 1]);
    config.rows[2].name = "c";
    config.rows[2].compare.clear();
    config.rows[2].train = std::move(train);
    const Status valid = config.Validate();
    return valid ? "" : valid.error().message;
  };
  EXPECT_EQ(problem({.runs_of = "a"}), "");
  EXPECT_THAT(problem({.runs_of = "b"}), HasSubstr("c: train.runs_of: 'b' has no runs of its own"));
  EXPECT_THAT(problem({.minutes = 5, .init = "b"}), HasSubstr("c: train.init: 'b' has no runs of its own"));
  EXPECT_THAT(problem({.seeds = {1, 9}, .runs_of = "a"}), HasSubstr("c: train.runs_of: 'a' has no seed 9"));
  EXPECT_EQ(problem({.minutes = 5, .seeds = {9}, .init = "a"}), "") << "it begins with the first that is there";
}

// the graph is the checkpoint's: another one would be left out without a word
TEST(ResultsConfig, ARowThatBeginsWithAnotherHasNoExperimentOfItsOwn) {
  ResultsConfig config = Rows(2);
  config.rows[0].train.config = "faithful";
  config.rows[1].train.init = "a";
  EXPECT_TRUE(config.Validate());
  config.rows[1].train.config = "faithful";
  EXPECT_THAT(config.Validate().error().message, HasSubstr("b: train.config: not with init"));
}

TEST(ResultsConfig, FoldersHavePlainNamesAndRunsASeed) {
  ResultsConfig config = Rows(1);
  config.rows[0].name = "../elsewhere";
  config.rows[0].train.seeds.clear();
  const Status status = config.Validate();
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().code, Code::kInvalidArgument);
  EXPECT_THAT(status.error().message, HasSubstr("'../elsewhere' is not a plain name"));
  EXPECT_THAT(status.error().message, HasSubstr("train.seeds: needs one"));
  config.rows[0].name = "here";
  config.rows[0].train = {.minutes = 0, .steps = 1};
  EXPECT_TRUE(config.Validate()) << "steps instead of minutes";
}

}  // namespace results_config_test
}  // namespace etude::cli
