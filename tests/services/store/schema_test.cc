// SPDX-License-Identifier: Apache-2.0
// Datasets of schemas 1 and 2, made by the programs of their time, open for ever. tests/data/dataset_schema_1 and _2: a
// push and a pick of the UR5, 24x24 px.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "services/core/file.h"
#include "services/episode/action.h"
#include "services/store/dataset.h"
#include "services/store/episode_file.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::store {
namespace schema_test {

constexpr char kOld[] = "tests/data/dataset_schema_1", kSchema2[] = "tests/data/dataset_schema_2";

TEST(Schema1, CommandsAreConvertedToSixNumbersOfRotation) {
  const auto reader = DatasetReader::Open(kOld);
  ASSERT_THAT(reader, IsOk());
  EXPECT_EQ(reader->schema_version(), 1);
  ASSERT_THAT(*reader->List(), testing::ElementsAre(0, 1));

  for (const std::uint64_t index : {0, 1}) {
    const auto episode = reader->ReadWhole(index);
    ASSERT_THAT(episode, IsOk());
    ASSERT_EQ(episode->actions_abs.columns, kWaypointSize);
    ASSERT_EQ(episode->actions_abs.rows(), episode->steps());
    // the hand follows its commands: what was achieved tells whether the angles were read as they were meant
    for (int t = 0; t < episode->steps(); ++t) {
      const Waypoint command = FromVector(episode->actions_abs.row(t).data());
      const auto p = episode->eef_pos.row(t), q = episode->eef_quat.row(t);
      EXPECT_LT((command.X_WE.p - Eigen::Vector3d(p[0], p[1], p[2])).norm(), 0.05) << t;
      EXPECT_LT(AngleBetween(command.X_WE.q, Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized()), 0.1) << t;
      EXPECT_TRUE(command.gripper == 0 || command.gripper == 1);
    }
  }
}

TEST(Schema1, VerifiesAndKeepsTheHashOfItsTime) {
  const auto report = Verify(kOld, Quarantine::kNo);
  ASSERT_THAT(report, IsOk());
  EXPECT_EQ(report->good, 2);
  EXPECT_THAT(report->bad, testing::IsEmpty());
  const auto hash = HashDataset(kOld);
  ASSERT_THAT(hash, IsOk());
  EXPECT_EQ(*hash, "80d0369190a53d435da027c88226290f6927c7321b7d7231e8dfaa646c58a15a");
  const auto info = DatasetInfo(kOld);
  ASSERT_THAT(info, IsOk());
  EXPECT_EQ((*info)["schema_version"], 1);
  EXPECT_THAT((*info)["unreadable"], testing::IsEmpty());
}

TEST(Schema1, IsNotAddedTo) {
  const TemporaryFolder folder;
  std::filesystem::copy(kOld, folder / "old", std::filesystem::copy_options::recursive);
  const auto reader = DatasetReader::Open(folder / "old");
  ASSERT_THAT(reader, IsOk());

  const auto writer = DatasetWriter::Open(folder / "old", reader->spec());

  EXPECT_THAT(writer, HasCode(Code::kInvalidArgument));
  EXPECT_THAT(writer, MessageHas("another folder"));
}

// A frame was a stream until schema 3.
TEST(Schema2, ReadsVerifiesAndKeepsTheHashOfItsTime) {
  const auto reader = DatasetReader::Open(kSchema2);
  ASSERT_THAT(reader, IsOk());
  EXPECT_EQ(reader->schema_version(), 2);
  ASSERT_THAT(*reader->List(), testing::ElementsAre(0, 1));
  const auto record = reader->Read(0);
  ASSERT_THAT(record, IsOk());
  EXPECT_TRUE(record->frames.at(0).layout.whole());
  EXPECT_EQ(record->frames[0].size(), record->frames[0].streams.size());
  FrameReader frames(record->path, record->frames[0]);
  for (std::size_t k = 0; k < record->frames[0].size(); ++k) EXPECT_THAT(frames.Read(k), IsOk()) << k;

  const auto report = Verify(kSchema2, Quarantine::kNo);
  ASSERT_THAT(report, IsOk());
  EXPECT_EQ(report->good, 2);
  const auto hash = HashDataset(kSchema2);
  ASSERT_THAT(hash, IsOk());
  EXPECT_EQ(*hash, "72755effcd3f7bd0492005d8eb9aa0769b8851e84d34a5dd15403c75a1498c6c");
}

TEST(Schema2, ADamagedPictureIsFound) {
  const TemporaryFolder folder;
  std::filesystem::copy(kSchema2, folder / "old", std::filesystem::copy_options::recursive);
  const auto record = DatasetReader::Open(folder / "old")->Read(1);
  ASSERT_THAT(record, IsOk());
  auto bytes = *ReadBinaryFile(record->path, 1 << 20);
  // a checksum of zlib that nobody looks at while it is sealed anew: the hash of its time finds it
  const auto [offset, size] = record->frames[0].streams[2];
  bytes[offset + size - 1] ^= 1;
  bytes.resize(bytes.size() - internal::kSealSize);
  internal::AppendSeal(bytes);
  ASSERT_THAT(WriteFileAtomically(record->path, bytes), IsOk());
  const auto report = Verify(folder / "old", Quarantine::kNo);
  ASSERT_THAT(report, IsOk());
  EXPECT_EQ(report->good, 1);
  ASSERT_EQ(report->bad.size(), 1u);
  EXPECT_THAT(report->bad[0].reason, testing::HasSubstr("SHA-256 differ"));
}

}  // namespace schema_test
}  // namespace etude::store
