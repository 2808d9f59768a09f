// SPDX-License-Identifier: Apache-2.0
// Tests services/core/file.cc
#include "services/core/file.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <fstream>
#include <functional>
#include <mutex>
#include <numeric>

#include "services/core/descriptor.h"
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

// Runs `body` in a child that can write `most` bytes to any file, and tells whether it said yes.
bool HoldsOnAFullDisk(rlim_t most, const std::function<bool()>& body) {
  const pid_t child = ::fork();
  if (child == 0) {
    ::signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{most, most};
    ::setrlimit(RLIMIT_FSIZE, &limit);
    ::_exit(body() ? 0 : 1);
  }
  int wait_status = 0;
  return ::waitpid(child, &wait_status, 0) == child && wait_status == 0;
}

std::vector<std::uint8_t> Counting(std::size_t size) {
  std::vector<std::uint8_t> bytes(size);
  std::iota(bytes.begin(), bytes.end(), std::uint8_t{0});
  return bytes;
}

class FileTest : public ::testing::Test {
 protected:
  Descriptor Open(const std::string& name, int flags) {
    return Descriptor(::open((folder_ / name).c_str(), flags | O_CLOEXEC, 0644));
  }

  TemporaryFolder temporary_;
  Path folder_ = temporary_.path();
};

TEST_F(FileTest, AFileThatNeedNotBeThereIsNothing) {
  const auto none = ReadTextFileIfThere(folder_ / "none");
  ASSERT_TRUE(none);
  EXPECT_EQ(*none, std::nullopt);
  ASSERT_TRUE(WriteFileAtomically(folder_ / "empty", std::string_view()));
  EXPECT_EQ(ReadTextFileIfThere(folder_ / "empty").value(), "");
  ASSERT_TRUE(WriteFileAtomically(folder_ / "some", std::string_view("text")));
  EXPECT_EQ(ReadTextFileIfThere(folder_ / "some").value(), "text");
  EXPECT_THAT(ReadTextFileIfThere(folder_ / "some", 3), HasCode(Code::kExhausted));
}

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
  for (const int refused : {ENOSPC, EDQUOT, EFBIG, EROFS, EACCES, EPERM, EIO, EMFILE, ENFILE, ENOMEM, EAGAIN, ESTALE,
                            ETIMEDOUT, ENOTCONN, ECONNABORTED, EHOSTDOWN})
    EXPECT_EQ(ErrnoError("write", "x", refused).code, Code::kUnavailable) << refused;
  EXPECT_EQ(ErrnoError("open", "x", ENOENT).code, Code::kNotFound);
  for (const int other : {EINVAL, EISDIR, EBADF}) EXPECT_EQ(ErrnoError("open", "x", other).code, Code::kInternal);
  EXPECT_EQ(ErrnoError("write", "/d/x", ENOSPC).message, "write '/d/x': No space left on device");
}

// a file system that is away answered that its mount point exists
TEST_F(FileTest, AFolderThatCannotBeAskedIsNotMade) {
  std::filesystem::create_symlink("loop", folder_ / "loop");
  EXPECT_THAT(MakeFolders(folder_ / "loop" / "below"), MessageHas("symbolic links"));
}

TEST_F(FileTest, EveryByteComesBackAndTheLimitIsTheLastSizeThatFits) {
  const std::vector<std::uint8_t> bytes = Counting(256);
  ASSERT_THAT(WriteFileAtomically(folder_ / "bytes", bytes), IsOk());
  EXPECT_EQ(ReadBinaryFile(folder_ / "bytes", 256).value(), bytes);
  EXPECT_THAT(ReadBinaryFile(folder_ / "bytes", 255), MessageHas("256 bytes, more than the limit of 255"));
  ASSERT_THAT(WriteFileAtomically(folder_ / "empty", std::string_view()), IsOk());
  EXPECT_EQ(ReadTextFile(folder_ / "empty", 0).value(), "");
}

// before, root's /dev/stdout was a plain file from then on
TEST_F(FileTest, WritesIntoAPipeAndReplacesItByNothing) {
  int ends[2];
  ASSERT_EQ(::pipe(ends), 0);
  const Descriptor from(ends[0]), to(ends[1]);
  ASSERT_THAT(WriteFileAtomically("/dev/fd/" + std::to_string(ends[1]), std::string_view("x\n")), IsOk());
  char got[4] = {};
  EXPECT_EQ(::read(ends[0], got, sizeof got), 2);
  const Path fifo = folder_ / "fifo";
  ASSERT_EQ(::mkfifo(fifo.c_str(), 0600), 0);
  const Descriptor reader(::open(fifo.c_str(), O_RDONLY | O_NONBLOCK));
  ASSERT_THAT(WriteFileAtomically(fifo, std::string_view("y")), IsOk());
  EXPECT_TRUE(std::filesystem::is_fifo(fifo));
}

// what a shell gives with <(...), and the kernel in /proc, has no size
TEST_F(FileTest, ReadsPipesToTheirEnd) {
  int ends[2];
  ASSERT_EQ(::pipe(ends), 0);
  const std::string text(5000, 'x');
  ASSERT_EQ(::write(ends[1], text.data(), text.size()), static_cast<ssize_t>(text.size()));
  ::close(ends[1]);
  const Path pipe = "/dev/fd/" + std::to_string(ends[0]);
  EXPECT_EQ(ReadTextFile(pipe).value(), text);
  ::close(ends[0]);
  EXPECT_THAT(ReadTextFile("/proc/self/status").value(), HasSubstr("Name:"));
  EXPECT_EQ(ReadTextFile("/proc/self/status", 10).error().code, Code::kExhausted);
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

TEST_F(FileTest, AnAppendersDuplicateSyncsTheSameFileAndOutlivesIt) {
  const Path path = folder_ / "log.jsonl";
  auto appender = LineAppender::Open(path);
  ASSERT_THAT(appender, IsOk());
  auto duplicate = appender->Duplicate();
  ASSERT_THAT(duplicate, IsOk());
  ASSERT_THAT(appender->Append("1"), IsOk());
  EXPECT_THAT(duplicate->Sync(), IsOk());
  *appender = std::move(*LineAppender::Open(folder_ / "other"));
  ASSERT_THAT(duplicate->Append("2"), IsOk());
  EXPECT_EQ(ReadTextFile(path).value(), "1\n2\n");
}

TEST_F(FileTest, AFullDiskLeavesTheOldFile) {
  const Path path = folder_ / "kept";
  ASSERT_TRUE(WriteFileAtomically(path, std::string_view("old")));
  // a file size limit stands for a full disk: write(2) fails in the middle
  EXPECT_TRUE(HoldsOnAFullDisk(4096, [&] { return !WriteFileAtomically(path, std::string(100'000, 'x')); }));
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

// ---- ReadAt, WriteAll ----------------------------------------------------------------------------

TEST_F(FileTest, ReadAtGivesWhatLiesThereUpToTheEnd) {
  const std::vector<std::uint8_t> all = Counting(200);
  ASSERT_THAT(WriteFileAtomically(folder_ / "bytes", all), IsOk());
  const Descriptor file = Open("bytes", O_RDONLY);

  std::vector<std::uint8_t> part(60, 0xee);
  EXPECT_EQ(ReadAt(file.get(), "bytes", 100, part).value(), 60u);
  EXPECT_TRUE(std::equal(part.begin(), part.end(), all.begin() + 100));

  // what lies beyond the end is left as it was
  std::fill(part.begin(), part.end(), std::uint8_t{0xee});
  EXPECT_EQ(ReadAt(file.get(), "bytes", 190, part).value(), 10u);
  EXPECT_TRUE(std::equal(part.begin(), part.begin() + 10, all.begin() + 190));
  EXPECT_EQ(std::count(part.begin() + 10, part.end(), 0xee), 50);
  EXPECT_EQ(ReadAt(file.get(), "bytes", 200, part).value(), 0u);
  EXPECT_EQ(ReadAt(file.get(), "bytes", 1ull << 40, part).value(), 0u);
  EXPECT_EQ(ReadAt(file.get(), "bytes", 0, {}).value(), 0u);
}

TEST_F(FileTest, ReadAtMovesNothingAndNamesTheFileThatItCannotRead) {
  ASSERT_THAT(WriteFileAtomically(folder_ / "text", std::string_view("abcdef")), IsOk());
  const Descriptor file = Open("text", O_RDONLY);
  std::vector<std::uint8_t> two(2);
  for (int again = 0; again < 2; ++again) {
    ASSERT_EQ(ReadAt(file.get(), "text", 3, two).value(), 2u);
    EXPECT_EQ(two, (std::vector<std::uint8_t>{'d', 'e'}));
  }
  EXPECT_EQ(::lseek(file.get(), 0, SEEK_CUR), 0) << "others that read on from there are not disturbed";

  const Descriptor folder = Open("", O_RDONLY | O_DIRECTORY);
  EXPECT_THAT(ReadAt(folder.get(), "a name", 0, two), MessageHas("read 'a name'"));
  EXPECT_FALSE(ReadAt(-1, "none", 0, two));
}

TEST_F(FileTest, WriteAllGoesOnWhereTheFileStands) {
  const std::vector<std::uint8_t> all = Counting(250);
  {
    const Descriptor file = Open("out", O_WRONLY | O_CREAT);
    ASSERT_THAT(WriteAll(file.get(), "out", std::span(all).first(100)), IsOk());
    ASSERT_THAT(WriteAll(file.get(), "out", std::span<const std::uint8_t>()), IsOk());
    ASSERT_THAT(WriteAll(file.get(), "out", std::span(all).subspan(100)), IsOk());
  }
  EXPECT_EQ(ReadBinaryFile(folder_ / "out").value(), all);
  const Descriptor closed = Open("out", O_RDONLY);
  EXPECT_THAT(WriteAll(closed.get(), "the file", all), MessageHas("write 'the file'"));
}

// write(2) takes a part, says so, and refuses the rest: that is no success
TEST_F(FileTest, WriteAllOnAFullDiskIsAnErrorAndAPartStands) {
  EXPECT_TRUE(HoldsOnAFullDisk(40, [&] {
    const Descriptor file = Open("out", O_WRONLY | O_CREAT);
    const Status written = WriteAll(file.get(), "out", Counting(100));
    return !written && written.error().code == Code::kUnavailable;
  }));
  EXPECT_EQ(ReadBinaryFile(folder_ / "out").value(), Counting(40));
}

// ---- WriteSecret ---------------------------------------------------------------------------------

TEST_F(FileTest, ASecretIsItsOwnersAloneWhateverTheMask) {
  const mode_t before = ::umask(0);
  const Status written = WriteSecret(folder_ / "key.pem", "the words");
  ::umask(before);

  ASSERT_THAT(written, IsOk());
  EXPECT_EQ(ReadTextFile(folder_ / "key.pem").value(), "the words");
  struct stat info {};
  ASSERT_EQ(::stat((folder_ / "key.pem").c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 07777, 0600u);
}

TEST_F(FileTest, ASecretIsOnTheDiskWhenItIsSaidToBe) {
  synced_paths.clear();
  ASSERT_THAT(WriteSecret(folder_ / "key.pem", "x"), IsOk());
  EXPECT_THAT(synced_paths, testing::ElementsAre((folder_ / "key.pem").string(), folder_.string()));
}

TEST_F(FileTest, ASecretReplacesNothing) {
  ASSERT_THAT(WriteSecret(folder_ / "key.pem", "first"), IsOk());
  const Status again = WriteSecret(folder_ / "key.pem", "second");
  EXPECT_THAT(again, HasCode(Code::kUnavailable));
  EXPECT_THAT(again, MessageHas("is not overwritten"));
  EXPECT_EQ(ReadTextFile(folder_ / "key.pem").value(), "first");

  // nor does it follow a link to where somebody else would have it
  std::filesystem::create_symlink(folder_ / "elsewhere", folder_ / "link.pem");
  EXPECT_FALSE(WriteSecret(folder_ / "link.pem", "x"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "elsewhere"));
  EXPECT_THAT(WriteSecret(folder_ / "none" / "key.pem", "x"), HasCode(Code::kNotFound));
}

TEST_F(FileTest, HalfASecretIsRemoved) {
  EXPECT_TRUE(HoldsOnAFullDisk(4, [&] { return !WriteSecret(folder_ / "key.pem", "longer than that"); }));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "key.pem")) << "the next attempt would be refused";
  EXPECT_THAT(WriteSecret(folder_ / "key.pem", "x"), IsOk());
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
