// SPDX-License-Identifier: Apache-2.0
// Tests services/export/parquet_writer.cc, parquet_page.cc, thrift_compact.cc: read back by a reader that shares
// nothing with them, and by hyparquet where Node has it.
#include "services/export/parquet_writer.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

#include "services/export/thrift_compact.h"
#include "tests/services/export/node_reader.h"
#include "tests/services/export/parquet_reader.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::exports {
namespace parquet_writer_test {

TEST(ThriftWriter, WritesWhatTheProtocolsDescriptionSays) {
  internal::ThriftWriter thrift;
  thrift.Integer(1, -1);
  thrift.Long(3, 300);
  thrift.Text(20, "ab");
  thrift.BeginStruct(21);
  thrift.Integers(1, {1, 2});
  thrift.EndStruct();
  thrift.EndStruct();

  // 1: i32 -1 | 3: i64 zigzag 600 | 20: long form, binary | 21: struct {1: list of two i32}
  EXPECT_EQ(thrift.bytes(), std::string("\x15\x01\x26\xd8\x04\x08\x28\x02"
                                        "ab"
                                        "\x1c\x19\x25\x02\x04\x00\x00",
                                        17));
}

TEST(ThriftWriter, CountsLongListsApart) {
  internal::ThriftWriter thrift;
  thrift.Integers(1, std::vector<std::int32_t>(20, 0));
  thrift.EndStruct();

  EXPECT_EQ(thrift.bytes().substr(0, 3), std::string("\x19\xf5\x14", 3));
  EXPECT_EQ(thrift.bytes().size(), 3u + 20 + 1);
}

class Parquet : public testing::Test {
 protected:
  // every type, lists of equal and unequal lengths, lists of lists; `groups` times 100 rows
  void WriteExample(int groups) {
    auto file = ParquetWriter::Create(path_,
                                      {{"flag", ParquetType::kBool},
                                       {"number", ParquetType::kInt64},
                                       {"t", ParquetType::kFloat},
                                       {"x/y.z", ParquetType::kDouble},
                                       {"text", ParquetType::kText},
                                       {"vector", ParquetType::kFloat, 1},
                                       {"words", ParquetType::kText, 1},
                                       {"picture", ParquetType::kDouble, 3}},
                                      {{"key", "a value"}});
    ASSERT_THAT(file, IsOk());
    for (int g = 0; g < groups; ++g) {
      ASSERT_THAT(file->WriteRowGroup(100, ExampleCells(g)), IsOk());
    }
    EXPECT_EQ(file->rows(), static_cast<std::uint64_t>(groups) * 100);
    ASSERT_THAT(file->Finish(), IsOk());
    EXPECT_EQ(file->bytes(), std::filesystem::file_size(path_));
  }

  static OrderedJson ExampleRow(int g, int i) {
    OrderedJson words = OrderedJson::array();
    for (int k = 0; k < i % 3; ++k) words.push_back("w" + std::to_string(k));
    return {{"flag", i % 3 == 0},
            {"number", (std::int64_t{1} << (i % 63)) - g},
            {"t", static_cast<float>(i) / 25},
            {"x/y.z", 0.5 * i - g},
            {"text", i == 7 ? "" : "ä" + std::to_string(i)},
            {"vector", OrderedJson::array({1.0f * i, -2.0f * g})},
            {"words", words},
            {"picture", OrderedJson::parse(fmt::format("[[[{}]],[[1.0]],[[2.0]]]", 0.25 * i))}};
  }

  static std::vector<ParquetCells> ExampleCells(int g) {
    std::vector<std::uint8_t> flags;
    std::vector<std::int64_t> numbers;
    std::vector<float> times, vectors;
    std::vector<double> doubles, pictures;
    std::vector<std::string> texts;
    ParquetCells words{std::vector<std::string>{}, {{}}};
    for (int i = 0; i < 100; ++i) {
      const OrderedJson row = ExampleRow(g, i);
      flags.push_back(row["flag"].get<bool>());
      numbers.push_back(row["number"].get<std::int64_t>());
      times.push_back(row["t"].get<float>());
      doubles.push_back(row["x/y.z"].get<double>());
      texts.push_back(row["text"].get<std::string>());
      for (const auto& value : row["vector"]) vectors.push_back(value.get<float>());
      for (const auto& word : row["words"])
        std::get<std::vector<std::string>>(words.values).push_back(word.get<std::string>());
      words.lengths[0].push_back(static_cast<std::uint32_t>(row["words"].size()));
      for (const auto& channel : row["picture"]) pictures.push_back(channel[0][0].get<double>());
    }
    return {Cells(flags), Cells(numbers),           Cells(times), Cells(doubles),
            Cells(texts), Lists(vectors, 100, {2}), words,        Lists(pictures, 100, {3, 1, 1})};
  }

  TemporaryFolder folder_;
  Path path_ = folder_ / "a.parquet";
};

TEST_F(Parquet, GivesBackWhatWasWritten) {
  WriteExample(3);

  const ParquetFile file(path_);

  ASSERT_EQ(file.rows().size(), 300u);
  for (int g = 0; g < 3; ++g)
    for (int i = 0; i < 100; ++i)
      ASSERT_EQ(file.rows()[static_cast<std::size_t>(100 * g + i)], ExampleRow(g, i)) << g << " " << i;
  EXPECT_EQ(file.metadata(), (std::map<std::string, std::string>{{"key", "a value"}}));
  EXPECT_EQ(file.footer().at(3).number, 300);
  EXPECT_EQ(file.footer().at(4).list.size(), 3u);
}

TEST_F(Parquet, SaysMinimaAndMaximaOfNumbersButNotOfNaN) {
  auto file = ParquetWriter::Create(path_, {{"a", ParquetType::kFloat}, {"b", ParquetType::kFloat}}, {});
  ASSERT_THAT(file, IsOk());
  const float nan = std::numeric_limits<float>::quiet_NaN();
  ASSERT_THAT(file->WriteRowGroup(2, {Cells(std::vector<float>{0, 2.5f}), Cells(std::vector<float>{1, nan})}), IsOk());
  ASSERT_THAT(file->Finish(), IsOk());

  const ParquetFile read(path_);
  const auto& chunks = read.footer().at(4).list[0].at(1).list;
  float low = 1, high = 0;
  std::memcpy(&low, chunks[0].at(3).at(12).at(6).text.data(), 4);
  std::memcpy(&high, chunks[0].at(3).at(12).at(5).text.data(), 4);
  EXPECT_TRUE(low == 0 && std::signbit(low));  // as the format wants it
  EXPECT_EQ(high, 2.5f);
  EXPECT_FALSE(chunks[1].at(3).has(12));
  EXPECT_TRUE(std::isnan(read.rows()[1]["b"].get<float>()));
}

class ParquetReadBy : public Parquet, public testing::WithParamInterface<const char*> {};

INSTANTIATE_TEST_SUITE_P(Readers, ParquetReadBy, testing::ValuesIn(kNodeReaders), [](const auto& info) {
  return std::string(info.param) == "hyparquet" ? "Hyparquet" : "ParquetWasm";
});

TEST_P(ParquetReadBy, IsTheSame) {
  WriteExample(2);

  const auto seen = ReadWithNode(GetParam(), path_);
  if (!seen) GTEST_SKIP() << GetParam() << " is not there (tests/services/export/README.md)";

  ASSERT_EQ((*seen)["rows"].size(), 200u);
  for (int g = 0; g < 2; ++g)
    for (int i = 0; i < 100; ++i) {
      OrderedJson row = ExampleRow(g, i);
      OrderedJson other = (*seen)["rows"][static_cast<std::size_t>(100 * g + i)];
      EXPECT_EQ(other["number"], row["number"].dump());  // larger than what JavaScript's numbers hold
      EXPECT_FLOAT_EQ(other["t"].get<float>(), row["t"].get<float>());
      for (const char* key : {"number", "t"}) {
        other.erase(key);
        row.erase(key);
      }
      EXPECT_EQ(other, row) << g << " " << i;
    }
  EXPECT_EQ((*seen)["metadata"]["key"], "a value");
}

// rows of none, of empty and of full lists, within each other: what repetition and definition levels are for
TEST_F(Parquet, ListsOfListsMayBeEmptyAtEveryDepth) {
  const std::vector<OrderedJson> rows{OrderedJson::parse("[]"),          OrderedJson::parse("[[]]"),
                                      OrderedJson::parse("[[1],[]]"),    OrderedJson::parse("[[],[2,3]]"),
                                      OrderedJson::parse("[[],[],[]]"),  OrderedJson::parse("[[4,5,6]]"),
                                      OrderedJson::parse("[[7],[8,9]]"), OrderedJson::parse("[[10],[],[11]]")};
  std::vector<std::int64_t> values;
  ParquetCells cells{values, {{}, {}}};
  for (const auto& row : rows) {
    cells.lengths[0].push_back(static_cast<std::uint32_t>(row.size()));
    for (const auto& list : row) {
      cells.lengths[1].push_back(static_cast<std::uint32_t>(list.size()));
      for (const auto& value : list) values.push_back(value.get<std::int64_t>());
    }
  }
  cells.values = values;
  auto file = ParquetWriter::Create(path_, {{"l", ParquetType::kInt64, 2}}, {});
  ASSERT_THAT(file, IsOk());
  ASSERT_THAT(file->WriteRowGroup(rows.size(), {cells}), IsOk());
  ASSERT_THAT(file->Finish(), IsOk());
  const ParquetFile read(path_);
  ASSERT_EQ(read.rows().size(), rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) EXPECT_EQ(read.rows()[i]["l"], rows[i]) << i;
}

TEST_F(Parquet, NumbersAtTheEdgeOfTheirTypesAndTextsOfAnyBytesComeBack) {
  const std::vector<std::int64_t> numbers{INT64_MIN, -1, 0, 1, INT64_MAX};
  const std::vector<double> reals{-0.0, 5e-324, 1.7976931348623157e308, -1e-300, 0.1};
  const std::vector<std::string> texts{"", std::string("a\0b", 3), std::string(70'000, 'x'), "\xc3\xa4", "PAR1"};
  const std::vector<std::uint8_t> flags{1, 0, 0, 1, 1};
  auto file = ParquetWriter::Create(
      path_,
      {{"n", ParquetType::kInt64}, {"r", ParquetType::kDouble}, {"t", ParquetType::kText}, {"b", ParquetType::kBool}},
      {});
  ASSERT_THAT(file, IsOk());
  ASSERT_THAT(file->WriteRowGroup(5, {Cells(numbers), Cells(reals), Cells(texts), Cells(flags)}), IsOk());
  ASSERT_THAT(file->Finish(), IsOk());
  const ParquetFile read(path_);
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_EQ(read.rows()[i]["n"].get<std::int64_t>(), numbers[i]);
    EXPECT_EQ(read.rows()[i]["r"].get<double>(), reals[i]);
    EXPECT_EQ(read.rows()[i]["t"].get<std::string>(), texts[i]) << i;
    EXPECT_EQ(read.rows()[i]["b"].get<bool>(), flags[i] != 0);
  }
  // what the footer says of the first column is the least and the most of it
  const auto& statistics = read.footer().at(4).list[0].at(1).list[0].at(3).at(12);
  std::int64_t low = 0, high = 0;
  std::memcpy(&low, statistics.at(6).text.data(), 8);
  std::memcpy(&high, statistics.at(5).text.data(), 8);
  EXPECT_EQ(low, INT64_MIN);
  EXPECT_EQ(high, INT64_MAX);
}

// bits of truth values fill whole bytes, whatever their number; long runs of one level are one run
TEST_F(Parquet, AnyNumberOfRowsIsWhole) {
  for (const int count : {1, 7, 8, 9, 63, 64, 65, 1000, 20'000}) {
    std::vector<std::uint8_t> flags;
    for (int i = 0; i < count; ++i) flags.push_back(i % 5 == 0);
    const Path path = folder_ / (std::to_string(count) + ".parquet");
    auto file = ParquetWriter::Create(path, {{"b", ParquetType::kBool}, {"l", ParquetType::kBool, 1}}, {});
    ASSERT_THAT(file, IsOk());
    ASSERT_THAT(file->WriteRowGroup(static_cast<std::size_t>(count),
                                    {Cells(flags), Lists(flags, static_cast<std::size_t>(count), {1})}),
                IsOk());
    ASSERT_THAT(file->Finish(), IsOk());
    const ParquetFile read(path);
    ASSERT_EQ(read.rows().size(), flags.size());
    for (std::size_t i = 0; i < flags.size(); ++i) {
      ASSERT_EQ(read.rows()[i]["b"].get<bool>(), flags[i] != 0) << count << " " << i;
      ASSERT_EQ(read.rows()[i]["l"], OrderedJson::array({flags[i] != 0})) << count << " " << i;
    }
  }
}

TEST_F(Parquet, RefusesCellsThatDoNotFit) {
  auto file = ParquetWriter::Create(path_, {{"a", ParquetType::kFloat}, {"b", ParquetType::kInt64, 1}}, {});
  ASSERT_THAT(file, IsOk());
  const auto a = Cells(std::vector<float>{1, 2});
  const std::vector<std::int64_t> three{1, 2, 3};

  EXPECT_THAT(file->WriteRowGroup(2, {a}), MessageHas("values of 1 columns, it has 2"));
  EXPECT_THAT(file->WriteRowGroup(2, {a, Cells(three)}), MessageHas("column 'b'"));
  EXPECT_THAT(file->WriteRowGroup(2, {Cells(three), Lists(three, 1, {3})}), MessageHas("another type"));
  EXPECT_THAT(file->WriteRowGroup(3, {a, Lists(three, 3, {1})}), MessageHas("2 values, not 3"));
  EXPECT_THAT(file->WriteRowGroup(2, {a, ParquetCells{three, {{1, 1}}}}), MessageHas("3 values, not 2"));
  EXPECT_THAT(file->WriteRowGroup(2, {a, ParquetCells{three, {{3}}}}), MessageHas("1 lengths of lists, not 2"));

  // nothing of those was written
  ASSERT_THAT(file->WriteRowGroup(2, {a, ParquetCells{three, {{3, 0}}}}), IsOk());
  ASSERT_THAT(file->Finish(), IsOk());
  EXPECT_EQ(ParquetFile(path_).rows()[1]["b"], OrderedJson::array());
}

TEST_F(Parquet, RefusesColumnsWithoutOrWithOneName) {
  EXPECT_THAT(ParquetWriter::Create(path_, {}, {}), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(ParquetWriter::Create(path_, {ParquetColumn{"a"}, ParquetColumn{"a"}}, {}), MessageHas("has it twice"));
  EXPECT_THAT(ParquetWriter::Create(path_, {ParquetColumn{""}}, {}), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(ParquetWriter::Create(folder_ / "none/a.parquet", {ParquetColumn{"a"}}, {}), HasCode(Code::kNotFound));
}

}  // namespace parquet_writer_test
}  // namespace etude::exports
