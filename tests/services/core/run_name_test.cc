// SPDX-License-Identifier: Apache-2.0
// Tests services/core/run_name.cc
#include "services/core/run_name.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude {
namespace run_name_test {

TEST(PlainNameOf, MakesAPlainName) {
  EXPECT_EQ(PlainNameOf("out/My Run"), "my-run");
  EXPECT_EQ(PlainNameOf("out/run_3/"), "run_3");
  EXPECT_TRUE(IsPlainName(PlainNameOf(".")));
  EXPECT_TRUE(IsPlainName(PlainNameOf("x/" + std::string(100, 'a'))));
}

TEST(RunNameOf, IsTheFoldersUntilOneIsKept) {
  const TemporaryFolder folder;
  const Path run = folder / "My Run";
  std::filesystem::create_directory(run);
  EXPECT_EQ(RunNameOf(run), "my-run");
  ASSERT_THAT(KeepRunName(run, "live"), IsOk());
  EXPECT_EQ(RunNameOf(run), "live");
  ASSERT_THAT(KeepRunName(run, "another"), IsOk());
  EXPECT_EQ(RunNameOf(run), "another");
  ASSERT_THAT(WriteFileAtomically(run / "name", "no plain name\n"), IsOk());
  EXPECT_EQ(RunNameOf(run), "my-run") << "somebody edited it";
}

// before, a folder's name was taken for the run's, which publishes under another one where it was given --name
TEST(ParseRun, OfAFolderKnowsItsNameAndItsId) {
  const TemporaryFolder folder;
  const Path run = folder / "run";
  const auto identity = OpenIdentity(run);
  ASSERT_THAT(identity, IsOk());
  ASSERT_THAT(KeepRunName(run, "quickstart"), IsOk());
  for (const std::string& text : {run.string(), run.string() + "/"}) {
    const auto found = ParseRun(text, "--subscribe");
    ASSERT_THAT(found, IsOk());
    EXPECT_EQ(found->name, "quickstart");
    EXPECT_EQ(found->id, identity->id);
  }
  const auto named = ParseRun("live@3f2a", "--subscribe");
  ASSERT_THAT(named, IsOk());
  EXPECT_EQ(named->text(), "live@3f2a");
  EXPECT_THAT(ParseRun((folder / "none").string(), "--subscribe"), HasCode(Code::kInvalidArgument));
}

// "run" is a name, and most often a folder
TEST(ParseRun, OfANameThatIsAlsoAFolderMeansTheRunInItWhereThatIsCalledOtherwise) {
  const TemporaryFolder folder;
  const Path before = std::filesystem::current_path();
  std::filesystem::current_path(folder.path());
  const auto identity = OpenIdentity("run");
  const auto alike = ParseRun("run", "--subscribe");
  EXPECT_THAT(KeepRunName("run", "demo"), IsOk());
  const auto other = ParseRun("run", "--subscribe"), named = ParseRun("demo", "--subscribe");
  std::filesystem::current_path(before);
  ASSERT_THAT(identity, IsOk());
  ASSERT_THAT(alike, IsOk());
  EXPECT_EQ(alike->text(), "run") << "the run of that name, whichever it is by then";
  ASSERT_THAT(other, IsOk());
  EXPECT_EQ(other->text(), "demo@" + identity->id);
  ASSERT_THAT(named, IsOk());
  EXPECT_EQ(named->text(), "demo");
}

}  // namespace run_name_test
}  // namespace etude
