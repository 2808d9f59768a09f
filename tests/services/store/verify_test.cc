// SPDX-License-Identifier: Apache-2.0
// Tests services/store/verify.cc
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>

#include "services/core/rng.h"
#include "services/core/stop.h"
#include "services/store/dataset.h"
#include "services/store/layout.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude::store {
namespace verify_test {

constexpr int kEpisodes = 6;

struct Dataset {
  TemporaryFolder folder;
  Path path = folder / "d";
  CampaignSpec spec = SyntheticSpec(24, 24);

  Dataset() {
    auto writer = DatasetWriter::Open(path, spec);
    for (std::uint64_t i = 0; i < kEpisodes; ++i)
      EXPECT_THAT(writer->Commit(MakeSyntheticEpisode(spec, i, 20)), IsOk());
    EXPECT_THAT(writer->WriteMaster(), IsOk());
  }
  Path File(std::uint64_t index) const { return EpisodePath(path, index); }
};

void Overwrite(const Path& path, const std::vector<std::uint8_t>& bytes) {
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
}

TEST(Verify, FindsNothingInAGoodDataset) {
  const Dataset dataset;

  const auto report = Verify(dataset.path, Quarantine::kYes);

  ASSERT_THAT(report, IsOk());
  EXPECT_EQ(report->good, kEpisodes);
  EXPECT_TRUE(report->bad.empty());
  EXPECT_FALSE(std::filesystem::exists(dataset.path / "quarantine"));
}

// Takes every file descriptor as a program with a leak does.
class NoFiles {
 public:
  NoFiles() {
    ::getrlimit(RLIMIT_NOFILE, &before_);
    rlimit few = before_;
    few.rlim_cur = 64;
    ::setrlimit(RLIMIT_NOFILE, &few);
    for (int fd = ::dup(0); fd >= 0; fd = ::dup(0)) taken_.push_back(fd);
  }
  ~NoFiles() {
    for (const int fd : taken_) ::close(fd);
    ::setrlimit(RLIMIT_NOFILE, &before_);
  }

 private:
  rlimit before_{};
  std::vector<int> taken_;
};

TEST(Verify, LeavesWhatCannotBeReadNowWhereItIs) {
  const Dataset dataset;
  {
    const auto reader = DatasetReader::Open(dataset.path);
    NoFiles files;
    const auto unread = reader->Read(0);
    EXPECT_THAT(unread, HasCode(Code::kUnavailable));
  }
  EXPECT_THAT(DatasetReader::Open(dataset.path)->Read(0), IsOk());

  // a folder in a file's place: open(2) succeeds, read(2) does not, and nothing says that an episode is damaged
  const Path moved = dataset.path / "aside";
  std::filesystem::rename(dataset.File(2), moved);
  std::filesystem::create_directory(dataset.File(2));
  const auto report = Verify(dataset.path, Quarantine::kYes);
  ASSERT_THAT(report, IsOk());
  EXPECT_EQ(report->good, kEpisodes - 1);
  EXPECT_TRUE(report->bad.empty());
  ASSERT_EQ(report->unread.size(), 1u);
  EXPECT_EQ(report->unread[0].path, dataset.File(2));
  EXPECT_FALSE(std::filesystem::exists(dataset.path / "quarantine"));
}

// 300 files with 1 to 8 flipped bits, cut somewhere, or both: every one is found, no other is
// blamed.
TEST(Verify, FindsEveryDamagedFile) {
  const Dataset dataset;
  Rng rng(11);
  std::vector<std::vector<std::uint8_t>> good;
  for (std::uint64_t i = 0; i < kEpisodes; ++i) good.push_back(*ReadBinaryFile(dataset.File(i)));
  for (int round = 0; round < 100; ++round) {
    std::set<Path> damaged;
    for (int k = 0; k < 3; ++k) {
      const std::uint64_t index = rng.Below(kEpisodes);
      auto bytes = good[index];
      const std::uint64_t kind = rng.Below(3);
      if (kind != 1) {
        // distinct places, so that no flip undoes another
        const std::uint64_t flips = rng.Below(8) + 1;
        for (std::uint64_t n = 0; n < flips; ++n)
          bytes[n * (bytes.size() / 8) + rng.Below(bytes.size() / 8)] ^= static_cast<std::uint8_t>(1u << rng.Below(8));
      }
      if (kind != 0) bytes.resize(rng.Below(bytes.size()));
      Overwrite(dataset.File(index), bytes);
      damaged.insert(dataset.File(index));
    }

    const auto report = Verify(dataset.path, Quarantine::kNo);

    ASSERT_THAT(report, IsOk());
    std::set<Path> found;
    for (const auto& bad : report->bad) found.insert(bad.path);
    ASSERT_EQ(found, damaged) << "round " << round;
    ASSERT_EQ(report->good, kEpisodes - damaged.size());
    for (std::uint64_t i = 0; i < kEpisodes; ++i) Overwrite(dataset.File(i), good[i]);
  }
}

TEST(Verify, QuarantinesTheBadAndLeavesTheOthersReadable) {
  const Dataset dataset;
  const std::string hash = *HashDataset(dataset.path);
  auto bytes = *ReadBinaryFile(dataset.File(2));
  bytes[bytes.size() / 2] ^= 4;
  Overwrite(dataset.File(2), bytes);
  std::filesystem::resize_file(dataset.File(4), 1000);
  EXPECT_THAT(HashDataset(dataset.path), HasCode(Code::kCorrupt));

  const auto report = Verify(dataset.path, Quarantine::kYes);

  ASSERT_THAT(report, IsOk());
  ASSERT_EQ(report->bad.size(), 2u);
  EXPECT_THAT(report->bad[0].reason, testing::HasSubstr("changed after it was written"));
  EXPECT_THAT(report->bad[1].reason, testing::HasSubstr("cut off"));
  EXPECT_TRUE(std::filesystem::exists(dataset.path / "quarantine/000002.hdf5"));
  const auto master = *ReadTextFile(dataset.path / "dataset.hdf5");
  EXPECT_NE(master.find("demo_3"), std::string::npos);
  EXPECT_EQ(master.find("000002.hdf5"), std::string::npos) << "no link to what is not there";
  const auto reader = DatasetReader::Open(dataset.path);
  const auto indices = reader->List();
  ASSERT_THAT(*indices, testing::ElementsAre(0, 1, 3, 5));
  for (const std::uint64_t index : *indices) EXPECT_THAT(reader->ReadWhole(index), IsOk());

  // a collector that resumes makes them again, and all is as it was
  auto writer = DatasetWriter::Open(dataset.path, dataset.spec);
  ASSERT_THAT(writer, IsOk());
  for (std::uint64_t i = 0; i < kEpisodes; ++i) {
    if (!writer->Contains(i)) {
      ASSERT_THAT(writer->Commit(MakeSyntheticEpisode(dataset.spec, i, 20)), IsOk());
    }
  }
  EXPECT_EQ(*HashDataset(dataset.path), hash);
}

dev_t DeviceOf(const Path& path) {
  struct stat info {};
  EXPECT_EQ(::stat(path.c_str(), &info), 0) << path;
  return info.st_dev;
}

// before, nothing could be renamed there, and the report was lost with it
TEST(Verify, QuarantinesWhatLiesOnAnotherDisk) {
  const Dataset dataset;
  const Path memory = "/dev/shm";
  std::error_code error;
  if (!std::filesystem::is_directory(memory, error) || DeviceOf(memory) == DeviceOf(dataset.path))
    GTEST_SKIP() << "this machine has no second filesystem to write to";
  const Path elsewhere = memory / dataset.folder.path().filename();
  std::filesystem::copy(dataset.path / "episodes", elsewhere, std::filesystem::copy_options::recursive);
  std::filesystem::remove_all(dataset.path / "episodes");
  std::filesystem::create_directory_symlink(elsewhere, dataset.path / "episodes");
  Overwrite(dataset.File(1), {1, 2, 3});

  const auto report = Verify(dataset.path, Quarantine::kYes);
  const bool stays = std::filesystem::exists(dataset.File(1));
  std::filesystem::remove_all(elsewhere);

  ASSERT_THAT(report, IsOk());
  EXPECT_THAT(report->moved, IsOk());
  EXPECT_EQ(report->bad.size(), 1u);
  EXPECT_FALSE(stays);
  EXPECT_EQ(ReadTextFile(dataset.path / "quarantine/000001.hdf5").value_or(""), "\1\2\3");
}

TEST(Verify, ReportsAlsoWhereNothingCanBeMoved) {
  const Dataset dataset;
  ASSERT_THAT(WriteFileAtomically(dataset.path / "quarantine", std::string_view("no folder")), IsOk());
  for (const std::uint64_t index : {1, 4}) Overwrite(dataset.File(index), {1, 2, 3});

  const auto report = Verify(dataset.path, Quarantine::kYes);

  ASSERT_THAT(report, IsOk());
  EXPECT_THAT(report->moved, MessageHas("quarantine"));
  EXPECT_EQ(report->bad.size(), 2u);
  EXPECT_EQ(report->good, kEpisodes - 2);
  EXPECT_TRUE(std::filesystem::exists(dataset.File(4)));
}

// the damaged ones were moved, and nothing told which they had been
TEST(Verify, ReportsAlsoWhereTheMasterFileCannotBeWritten) {
  const Dataset dataset;
  std::filesystem::remove(dataset.path / "dataset.hdf5");
  std::filesystem::create_directories(dataset.path / "dataset.hdf5/in_the_way");
  Overwrite(dataset.File(1), {1, 2, 3});

  const auto report = Verify(dataset.path, Quarantine::kYes);

  ASSERT_THAT(report, IsOk());
  EXPECT_THAT(report->moved, IsOk());
  EXPECT_THAT(report->refreshed, MessageHas("dataset.hdf5"));
  EXPECT_EQ(report->bad.size(), 1u);
}

// what a desktop, rsync or NFS keeps beside an episode is no damaged one
TEST(Verify, LeavesHiddenFilesOfOthersAlone) {
  const Dataset dataset;
  const Path hidden = dataset.path / "episodes/000/._000001.hdf5";
  Overwrite(hidden, {1});

  const auto report = Verify(dataset.path, Quarantine::kYes);

  ASSERT_THAT(report, IsOk());
  EXPECT_THAT(report->bad, testing::IsEmpty());
  EXPECT_EQ(report->good, kEpisodes);
  EXPECT_TRUE(std::filesystem::exists(hidden));
}

TEST(Verify, KeepsBothWhenTheSameNumberIsQuarantinedTwice) {
  const Dataset dataset;
  for (int n = 0; n < 2; ++n) {
    Overwrite(dataset.File(1), {1, 2, 3});
    ASSERT_THAT(Verify(dataset.path, Quarantine::kYes), IsOk());
  }

  EXPECT_TRUE(std::filesystem::exists(dataset.path / "quarantine/000001.hdf5"));
  EXPECT_TRUE(std::filesystem::exists(dataset.path / "quarantine/000001.hdf5.1"));
}

TEST(Verify, DoesNotMoveFilesUnderAWriter) {
  const Dataset dataset;
  const auto writer = DatasetWriter::Open(dataset.path, dataset.spec);
  ASSERT_THAT(writer, IsOk());

  const auto refused = Verify(dataset.path, Quarantine::kYes);
  EXPECT_THAT(refused, HasCode(Code::kUnavailable));
  EXPECT_THAT(refused, MessageHas("--keep"));
  EXPECT_THAT(Verify(dataset.path, Quarantine::kNo), IsOk());
}

TEST(Verify, ReportsFilesThatAreNoEpisodes) {
  const Dataset dataset;
  Overwrite(dataset.path / "episodes/000/123.hdf5", {1});
  std::filesystem::create_directories(dataset.path / "episodes/001");
  std::filesystem::copy(dataset.File(0), dataset.path / "episodes/001/001000.hdf5");

  const auto report = Verify(dataset.path, Quarantine::kNo);

  ASSERT_THAT(report, IsOk());
  ASSERT_EQ(report->bad.size(), 2u);
  EXPECT_EQ(report->bad[0].reason, "not an episode's name");
  EXPECT_EQ(report->bad[1].reason, "it holds episode 0");
}

// A verification that ended between moving files and writing the master file: the next one found nothing bad, and links
// that led nowhere stayed.
TEST(Verify, MendsWhatAnEarlierOneLeft) {
  const Dataset dataset;
  std::filesystem::remove(dataset.File(2));
  EXPECT_EQ(internal::ReadDatasetFile(dataset.path)->statistics["episodes"], kEpisodes);
  ASSERT_THAT(Verify(dataset.path, Quarantine::kNo), IsOk());
  EXPECT_EQ(internal::ReadDatasetFile(dataset.path)->statistics["episodes"], kEpisodes) << "it changes nothing";
  const auto report = Verify(dataset.path, Quarantine::kYes);
  ASSERT_THAT(report, IsOk());
  EXPECT_TRUE(report->bad.empty());
  EXPECT_EQ(internal::ReadDatasetFile(dataset.path)->statistics["episodes"], kEpisodes - 1);
}

// before, a stop waited for the last of ten thousand files
TEST(Verify, EndsWhenItIsAskedTo) {
  const Dataset dataset;
  const auto stopped = [&] {  // in a process of its own: a request stays
    RequestStop();
    std::fputs(
        (Verify(dataset.path, Quarantine::kYes).error().message + HashDataset(dataset.path).error().message).c_str(),
        stderr);
    std::_Exit(7);
  };
  EXPECT_EXIT(stopped(), testing::ExitedWithCode(7), "verify: stopped after 0 of 6 files.*hash: stopped after 0 of 6");
}

TEST(HashDataset, DependsOnContentAndNumberAlone) {
  const Dataset one, two;
  EXPECT_EQ(*HashDataset(one.path), *HashDataset(two.path));
  EXPECT_EQ(HashDataset(one.path)->size(), 64u);
  std::filesystem::remove(two.File(5));
  EXPECT_NE(*HashDataset(one.path), *HashDataset(two.path));
  EXPECT_THAT(HashDataset(one.folder.path()), HasCode(Code::kNotFound));
}

}  // namespace verify_test
}  // namespace etude::store
