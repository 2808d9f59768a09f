// SPDX-License-Identifier: Apache-2.0
// Tests services/core/output_folder.cc
#include "services/core/output_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude {
namespace output_folder_test {

TEST(OutputFolder, AppearsWithAllThatIsInIt) {
  const TemporaryFolder folder;
  auto out = OutputFolder::Create(folder / "a/b/", Leftover::kRefuse);
  ASSERT_THAT(out, IsOk());
  ASSERT_THAT(WriteFileAtomically(out->path() / "x", std::string_view("1")), IsOk());
  EXPECT_FALSE(std::filesystem::exists(folder / "a/b"));

  ASSERT_THAT(out->Commit(), IsOk());

  EXPECT_EQ(*ReadTextFile(folder / "a/b/x"), "1");
  EXPECT_FALSE(std::filesystem::exists(folder / "a/b.partial"));
}

TEST(OutputFolder, TakesAnEmptyFoldersPlaceButNoOther) {
  const TemporaryFolder folder;
  ASSERT_THAT(MakeFolders(folder / "empty"), IsOk());
  auto out = OutputFolder::Create(folder / "empty", Leftover::kRefuse);
  ASSERT_THAT(out, IsOk());
  ASSERT_THAT(WriteFileAtomically(out->path() / "x", std::string_view("1")), IsOk());
  ASSERT_THAT(out->Commit(), IsOk());

  EXPECT_THAT(OutputFolder::Create(folder / "empty", Leftover::kRemove), MessageHas("is there already"));
  EXPECT_EQ(*ReadTextFile(folder / "empty/x"), "1");
}

// hours of work went beside the link, and could not be renamed over it
TEST(ClaimOutput, ALinkThatLeadsNowhereIsRefusedBeforeTheWork) {
  const TemporaryFolder folder;
  std::filesystem::create_symlink(folder / "scratch/out", folder / "out");
  for (const Made made : {Made::kFile, Made::kFolder})
    EXPECT_THAT(ClaimOutput(folder / "out", made, Leftover::kRefuse), MessageHas("where nothing is"));
}

TEST(OutputFolder, SaysWhatAnInterruptedCommandLeft) {
  const TemporaryFolder folder;
  ASSERT_THAT(WriteFileAtomically(folder / "out.partial/x", std::string_view("1")), IsOk());

  EXPECT_THAT(OutputFolder::Create(folder / "out", Leftover::kRefuse), MessageHas("--restart"));
  EXPECT_TRUE(std::filesystem::exists(folder / "out.partial/x"));
  EXPECT_THAT(OutputFolder::Create(folder / "out", Leftover::kRemove), IsOk());
  EXPECT_FALSE(std::filesystem::exists(folder / "out.partial/x"));
}

// before, a file was made for hours and then could not take a folder's place
TEST(ClaimOutput, AFileTakesNoFoldersPlace) {
  const TemporaryFolder folder;
  ASSERT_THAT(MakeFolders(folder / "empty"), IsOk());
  EXPECT_THAT(ClaimOutput(folder / "empty", Made::kFile, Leftover::kRefuse), MessageHas("is a folder"));
  EXPECT_THAT(ClaimOutput(folder / "none/", Made::kFile, Leftover::kRefuse), MessageHas("name the file"));
  EXPECT_THAT(ClaimOutput(folder / "a.hdf5", Made::kFile, Leftover::kRefuse), IsOk());
}

// a variable of the shell that is not set
TEST(ClaimOutput, AnEmptyNameIsNoPlace) {
  for (const Made made : {Made::kFile, Made::kFolder})
    EXPECT_EQ(ClaimOutput("", made, Leftover::kRefuse).error().code, Code::kInvalidArgument);
}

TEST(OutputFolder, OfALinkLiesWhereThatLeads) {
  const TemporaryFolder folder;
  ASSERT_THAT(MakeFolders(folder / "scratch/out"), IsOk());
  std::filesystem::create_directory_symlink(folder / "scratch/out", folder / "out");
  auto out = OutputFolder::Create(folder / "out", Leftover::kRefuse);
  ASSERT_THAT(out, IsOk());
  EXPECT_EQ(out->path(), folder / "scratch/out.partial");
  ASSERT_THAT(WriteFileAtomically(out->path() / "x", std::string_view("1")), IsOk());
  ASSERT_THAT(out->Commit(), IsOk());
  EXPECT_EQ(*ReadTextFile(folder / "out/x"), "1");
}

}  // namespace output_folder_test
}  // namespace etude
