// SPDX-License-Identifier: Apache-2.0
// Tests services/store/layout.cc
#include "services/store/layout.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "services/store/dataset.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude::store::internal {
namespace layout_test {

TEST(Layout, PathsAndIndicesAreInverse) {
  for (const std::uint64_t index : {0ull, 123ull, 999ull, 1000ull, 999'999ull, 1'234'567ull}) {
    const Path path = EpisodePath("/d", index);
    EXPECT_EQ(IndexOf(path), index) << path;
  }
  EXPECT_EQ(EpisodePath("/d", 1123), Path("/d/episodes/001/001123.hdf5"));
}

TEST(Layout, OtherNamesAreNoEpisodes) {
  for (const char* name :
       {"000/123.hdf5", "001/000123.hdf5", "000/000123.hdf5.tmp", "000/00012x.hdf5", "000/-00123.hdf5", "000/.hdf5",
        "000/0000123.hdf5", "000/000123", "000/99999999999999999999999.hdf5"})
    EXPECT_FALSE(IndexOf(Path("/d/episodes") / name)) << name;
}

TEST(Layout, LockIsHeldByOneAndFreedWithIt) {
  const TemporaryFolder folder;
  {
    auto lock = LockDataset(folder.path());
    ASSERT_THAT(lock, IsOk());
    const auto second = LockDataset(folder.path());
    EXPECT_THAT(second, HasCode(Code::kUnavailable));
    EXPECT_THAT(second, MessageHas("pid"));
    const FileLock moved = std::move(*lock);
    EXPECT_THAT(LockDataset(folder.path()), HasCode(Code::kUnavailable));
  }
  EXPECT_THAT(LockDataset(folder.path()), IsOk());
}

TEST(Layout, DatasetFileSurvivesAndRefusesGarbage) {
  const TemporaryFolder folder;
  const Path path = folder / kDatasetJson;
  EXPECT_THAT(ReadDatasetFile(folder.path()), HasCode(Code::kNotFound));
  ASSERT_THAT(WriteDatasetFile(folder.path(), {SyntheticSpec(), {{"episodes", 3}}}), IsOk());

  const auto read = ReadDatasetFile(folder.path());
  ASSERT_THAT(read, IsOk());
  EXPECT_EQ(ToJson(read->spec), ToJson(SyntheticSpec()));
  EXPECT_EQ(read->statistics["episodes"], 3);

  for (const char* text :
       {"", "{", "[]", "{}", R"({"schema_version":"1","spec":{}})", R"({"schema_version":1,"spec":5})",
        R"({"schema_version":1,"spec":{"sed":1}})", R"({"schema_version":2,"spec":{}})"}) {
    ASSERT_THAT(WriteFileAtomically(path, std::string_view(text)), IsOk());
    EXPECT_THAT(ReadDatasetFile(folder.path()), HasCode(Code::kCorrupt)) << text;
  }
  ASSERT_THAT(WriteFileAtomically(path, std::string_view(R"({"schema_version":4,"spec":{}})")), IsOk());
  EXPECT_THAT(ReadDatasetFile(folder.path()), HasCode(Code::kInvalidArgument));
}

TEST(Layout, ADatasetIsClosedToWhatWouldBeOfAnotherKind) {
  const CampaignSpec spec = SyntheticSpec();
  const DatasetFile ours{.spec = spec, .spec_sha256 = SpecHash(spec)};
  EXPECT_EQ(WhyClosed(ours), "");
  DatasetFile other = ours;
  other.schema_version = 1;
  EXPECT_THAT(WhyClosed(other), testing::HasSubstr("schema version 1"));
  other = ours;
  other.content = 1;
  EXPECT_THAT(WhyClosed(other), testing::HasSubstr("content version 1"));
  other = ours;
  other.spec_sha256 = std::string(64, 'a');
  EXPECT_THAT(WhyClosed(other), testing::HasSubstr("another hash"));
}

TEST(Layout, SpecDifferencesNameTheKeys) {
  CampaignSpec a = SyntheticSpec();
  CampaignSpec b = a;
  b.episodes = 1;
  EXPECT_THAT(SpecDifferences(a, b), testing::IsEmpty());
  b.seed = 9;
  b.camera.fovy_deg = 50;
  EXPECT_THAT(SpecDifferences(a, b), testing::ElementsAre("seed (1, now 9)", "camera.fovy_deg (60.0, now 50.0)"));
}

}  // namespace layout_test
}  // namespace etude::store::internal
