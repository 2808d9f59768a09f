// SPDX-License-Identifier: Apache-2.0
// Tests services/store/plain_file.cc with h5py: what robomimic's loader asks of a file.
#include "services/store/plain_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>

#include "services/core/hash.h"
#include "services/episode/frame_cursor.h"
#include "services/store/filter_keys.h"
#include "tests/services/store/read_with_h5py.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude::store {
namespace plain_file_test {

class PlainFile : public testing::Test {
 protected:
  void SetUp() override {
    auto writer = DatasetWriter::Open(data_, spec_);
    ASSERT_THAT(writer, IsOk());
    for (std::uint64_t i = 0; i < 6; ++i) ASSERT_THAT(writer->Commit(MakeSyntheticEpisode(spec_, i, 23)), IsOk());
  }

  TemporaryFolder folder_;
  CampaignSpec spec_ = SyntheticSpec(40, 24);
  Path data_ = folder_ / "data", out_ = folder_ / "all.hdf5";
};

TEST_F(PlainFile, HasEverythingWithoutLinks) {
  ASSERT_THAT(WriteFilterKey(data_, "keep", {1, 4}), IsOk());
  const auto report = WritePlainFile(data_, out_, {});
  ASSERT_THAT(report, IsOk());
  EXPECT_EQ(report->episodes, 6u);
  EXPECT_EQ(report->samples, 30u);
  std::filesystem::rename(data_, folder_ / "elsewhere");  // nothing of it is needed any more

  const auto seen = ReadWithH5py(out_, "/data/demo_3");
  if (!seen) GTEST_SKIP() << "python3-h5py is not installed";
  const Episode episode = MakeSyntheticEpisode(spec_, 3, 23);

  EXPECT_EQ((*seen)["demos"].size(), 6u);
  EXPECT_EQ((*seen)["data"]["total"], 30);
  EXPECT_TRUE(Json::parse((*seen)["data"]["env_args"].get<std::string>()).contains("env_kwargs"));
  EXPECT_EQ((*seen)["attributes"]["num_samples"], 5);
  EXPECT_EQ((*seen)["attributes"]["instruction"], episode.instruction);
  EXPECT_EQ((*seen)["arrays"]["actions"], Json({"float32", {5, 10}, nullptr, nullptr}));
  EXPECT_EQ((*seen)["arrays"]["obs/front_image"], Json({"uint8", {5, 24, 40, 3}, {5, 24, 40, 3}, "gzip"}));
  FrameCursor frames(episode);
  for (std::size_t k = 0; k < 5; ++k) EXPECT_EQ((*seen)["values"]["obs/front_image"][k], Sha256Hex(*frames.Frame(k)));
  EXPECT_EQ((*seen)["mask"]["keep"], Json({"demo_1", "demo_4"}));
  for (const char* split : {"train", "valid", "test"}) EXPECT_TRUE((*seen)["mask"].contains(split));
}

TEST_F(PlainFile, HasAFilterKeyASentence) {
  ASSERT_THAT(WritePlainFile(data_, out_, {}), IsOk());
  const auto seen = ReadWithH5py(out_, "/data/demo_0");
  if (!seen) GTEST_SKIP() << "python3-h5py is not installed";

  const auto entries = Json::parse(*ReadTextFile(folder_ / "all.hdf5.train_data.json"));
  std::size_t demos = 0;
  for (const auto& entry : entries) {
    EXPECT_EQ(entry["path"], out_.string());
    for (const auto& demo : (*seen)["mask"][entry["filter_key"].get<std::string>()]) {
      const auto index = std::stoull(demo.get<std::string>().substr(5));
      EXPECT_EQ(entry["lang"], MakeSyntheticEpisode(spec_, index, 23).instruction);
      EXPECT_EQ(SplitOf(spec_, index), "train");
      ++demos;
    }
  }
  EXPECT_EQ(demos, (*seen)["mask"]["train"].size());
}

TEST_F(PlainFile, IsRefusedInWords) {
  EXPECT_THAT(WritePlainFile(folder_ / "none", out_, {}), HasCode(Code::kNotFound));
  ASSERT_THAT(WriteFileAtomically(folder_ / "all.hdf5.partial", std::string_view("half")), IsOk());
  EXPECT_THAT(WritePlainFile(data_, out_, {}), MessageHas("--restart"));
  EXPECT_THAT(WritePlainFile(data_, out_, {.leftover = Leftover::kRemove}), IsOk());
  EXPECT_THAT(WritePlainFile(data_, out_, {.leftover = Leftover::kRemove}), MessageHas("is there already"));
  // nobody's own file of that name is overwritten
  std::filesystem::remove(out_);
  EXPECT_THAT(WritePlainFile(data_, out_, {}), MessageHas("train_data.json' is there already"));
  EXPECT_FALSE(std::filesystem::exists(out_));

  auto bytes = *ReadBinaryFile(EpisodePath(data_, 2));
  bytes[bytes.size() / 2] ^= 1;
  ASSERT_THAT(WriteFileAtomically(EpisodePath(data_, 2), bytes), IsOk());
  const auto damaged = WritePlainFile(data_, folder_ / "b.hdf5", {});
  EXPECT_THAT(damaged, HasCode(Code::kCorrupt));
  EXPECT_THAT(damaged, MessageHas("000002.hdf5"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "b.hdf5"));
}

// A file size limit stands in for a full disk.
TEST_F(PlainFile, SaysThatTheDiskIsFullAndLeavesNothing) {
  const pid_t child = ::fork();
  if (child == 0) {
    ::signal(SIGXFSZ, SIG_IGN);
    const struct rlimit full { 50'000, 50'000 };
    ::setrlimit(RLIMIT_FSIZE, &full);
    const auto report = WritePlainFile(data_, out_, {});
    ::_exit(!report && report.error().code == Code::kUnavailable ? 0 : 1);
  }
  int wait_status = 0;
  ASSERT_EQ(::waitpid(child, &wait_status, 0), child);
  EXPECT_EQ(wait_status, 0);
  EXPECT_FALSE(std::filesystem::exists(out_));
}

// The room that is taken beforehand is given back.
TEST_F(PlainFile, IsNoLargerThanWhatItHolds) {
  ASSERT_THAT(WritePlainFile(data_, out_, {}), IsOk());
  std::uintmax_t episodes = 0;
  for (std::uint64_t i = 0; i < 6; ++i) episodes += std::filesystem::file_size(EpisodePath(data_, i));
  EXPECT_LT(std::filesystem::file_size(out_), episodes + 300'000);
}

}  // namespace plain_file_test
}  // namespace etude::store
