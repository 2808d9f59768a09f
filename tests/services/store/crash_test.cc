// SPDX-License-Identifier: Apache-2.0
// Tests services/store/commit_file.cc: crashes between any two system calls, full disks, two
// processes.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <fstream>
#include <functional>

#include "services/store/commit_file.h"
#include "services/store/dataset.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude::store {
namespace crash_test {

using internal::CommitPoint;

constexpr int kCrashed = 42;

// Runs `body` in a child process; its exit code.
int InChild(const std::function<int()>& body) {
  const pid_t child = ::fork();
  if (child == 0) ::_exit(body());
  int status = 0;
  EXPECT_EQ(::waitpid(child, &status, 0), child);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

std::set<std::string> NamesIn(const Path& folder) {
  std::set<std::string> names;
  if (!std::filesystem::exists(folder)) return names;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) names.insert(entry.path().filename());
  return names;
}

TEST(Crash, AtAnyPointLeavesTheEpisodeWholeOrAbsentAndTheDatasetUsable) {
  const CampaignSpec spec = SyntheticSpec();
  const Episode first = MakeSyntheticEpisode(spec, 0);
  const Episode second = MakeSyntheticEpisode(spec, 1);
  for (const CommitPoint point : {CommitPoint::kCreated, CommitPoint::kWritten, CommitPoint::kSynced,
                                  CommitPoint::kRenamed, CommitPoint::kDone}) {
    SCOPED_TRACE(static_cast<int>(point));
    const TemporaryFolder folder;
    const int code = InChild([&] {
      auto writer = DatasetWriter::Open(folder.path(), spec);
      if (!writer || !writer->Commit(first)) return 1;
      internal::SetCommitProbe([&](CommitPoint reached) {
        if (reached == point) ::_exit(kCrashed);
      });
      return writer->Commit(second) ? 2 : 3;
    });
    ASSERT_EQ(code, kCrashed);

    const bool visible = point >= CommitPoint::kRenamed;
    EXPECT_EQ(DatasetReader::Open(folder.path())->List()->size(), visible ? 2u : 1u);
    const auto report = Verify(folder.path(), Quarantine::kNo);
    ASSERT_THAT(report, IsOk());
    EXPECT_TRUE(report->bad.empty());

    // the next run clears up and goes on
    auto writer = DatasetWriter::Open(folder.path(), spec);
    ASSERT_THAT(writer, IsOk());
    EXPECT_EQ(writer->Contains(1), visible);
    ASSERT_THAT(writer->Commit(second), IsOk());
    EXPECT_THAT(NamesIn(folder / "episodes/000"), testing::ElementsAre("000000.hdf5", "000001.hdf5"));
  }
}

TEST(Crash, KilledWriterFreesTheLockAndLosesNothingCommitted) {
  const TemporaryFolder folder;
  const CampaignSpec spec = SyntheticSpec(16, 16);
  int to_parent[2];
  ASSERT_EQ(::pipe(to_parent), 0);
  const pid_t child = ::fork();
  if (child == 0) {
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);  // it does not end by itself
    auto writer = DatasetWriter::Open(folder.path(), spec);
    for (std::uint64_t i = 0; i < 200; ++i) {
      if (!writer || !writer->Commit(MakeSyntheticEpisode(spec, i, 5))) ::_exit(1);
      const auto acknowledged = static_cast<std::uint8_t>(i);
      if (::write(to_parent[1], &acknowledged, 1) != 1) ::_exit(1);
    }
    for (;;) ::pause();  // it has the lock until it is killed, however late that is
  }
  ::close(to_parent[1]);

  // a second writer is refused while the first lives; then SIGKILL at some commit
  std::uint8_t last = 0;
  while (last < 7 && ::read(to_parent[0], &last, 1) == 1) {
  }
  EXPECT_GE(int{last}, 7) << "it failed";  // and is killed all the same
  EXPECT_THAT(DatasetWriter::Open(folder.path(), spec), HasCode(Code::kUnavailable));
  ::kill(child, SIGKILL);
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  while (::read(to_parent[0], &last, 1) == 1) {
  }
  ::close(to_parent[0]);

  const auto writer = DatasetWriter::Open(folder.path(), spec);
  ASSERT_THAT(writer, IsOk());
  for (std::uint64_t i = 0; i <= last; ++i) EXPECT_TRUE(writer->Contains(i)) << i;
  EXPECT_TRUE(Verify(folder.path(), Quarantine::kNo)->bad.empty());
}

TEST(Crash, LeftoversOfEarlierRunsAreRemoved) {
  const TemporaryFolder folder;
  const CampaignSpec spec = SyntheticSpec();
  ASSERT_THAT(DatasetWriter::Open(folder.path(), spec)->Commit(MakeSyntheticEpisode(spec, 0)), IsOk());
  for (const char* name : {"episodes/000/000001.hdf5.tmp", "dataset.json.tmp-123", "dataset.hdf5.tmp-9"})
    std::ofstream(folder / name) << "half a fil";

  ASSERT_THAT(DatasetWriter::Open(folder.path(), spec), IsOk());

  EXPECT_THAT(NamesIn(folder / "episodes/000"), testing::ElementsAre("000000.hdf5"));
  EXPECT_THAT(NamesIn(folder.path()),
              testing::ElementsAre(".lock", "attempts.jsonl", "commits.jsonl", "dataset.json", "episodes"));
}

// A file size limit stands in for a full disk: write(2) fails part of the way.
TEST(DiskFull, ShowsNothingOfTheEpisodeAndCanBeTriedAgain) {
  const TemporaryFolder folder;
  const CampaignSpec spec = SyntheticSpec();
  const int code = InChild([&] {
    auto writer = DatasetWriter::Open(folder.path(), spec);
    if (!writer || !writer->Commit(MakeSyntheticEpisode(spec, 0))) return 1;
    ::signal(SIGXFSZ, SIG_IGN);
    struct rlimit limit {};
    ::getrlimit(RLIMIT_FSIZE, &limit);
    const struct rlimit full { 10'000, limit.rlim_max };
    ::setrlimit(RLIMIT_FSIZE, &full);
    const Status refused = writer->Commit(MakeSyntheticEpisode(spec, 1));
    if (refused || refused.error().code != Code::kUnavailable) return 2;
    if (writer->Contains(1)) return 3;
    if (NamesIn(folder / "episodes/000") != std::set<std::string>{"000000.hdf5"}) return 4;
    ::setrlimit(RLIMIT_FSIZE, &limit);
    return writer->Commit(MakeSyntheticEpisode(spec, 1)) ? 0 : 5;
  });

  EXPECT_EQ(code, 0);
  EXPECT_EQ(Verify(folder.path(), Quarantine::kNo)->good, 2u);
}

TEST(DiskFull, KeepsTheOldMasterFile) {
  const TemporaryFolder folder;
  const CampaignSpec spec = SyntheticSpec();
  const int code = InChild([&] {
    auto writer = DatasetWriter::Open(folder.path(), spec);
    if (!writer || !writer->Commit(MakeSyntheticEpisode(spec, 0)) || !writer->WriteMaster()) return 1;
    const auto before = ReadBinaryFile(folder / "dataset.hdf5");
    if (!writer->Commit(MakeSyntheticEpisode(spec, 1))) return 2;
    ::signal(SIGXFSZ, SIG_IGN);
    const struct rlimit full { 500, 500 };
    ::setrlimit(RLIMIT_FSIZE, &full);
    if (writer->WriteMaster()) return 3;
    return *ReadBinaryFile(folder / "dataset.hdf5") == *before ? 0 : 4;
  });

  EXPECT_EQ(code, 0);
}

TEST(CommitFiles, NameTheFolderThatCannotBeWrittenAndWriteTheOthers) {
  const TemporaryFolder folder;
  std::ofstream(folder / "file") << "x";
  const std::vector<std::uint8_t> bytes{1, 2, 3};

  const internal::FileToCommit files[] = {{folder / "file/below/x.hdf5", {bytes}}, {folder / "a/b/x.hdf5", {bytes}}};
  const auto statuses = internal::CommitFiles(files);
  EXPECT_THAT(statuses[0], MessageHas((folder / "file").string()));
  ASSERT_THAT(statuses[1], IsOk());
  EXPECT_EQ(*ReadBinaryFile(folder / "a/b/x.hdf5"), bytes);
}

}  // namespace crash_test
}  // namespace etude::store
