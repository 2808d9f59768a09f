// SPDX-License-Identifier: Apache-2.0
// Tests services/core/file.cc
#include "services/core/file.h"

#include <gmock/gmock.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <fstream>
#include <mutex>
#include <numeric>

#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

// Every fsync of this program, by path, on its way to the kernel.
static std::vector<std::string> synced_paths;
static std::mutex synced_mutex;  // tests of other files sync in several threads
extern "C" int fsync(int fd) {
  std::error_code error;
  const std::lock_guard lock(synced_mutex);
  synced_paths.push_back(std::filesystem::read_symlink("/proc/self/fd/" + std::to_string(fd), error).string());
  return static_cast<int>(::syscall(SYS_fsync, fd));
}

namespace etude {
namespace file_test {

using ::testing::HasSubstr;

class FileTest : public ::testing::Test {
 protected:
  TemporaryFolder temporary_;
  Path folder_ = temporary_.path();
};

TEST_F(FileTest, WritesWholeAndReadsBack) {
  const Path path = folder_ / "a" / "b.txt";
  ASSERT_TRUE(WriteFileAtomically(path, std::string_view("first")));
  ASSERT_TRUE(WriteFileAtomically(path, std::string_view("second")));
  EXPECT_EQ(ReadTextFile(path).value(), "second");
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(path.parent_path()), {}), 1);
}

TEST_F(FileTest, ErrorsNameFileAndCause) {
  const auto missing = ReadTextFile(folder_ / "none");
  EXPECT_EQ(missing.error().code, Code::kNotFound);
  EXPECT_THAT(missing.error().message, HasSubstr("none"));
  ASSERT_TRUE(WriteFileAtomically(folder_ / "large", std::string(1000, 'x')));
  EXPECT_EQ(ReadTextFile(folder_ / "large", 10).error().code, Code::kExhausted);
}

// What a user can mend is another kind of error than what only a programmer can.
TEST(ErrnoError, TellsWhatIsMissingFromWhatTheMachineRefuses) {
  for (const int refused :
       {ENOSPC, EDQUOT, EFBIG, EROFS, EACCES, EPERM, EIO, EMFILE, ENFILE, ENOMEM, EAGAIN, ESTALE, ETIMEDOUT})
    EXPECT_EQ(ErrnoError("write", "x", refused).code, Code::kUnavailable) << refused;
  EXPECT_EQ(ErrnoError("open", "x", ENOENT).code, Code::kNotFound);
  for (const int other : {EINVAL, EISDIR, EBADF}) EXPECT_EQ(ErrnoError("open", "x", other).code, Code::kInternal);
  EXPECT_EQ(ErrnoError("write", "/d/x", ENOSPC).message, "write '/d/x': No space left on device");
}

TEST_F(FileTest, EveryByteComesBackAndTheLimitIsTheLastSizeThatFits) {
  std::vector<std::uint8_t> bytes(256);
  std::iota(bytes.begin(), bytes.end(), std::uint8_t{0});
  ASSERT_THAT(WriteFileAtomically(folder_ / "bytes", bytes), IsOk());
  EXPECT_EQ(ReadBinaryFile(folder_ / "bytes", 256).value(), bytes);
  EXPECT_THAT(ReadBinaryFile(folder_ / "bytes", 255), MessageHas("256 bytes, more than the limit of 255"));
  ASSERT_THAT(WriteFileAtomically(folder_ / "empty", std::string_view()), IsOk());
  EXPECT_EQ(ReadTextFile(folder_ / "empty", 0).value(), "");
}

TEST_F(FileTest, WhatStandsInTheWayIsNamedAndNothingIsLeft) {
  ASSERT_THAT(WriteFileAtomically(folder_ / "file", std::string_view("x")), IsOk());
  ASSERT_THAT(MakeFolders(folder_ / "taken" / "below"), IsOk());

  EXPECT_THAT(MakeFolders(folder_ / "file" / "below"), MessageHas("file"));
  EXPECT_THAT(WriteFileAtomically(folder_ / "file" / "below", std::string_view("y")), MessageHas("make folder"));
  EXPECT_THAT(WriteFileAtomically(folder_ / "taken", std::string_view("y")), MessageHas("rename to"));
  EXPECT_FALSE(ReadTextFile(folder_ / "taken")) << "a folder is no file";
  EXPECT_THAT(SyncFile(folder_ / "none"), HasCode(Code::kNotFound));
  EXPECT_THAT(SyncFolder(folder_ / "none"), HasCode(Code::kNotFound));
  EXPECT_FALSE(SyncFolder(folder_ / "file"));
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder_), {}), 2) << "no temporary file";
}

TEST_F(FileTest, WhatIsWrittenIsOnTheDiskBeforeItsNameIs) {
  synced_paths.clear();
  ASSERT_THAT(WriteFileAtomically(folder_ / "kept", std::string_view("x")), IsOk());
  ASSERT_EQ(synced_paths.size(), 2u);
  EXPECT_THAT(synced_paths[0], HasSubstr("kept.tmp-")) << "under its temporary name";
  EXPECT_EQ(synced_paths[1], folder_.string());
}

TEST_F(FileTest, AnAppenderMayBeMovedAndAddsToWhatIsThere) {
  const Path path = folder_ / "new" / "log.jsonl";
  auto first = LineAppender::Open(path);
  ASSERT_THAT(first, IsOk());
  LineAppender moved = std::move(*first);
  ASSERT_THAT(moved.Append("1"), IsOk());
  {
    auto other = LineAppender::Open(folder_ / "other");
    ASSERT_THAT(other, IsOk());
    *other = std::move(moved);
    ASSERT_THAT(other->Append("2"), IsOk());
    ASSERT_THAT(other->Sync(), IsOk());
  }
  ASSERT_THAT(LineAppender::Open(path)->Append("3"), IsOk());
  EXPECT_EQ(ReadTextFile(path).value(), "1\n2\n3\n");
  EXPECT_EQ(ReadTextFile(folder_ / "other").value(), "");
}

TEST_F(FileTest, AFullDiskLeavesTheOldFile) {
  const Path path = folder_ / "kept";
  ASSERT_TRUE(WriteFileAtomically(path, std::string_view("old")));
  const pid_t child = ::fork();
  if (child == 0) {
    // a file size limit stands for a full disk: write(2) fails in the middle
    ::signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{4096, 4096};
    ::setrlimit(RLIMIT_FSIZE, &limit);
    const Status status = WriteFileAtomically(path, std::string(100'000, 'x'));
    ::_exit(status ? 1 : 0);
  }
  int wait_status = 0;
  ASSERT_EQ(::waitpid(child, &wait_status, 0), child);
  EXPECT_EQ(wait_status, 0);
  EXPECT_EQ(ReadTextFile(path).value(), "old");
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder_), {}), 1);
}

TEST_F(FileTest, AppenderEndsATornLine) {
  const Path path = folder_ / "log.jsonl";
  {
    std::ofstream torn(path);
    torn << "{\"a\":1}\n{\"b\":";
  }
  {
    auto appender = LineAppender::Open(path);
    ASSERT_TRUE(appender.has_value());
    ASSERT_TRUE(appender->Append("{\"c\":3}"));
    ASSERT_TRUE(appender->Sync());
  }
  EXPECT_EQ(ReadTextFile(path).value(), "{\"a\":1}\n{\"b\":\n{\"c\":3}\n");
}

TEST_F(FileTest, AppenderNeverGluesLinesAfterAShortWrite) {
  const Path path = folder_ / "log.jsonl";
  const pid_t child = ::fork();
  if (child == 0) {
    // the limit cuts the second line in its middle; then there is room again
    ::signal(SIGXFSZ, SIG_IGN);
    auto appender = LineAppender::Open(path);
    const bool first = appender && appender->Append("{\"a\":1}").has_value();
    ::rlimit limit{};
    ::getrlimit(RLIMIT_FSIZE, &limit);
    limit.rlim_cur = 12;
    ::setrlimit(RLIMIT_FSIZE, &limit);
    const bool second = appender->Append("{\"b\":2}").has_value();
    limit.rlim_cur = limit.rlim_max;
    ::setrlimit(RLIMIT_FSIZE, &limit);
    const bool third = appender->Append("{\"c\":3}").has_value();
    ::_exit(first && !second && third ? 0 : 1);
  }
  int wait_status = 0;
  ASSERT_EQ(::waitpid(child, &wait_status, 0), child);
  EXPECT_EQ(wait_status, 0);
  EXPECT_EQ(ReadTextFile(path).value(), "{\"a\":1}\n{\"c\":3}\n");
}

TEST_F(FileTest, ANewFoldersEntryIsDurable) {
  synced_paths.clear();
  ASSERT_TRUE(MakeFolders(folder_ / "a" / "b"));
  EXPECT_THAT(synced_paths, testing::ElementsAre(folder_.string(), (folder_ / "a").string()));

  synced_paths.clear();
  ASSERT_TRUE(MakeFolders(folder_ / "a" / "b"));
  ASSERT_TRUE(MakeFolders(folder_ / "a" / "c" / ""));
  EXPECT_THAT(synced_paths, testing::ElementsAre((folder_ / "a").string()));
}

TEST(PlainName, KeepsPathsOut) {
  EXPECT_TRUE(IsPlainName("quickstart-2"));
  for (const char* bad : {"", "..", "a/b", "A", "a b", "\xc3\xa9"}) EXPECT_FALSE(IsPlainName(bad)) << bad;
  EXPECT_TRUE(IsPlainName(std::string(64, 'a')));
  EXPECT_FALSE(IsPlainName(std::string(65, 'a')));
  EXPECT_FALSE(IsPlainName(std::string_view("a\0b", 3)));
}

}  // namespace file_test
}  // namespace etude
