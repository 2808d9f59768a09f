// SPDX-License-Identifier: Apache-2.0
// Tests trainer/learn/event_file.cc
#include "trainer/learn/event_file.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <vector>

#include "tests/support/temporary_folder.h"

namespace etude::learn {
namespace event_file_test {

std::span<const std::uint8_t> Bytes(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

// vectors of RFC 3720, appendix B.4
TEST(Crc32c, AgreesWithTheStandardsVectors) {
  EXPECT_EQ(Crc32c(Bytes(std::string(32, '\0'))), 0x8a9136aau);
  EXPECT_EQ(Crc32c(Bytes(std::string(32, '\xff'))), 0x62a8ab43u);
  std::string ascending;
  for (int i = 0; i < 32; ++i) ascending.push_back(static_cast<char>(i));
  EXPECT_EQ(Crc32c(Bytes(ascending)), 0x46dd794eu);
  EXPECT_EQ(Crc32c(Bytes("123456789")), 0xe3069283u);
}

// (crc >> 15 | crc << 17) + 0xa282ead8, worked out apart from the program
TEST(MaskedCrc32c, IsTheRotationThatTheFramesOfTensorFlowHave) {
  EXPECT_EQ(MaskedCrc32c({}), 0xa282ead8u);
  EXPECT_EQ(MaskedCrc32c(Bytes("123456789")), 0xc78ab0e5u);
  EXPECT_EQ(MaskedCrc32c(Bytes(std::string("\x18\0\0\0\0\0\0\0", 8))), 0x224b7fa3u) << "a length of 24";
}

// The whole records of a file, each with its two checksums; fails where something else stands.
std::vector<std::string> RecordsOf(const Path& file) {
  const std::string text = ReadTextFile(file).value_or("");
  std::vector<std::string> records;
  for (std::size_t at = 0; at < text.size();) {
    std::uint64_t length = 0;
    std::uint32_t head = 0, tail = 0;
    if (text.size() - at < 16) {
      ADD_FAILURE() << "a part of a record at byte " << at;
      return records;
    }
    std::memcpy(&length, text.data() + at, 8);
    std::memcpy(&head, text.data() + at + 8, 4);
    EXPECT_EQ(head, MaskedCrc32c(Bytes(text).subspan(at, 8))) << "at byte " << at;
    if (text.size() - at - 16 < length) {
      ADD_FAILURE() << "a cut record at byte " << at;
      return records;
    }
    std::memcpy(&tail, text.data() + at + 12 + length, 4);
    records.push_back(text.substr(at + 12, length));
    EXPECT_EQ(tail, MaskedCrc32c(Bytes(records.back()))) << "at byte " << at;
    at += 16 + length;
  }
  return records;
}

Path OnlyFileIn(const Path& folder) {
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder), {}), 1);
  return std::filesystem::directory_iterator(folder)->path();
}

// of an event: the field behind the time of 1 + 8 bytes
std::uint64_t StepOf(const std::string& record) {
  std::uint64_t step = 0;
  for (std::size_t i = 10; i < record.size(); ++i) {
    step |= static_cast<std::uint64_t>(record[i] & 0x7f) << (7 * (i - 10));
    if ((record[i] & 0x80) == 0) break;
  }
  return step;
}

// TensorBoard reads nothing behind a part of a record: it would show a run that stands still
TEST(EventFile, AShortWriteIsCutBackToWholeRecords) {
  const TemporaryFolder folder;
  const pid_t child = ::fork();
  if (child == 0) {
    ::signal(SIGXFSZ, SIG_IGN);
    auto file = EventFile::Open(folder.path());
    const bool first = file && file->Write(1, {{"loss", 0.5}});
    ::rlimit limit{};
    ::getrlimit(RLIMIT_FSIZE, &limit);
    // the second record has 16 bytes of frame and some of content: it is cut at each of several places
    bool refused = true;
    const auto size = std::filesystem::file_size(std::filesystem::directory_iterator(folder.path())->path());
    for (const std::uint64_t more : {1, 7, 8, 12, 15, 20}) {
      limit.rlim_cur = size + more;
      ::setrlimit(RLIMIT_FSIZE, &limit);
      refused = refused && !file->Write(2, {{"loss", 0.25}});
    }
    limit.rlim_cur = limit.rlim_max;
    ::setrlimit(RLIMIT_FSIZE, &limit);
    const bool third = file->Write(3, {{"loss", 0.125}}).has_value();
    ::_exit(first && refused && third ? 0 : 1);
  }
  int wait_status = 0;
  ASSERT_EQ(::waitpid(child, &wait_status, 0), child);
  EXPECT_EQ(wait_status, 0);

  const auto records = RecordsOf(OnlyFileIn(folder.path()));
  ASSERT_EQ(records.size(), 3u) << "the version, and the two that fitted";
  EXPECT_EQ(StepOf(records[1]), 1u);
  EXPECT_EQ(StepOf(records[2]), 3u);
}

TEST(EventFile, StepsAndNumbersOfAnySizeAreWholeRecords) {
  const TemporaryFolder folder;
  const std::vector<std::uint64_t> steps{0, 127, 128, 16'383, 16'384, 4'000'000'000, 1ull << 62};
  {
    auto file = EventFile::Open(folder.path());
    ASSERT_TRUE(file) << file.error().message;
    for (const std::uint64_t step : steps)
      ASSERT_TRUE(file->Write(step, {{"nan", std::nan("")},
                                     {"large", 1e300},
                                     {"", -0.0},
                                     {std::string(300, 'x'), std::numeric_limits<double>::infinity()}}));
    ASSERT_TRUE(file->Write(1, {}));
  }
  const auto records = RecordsOf(OnlyFileIn(folder.path()));
  ASSERT_EQ(records.size(), steps.size() + 2);
  for (std::size_t i = 0; i < steps.size(); ++i) EXPECT_EQ(StepOf(records[i + 1]), steps[i]);
}

TEST(EventFile, SaysWhereItCannotBeWritten) {
  const TemporaryFolder folder;
  ASSERT_TRUE(WriteFileAtomically(folder / "taken", std::string_view("x")));
  const auto file = EventFile::Open(folder / "taken");
  ASSERT_FALSE(file);
  EXPECT_NE(file.error().message.find("taken"), std::string::npos) << file.error().message;
}

TEST(EventRecord, IsFramedAndReadsBack) {
  const std::string record = EventRecord(12.5, 300, {{"loss", 0.25}});

  std::uint64_t length = 0;
  std::memcpy(&length, record.data(), 8);
  ASSERT_EQ(record.size(), 8 + 4 + length + 4);
  std::uint32_t head_crc = 0, data_crc = 0;
  std::memcpy(&head_crc, record.data() + 8, 4);
  std::memcpy(&data_crc, record.data() + 12 + length, 4);
  EXPECT_EQ(head_crc, MaskedCrc32c(Bytes(record).first(8)));
  EXPECT_EQ(data_crc, MaskedCrc32c(Bytes(record).subspan(12, length)));

  // Event {1: double 12.5, 2: varint 300, 5: Summary {1: Value {1: "loss", 2: float 0.25}}}, byte
  // by byte
  const std::string expected(
      "\x09\x00\x00\x00\x00\x00\x00\x29\x40"
      "\x10\xac\x02"
      "\x2a\x0d\x0a\x0b\x0a\x04loss\x15\x00\x00\x80\x3e",
      9 + 3 + 15);
  EXPECT_EQ(record.substr(12, length), expected);
}

TEST(EventFile, BeginsWithTheVersionAndAppends) {
  const TemporaryFolder folder;
  {
    auto file = EventFile::Open(folder.path());
    ASSERT_TRUE(file) << file.error().message;
    ASSERT_TRUE(file->Write(1, {{"a", 1.0}}));
    ASSERT_TRUE(file->Write(2, {{"a", 2.0}}));
  }
  const Path file = OnlyFileIn(folder.path());
  EXPECT_TRUE(file.filename().string().starts_with("events.out.tfevents."));
  const auto records = RecordsOf(file);
  ASSERT_EQ(records.size(), 3u);
  EXPECT_NE(records[0].find("brain.Event:2"), std::string::npos);
  EXPECT_EQ(StepOf(records[1]), 1u);
  EXPECT_EQ(StepOf(records[2]), 2u);
}

}  // namespace event_file_test
}  // namespace etude::learn
