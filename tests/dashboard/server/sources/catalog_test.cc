// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/sources/catalog.cc
#include "dashboard/server/sources/catalog.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <set>

#include "tests/dashboard/server/example_folders.h"
#include "tests/support/matchers.h"

namespace etude::sources {
namespace catalog_test {

TEST(Catalog, FindsDatasetsRunsAndEvaluationsByTheirFiles) {
  ExampleFolders lab;
  Catalog catalog({lab.root()});
  std::vector<std::string> found;
  for (const auto& item : *catalog.List()) found.push_back(ToString(item.kind) + " " + item.id + " " + item.eval);
  EXPECT_THAT(found, testing::ElementsAre("dataset lab.data ", "dataset lab.eval_a.rollouts lab.eval_a",
                                          "dataset lab.eval_b.rollouts lab.eval_b",
                                          "dataset lab.eval_other.rollouts lab.eval_other", "run lab.run ",
                                          "eval lab.eval_a ", "eval lab.eval_b ", "eval lab.eval_other "));
  ASSERT_EQ(catalog.Logs()->size(), 1u);
  EXPECT_EQ(catalog.Logs()->front().id, "lab.logs.trainer.log");
}

TEST(Catalog, LogsAreThoseOfLogFoldersAndOfWhatWasFound) {
  ExampleFolders lab;
  for (const char* file : {"run/rank-0.log", "notes/diary.log"})
    ASSERT_THAT(WriteFileAtomically(lab.root() / file, "a line\n"), IsOk());
  Catalog catalog({lab.root()});
  std::set<std::string> ids;
  for (const auto& log : *catalog.Logs()) ids.insert(log.id);
  EXPECT_THAT(ids, testing::ElementsAre("lab.logs.trainer.log", "lab.run.rank-0.log"));
}

// `--out checkpoints/base` is a folder like any other; below a run it holds the run's own files
TEST(Catalog, ARunMayLieInAFolderOfAnyName) {
  ExampleFolders lab;
  WriteExampleRun(lab.root() / "checkpoints" / "base");
  WriteExampleRun(lab.root() / "run" / "checkpoints" / "aside");
  Catalog catalog({lab.root()});
  EXPECT_THAT(catalog.Find(Kind::kRun, "lab.checkpoints.base"), IsOk());
  for (const auto& item : *catalog.List()) EXPECT_EQ(item.shown.find("run/checkpoints"), std::string::npos);
}

// a home folder with a package tree in it said "Nothing found"
TEST(Catalog, AFolderWithMoreInItThanIsLookedAtIsNamed) {
  ExampleFolders lab;
  EXPECT_TRUE(Catalog({lab.root()}).NotSearched().empty());
  Catalog few({lab.root()}, {}, 3);
  EXPECT_THAT(few.NotSearched(), testing::ElementsAre(std::filesystem::canonical(lab.root())));
}

// --dir exp1/lab --dir exp2/lab
TEST(Catalog, FoldersOfOneNameAreToldApartByTheirOrder) {
  ExampleFolders one, two;
  Catalog both({one.root(), two.root()});
  std::map<std::string, Path> folders;
  for (const auto& item : *both.List()) folders[item.shown] = item.folder;
  EXPECT_EQ(folders.at("lab/data"), std::filesystem::canonical(one.root()) / "data");
  EXPECT_EQ(folders.at("lab-2/data"), std::filesystem::canonical(two.root()) / "data");
  EXPECT_EQ(both.Find(Kind::kRun, "lab-2.run")->folder, std::filesystem::canonical(two.root()) / "run");
  std::set<std::string> logs;
  for (const auto& log : *both.Logs()) EXPECT_TRUE(logs.insert(log.id).second) << log.id;
  EXPECT_EQ(logs.size(), 2u);
  // what comes to the first takes no name of the second's
  std::filesystem::remove_all(one.root() / "run");
  EXPECT_EQ(Catalog({one.root(), two.root()}).Find(Kind::kRun, "lab-2.run")->folder,
            std::filesystem::canonical(two.root()) / "run");
}

// before, an id was numbered by the order of the folders, and was another's when one came before it
TEST(Catalog, AnIdIsOfNoOtherFolderWhenOneComes) {
  ExampleFolders lab;
  const auto ids = [&] {
    Catalog catalog({lab.root()});
    std::map<std::string, std::string> by_shown;
    for (const auto& item : *catalog.List()) by_shown[item.shown] = item.id;
    return by_shown;
  };
  WriteExampleEval(lab.root() / "my+data", 0);
  const auto alone = ids();
  EXPECT_THAT(alone.at("lab/my+data"), testing::MatchesRegex("lab\\.my_data-[0-9a-f]{8}"));
  for (const char* name : {"my data", "my_data"}) WriteExampleEval(lab.root() / name, 0);
  const auto beside = ids();
  EXPECT_EQ(beside.at("lab/my+data"), alone.at("lab/my+data"));
  EXPECT_EQ(beside.at("lab/my_data"), "lab.my_data") << "nothing of it had to go";
  EXPECT_NE(beside.at("lab/my data"), beside.at("lab/my+data"));
  Catalog catalog({lab.root()});
  const auto rollouts = catalog.Find(Kind::kDataset, beside.at("lab/my data/rollouts"));
  ASSERT_THAT(rollouts, IsOk());
  EXPECT_EQ(rollouts->eval, beside.at("lab/my data"));

  WriteExampleEval(lab.root() / "a" / "b", 0);
  EXPECT_EQ(ids().at("lab/a/b"), "lab.a.b");
  WriteExampleEval(lab.root() / "a.b", 0);
  const auto both = ids();
  for (const char* shown : {"lab/a/b", "lab/a.b"})
    EXPECT_THAT(both.at(shown), testing::MatchesRegex("lab\\.a\\.b-[0-9a-f]{8}")) << shown;
  EXPECT_NE(both.at("lab/a/b"), both.at("lab/a.b"));
}

TEST(Catalog, WhatChangedLastComesFirstAndTheRestIsCounted) {
  ExampleFolders lab;
  const auto now = std::filesystem::file_time_type::clock::now();
  for (const auto& [name, age] : {std::pair{"eval_a", 3}, {"eval_b", 1}, {"eval_other", 2}})
    for (const auto& entry : std::filesystem::directory_iterator(lab.root() / name))
      std::filesystem::last_write_time(entry.path(), now - std::chrono::hours(age));
  Catalog catalog({lab.root()});
  const auto newest = catalog.NewestOf(Kind::kEval, 2);
  ASSERT_EQ(newest.found.size(), 2u);
  EXPECT_EQ(newest.found[0].id, "lab.eval_b");
  EXPECT_EQ(newest.found[1].id, "lab.eval_other");
  EXPECT_EQ(newest.more, 1u);
  EXPECT_EQ(catalog.NewestOf(Kind::kDataset, 9, Catalog::Role::kDemonstrations).found.size(), 1u);
}

TEST(Catalog, AFolderThatIsOneItselfIsFound) {
  ExampleFolders lab;
  Catalog catalog({lab.root() / "data"});
  ASSERT_EQ(catalog.List()->size(), 1u);
  EXPECT_EQ(catalog.List()->front().id, "data");
}

TEST(Catalog, NamesAreLookedUpAndNeverPaths) {
  ExampleFolders lab;
  Catalog catalog({lab.root()});
  for (const char* id : {"../lab.data", "/etc", "lab/data", "..", ""})
    EXPECT_THAT(catalog.Find(Kind::kDataset, id), HasCode(Code::kNotFound)) << id;
  EXPECT_THAT(catalog.Find(Kind::kRun, "lab.data"), MessageHas("lab.run")) << "says what there is";
}

TEST(Catalog, FollowsNoLink) {
  ExampleFolders lab;
  TemporaryFolder other;
  std::filesystem::create_directory_symlink(lab.root() / "data", other / "linked");
  EXPECT_TRUE(Catalog({other.path()}).List()->empty());
}

}  // namespace catalog_test
}  // namespace etude::sources
