// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/api/video_cache.cc
#include "dashboard/server/api/video_cache.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/matchers.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude::api {
namespace video_cache_test {

using namespace std::chrono_literals;

class VideoCache : public testing::Test {
 protected:
  void SetUp() override {
    const CampaignSpec spec = SyntheticSpec();
    auto writer = store::DatasetWriter::Open(data_, spec);
    ASSERT_THAT(writer, IsOk());
    for (std::uint64_t i = 0; i < 3; ++i) ASSERT_THAT(writer->Commit(MakeSyntheticEpisode(spec, i, 20)), IsOk());
  }
  store::EpisodeRecord Record(std::uint64_t index) {
    auto record = store::DatasetReader::Open(data_)->Read(index);
    EXPECT_THAT(record, IsOk());
    return record.value_or(store::EpisodeRecord{});
  }
  Path Video(std::uint64_t index, std::uint64_t most_bytes = 1 << 30) {
    const auto video = CachedVideo(cache_, Record(index), 0, most_bytes);
    EXPECT_THAT(video, IsOk());
    return video.value_or(Path());
  }
  std::size_t Files() const {
    return static_cast<std::size_t>(std::distance(std::filesystem::directory_iterator(cache_), {}));
  }
  static void SetAge(const Path& file, std::chrono::hours age) {
    std::filesystem::last_write_time(file, std::filesystem::file_time_type::clock::now() - age);
  }

  TemporaryFolder folder_;
  Path data_ = folder_ / "data", cache_ = folder_ / "cache";
};

TEST_F(VideoCache, MakesAVideoOnce) {
  const Path first = Video(0);
  const std::string bytes = ReadTextFile(first).value_or("");
  EXPECT_NE(bytes.find("moov"), std::string::npos) << "a playable file";
  ASSERT_THAT(WriteFileAtomically(first, std::string_view("kept as it is")), IsOk());
  EXPECT_EQ(Video(0), first);
  EXPECT_EQ(ReadTextFile(first).value_or(""), "kept as it is");
  EXPECT_NE(Video(1), first);
  EXPECT_EQ(Files(), 2u) << "nothing under a temporary name";
}

TEST_F(VideoCache, WhatAnotherGatewayIsMakingIsLeftAlone) {
  const Path video = Video(0);
  std::filesystem::remove(video);
  const Path theirs = cache_ / ("." + video.filename().string());
  ASSERT_THAT(WriteFileAtomically(theirs, std::string_view("half a video")), IsOk());
  EXPECT_EQ(Video(0), video);
  EXPECT_EQ(ReadTextFile(theirs).value_or(""), "half a video");
  EXPECT_EQ(Files(), 2u);
}

// the pictures of an episode that was collected again are others, and its place is the same
TEST_F(VideoCache, AnEpisodeThatWasMadeAgainHasAVideoOfItsOwn) {
  const Path before = Video(0);
  const store::EpisodeRecord record = Record(0);
  std::filesystem::last_write_time(record.path, std::filesystem::last_write_time(record.path) + 1h);
  EXPECT_NE(Video(0), before);
}

TEST_F(VideoCache, TheOnesThatWereAskedForLongestAgoGoFirst) {
  const Path a = Video(0), b = Video(1), last = Video(2);
  const std::uint64_t room = std::filesystem::file_size(a) + std::filesystem::file_size(last);
  std::filesystem::remove(last);
  SetAge(a, 3h);
  SetAge(b, 2h);
  EXPECT_EQ(Video(0), a) << "asked for again: b is the older one now";
  const Path c = Video(2, room);
  EXPECT_TRUE(std::filesystem::exists(a));
  EXPECT_FALSE(std::filesystem::exists(b));
  EXPECT_TRUE(std::filesystem::exists(c));

  const Path again = Video(1, 1);
  EXPECT_EQ(again, b);
  EXPECT_EQ(Files(), 1u) << "what was asked for stays, however little may";
}

TEST_F(VideoCache, OtherFilesInItsFolderAreNotItsToRemove) {
  ASSERT_THAT(WriteFileAtomically(cache_ / "notes.txt", std::string(100'000, 'x')), IsOk());
  SetAge(cache_ / "notes.txt", 100h);
  (void)Video(0, 1);
  EXPECT_TRUE(std::filesystem::exists(cache_ / "notes.txt"));
}

TEST_F(VideoCache, WithoutPicturesThereIsNone) {
  store::EpisodeRecord record = Record(0);
  EXPECT_THAT(CachedVideo(cache_, record, 1), HasCode(Code::kNotFound));
  record.frames[0] = {};
  EXPECT_THAT(CachedVideo(cache_, record, 0), MessageHas("no pictures"));
}

TEST_F(VideoCache, ADamagedEpisodeLeavesNothingBehind) {
  const store::EpisodeRecord record = Record(0);
  std::filesystem::resize_file(record.path, record.frames[0].streams.back().offset);
  EXPECT_FALSE(CachedVideo(cache_, record, 0)) << "its last picture is gone";
  EXPECT_EQ(Files(), 0u);
}

}  // namespace video_cache_test
}  // namespace etude::api
