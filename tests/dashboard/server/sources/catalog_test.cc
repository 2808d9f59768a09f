// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/sources/catalog.cc
#include "dashboard/server/sources/catalog.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

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

TEST(Catalog, FoldersOfOneNameGetIdsOfTheirOwn) {
  ExampleFolders first, second;
  Catalog catalog({first.root(), second.root()});
  EXPECT_THAT(catalog.Find(Kind::kDataset, "lab.data"), IsOk());
  EXPECT_THAT(catalog.Find(Kind::kDataset, "lab.data-2"), IsOk());
}

}  // namespace catalog_test
}  // namespace etude::sources
