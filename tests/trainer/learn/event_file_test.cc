// SPDX-License-Identifier: Apache-2.0
// Tests trainer/learn/event_file.cc
#include "trainer/learn/event_file.h"

#include <gtest/gtest.h>

#include <cstring>
#include <filesystem>

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
  int files = 0;
  for (const auto& item : std::filesystem::directory_iterator(folder.path())) {
    ++files;
    EXPECT_TRUE(item.path().filename().string().starts_with("events.out.tfevents."));
    const auto text = ReadTextFile(item.path());
    ASSERT_TRUE(text);
    EXPECT_NE(text->find("brain.Event:2"), std::string::npos);
    int records = 0;
    for (std::size_t at = 0; at < text->size(); ++records) {
      std::uint64_t length = 0;
      std::memcpy(&length, text->data() + at, 8);
      at += 16 + length;
      ASSERT_LE(at, text->size());
    }
    EXPECT_EQ(records, 3);
  }
  EXPECT_EQ(files, 1);
}

}  // namespace event_file_test
}  // namespace etude::learn
