// SPDX-License-Identifier: Apache-2.0
// A dataset of schema 1, made by the program of that time, opens for ever. tests/data/dataset_schema_1: a push and a
// pick of the UR5, 24x24 px.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "services/core/file.h"
#include "services/episode/action.h"
#include "services/store/dataset.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::store {
namespace schema_test {

constexpr char kOld[] = "tests/data/dataset_schema_1";

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

}  // namespace schema_test
}  // namespace etude::store
