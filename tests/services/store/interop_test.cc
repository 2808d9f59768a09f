// SPDX-License-Identifier: Apache-2.0
// What h5py and h5dump, readers that are not ours, see in an episode's file and through the master
// file.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "services/core/hash.h"
#include "services/episode/frame_cursor.h"
#include "services/spec/episode_plan.h"
#include "services/store/dataset.h"
#include "tests/services/store/read_with_h5py.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude::store {
namespace interop_test {

class Interop : public testing::Test {
 protected:
  void SetUp() override {
    auto writer = DatasetWriter::Open(folder_.path(), spec_);
    ASSERT_THAT(writer, IsOk());
    for (std::uint64_t i = 0; i < 12; ++i) ASSERT_THAT(writer->Commit(MakeSyntheticEpisode(spec_, i, 23)), IsOk());
    ASSERT_THAT(writer->WriteMaster(), IsOk());
  }

  // GTEST_SKIP must stand in the test itself, so this says whether h5py is there
  bool See(const Path& file, const std::string& group) {
    const auto seen = ReadWithH5py(file, group);
    if (seen) seen_ = *seen;
    return seen.has_value();
  }

  void ExpectArray(const std::string& name, const Json& description) {
    EXPECT_EQ(seen_["arrays"][name], description) << name;
  }

  TemporaryFolder folder_;
  CampaignSpec spec_ = SyntheticSpec(40, 24);
  Json seen_;
};

TEST_F(Interop, H5pySeesRobomimicsLayoutInAnEpisodeFile) {
  if (!See(EpisodePath(folder_.path(), 3), "/data/demo_3")) GTEST_SKIP() << "python3-h5py is not installed";
  const Episode episode = MakeSyntheticEpisode(spec_, 3, 23);

  ExpectArray("actions", {"float32", {5, 10}, nullptr, nullptr});
  ExpectArray("actions_abs", {"float32", {5, 10}, nullptr, nullptr});
  ExpectArray("rewards", {"float32", {5}, nullptr, nullptr});
  ExpectArray("dones", {"int64", {5}, nullptr, nullptr});
  ExpectArray("states", {"float32", {5, 8}, nullptr, nullptr});
  ExpectArray("obs/front_image", {"uint8", {5, 24, 40, 3}, {5, 24, 40, 3}, "gzip"});
  ExpectArray("obs/robot0_eef_pos", {"float32", {5, 3}, nullptr, nullptr});
  ExpectArray("obs/robot0_eef_quat", {"float32", {5, 4}, nullptr, nullptr});
  ExpectArray("obs/robot0_joint_pos", {"float32", {5, 6}, nullptr, nullptr});
  ExpectArray("obs/robot0_gripper_qpos", {"float32", {5, 1}, nullptr, nullptr});
  ExpectArray("obs/object", {"float32", {5, 42}, nullptr, nullptr});
  ExpectArray("control/eef_pos", {"float32", {23, 3}, nullptr, nullptr});
  ExpectArray("control/objects/milk/pixel", {"float32", {23, 2}, nullptr, nullptr});
  ExpectArray("cameras/front/intrinsics", {"float64", {3, 3}, nullptr, nullptr});
  const Json& attributes = seen_["attributes"];
  EXPECT_EQ(attributes["num_samples"], 5);
  EXPECT_EQ(attributes["instruction"], episode.instruction);
  EXPECT_EQ(attributes["seed"].get<std::uint64_t>(), episode.seed);
  EXPECT_EQ(attributes["target"], episode.target);
  EXPECT_EQ(Json::parse(attributes["details"].get<std::string>()), Json(episode.details));
  EXPECT_EQ(seen_["data"]["total"], 5);
  EXPECT_TRUE(Json::parse(seen_["data"]["env_args"].get<std::string>()).contains("env_kwargs"));
}

TEST_F(Interop, H5pySeesTheEpisodesValues) {
  if (!See(EpisodePath(folder_.path(), 3), "/data/demo_3")) GTEST_SKIP() << "python3-h5py is not installed";
  const Episode episode = MakeSyntheticEpisode(spec_, 3, 23);
  FrameCursor frames(episode);
  const Json& values = seen_["values"];

  for (int k = 0; k < 5; ++k) {
    // pictures at 0, 5, ...; the action is the last command before the next picture
    const int t = 5 * k;
    const int command = std::min(t + 4, 22);
    for (int i = 0; i < 3; ++i) {
      EXPECT_EQ(values["obs/robot0_eef_pos"][k][i].get<float>(), episode.eef_pos.row(t)[i]);
      EXPECT_EQ(values["actions_abs"][k][i].get<float>(), episode.actions_abs.row(command)[i]);
    }
    EXPECT_EQ(values["obs/robot0_eef_quat"][k], Json({1, 0, 0, 0}));  // w x y z = 0 1 0 0
    EXPECT_NEAR(values["actions"][k][0].get<double>(), episode.actions_abs.row(command)[0] / 1.5, 1e-6);
    EXPECT_NEAR(values["actions"][k][9].get<double>(), 2 * episode.actions_abs.row(command)[9] - 1, 1e-6);
    EXPECT_EQ(values["obs/front_image"][k], Sha256Hex(*frames.Frame(static_cast<std::size_t>(k))));
  }
  EXPECT_EQ(values["dones"], Json({0, 0, 0, 0, 1}));
  EXPECT_EQ(values["rewards"], Json({0, 0, 0, 0, 1}));

  // u = K p_C with the matrices alone
  const Json& K = values["cameras/front/intrinsics"];
  const Json& X = values["cameras/front/pose"];
  Eigen::Matrix4d X_WC;
  Eigen::Matrix3d intrinsics;
  for (int r = 0; r < 4; ++r)
    for (int c = 0; c < 4; ++c) X_WC(r, c) = X[r][c].get<double>();
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) intrinsics(r, c) = K[r][c].get<double>();
  const auto p = episode.eef_pos.row(0);
  const Eigen::Vector4d p_C = X_WC.inverse() * Eigen::Vector4d(p[0], p[1], p[2], 1);
  const Eigen::Vector3d u = intrinsics * p_C.head<3>();
  EXPECT_NEAR(u.x() / u.z(), episode.eef_pixel.row(0)[0], 1e-3);
  EXPECT_NEAR(u.y() / u.z(), episode.eef_pixel.row(0)[1], 1e-3);
}

TEST_F(Interop, H5pyFollowsTheMasterFileAndItsMasks) {
  if (!See(folder_ / "dataset.hdf5", "/data/demo_11")) GTEST_SKIP() << "python3-h5py is not installed";

  EXPECT_EQ(seen_["demos"].size(), 12u);
  EXPECT_EQ(seen_["data"]["total"], 12 * 5);
  EXPECT_EQ(seen_["attributes"]["index"], 11);
  ExpectArray("obs/front_image", {"uint8", {5, 24, 40, 3}, {5, 24, 40, 3}, "gzip"});
  std::map<std::string, std::vector<std::string>> masks{{"train", {}}, {"valid", {}}, {"test", {}}};
  for (std::uint64_t i = 0; i < 12; ++i) {
    masks[SplitOf(spec_, i)].push_back("demo_" + std::to_string(i));
    masks[PlanEpisode(spec_, i, 0).task.text()].push_back("demo_" + std::to_string(i));
  }
  EXPECT_EQ(seen_["mask"], Json(masks));
}

TEST_F(Interop, TheMasterFileMayBeMovedWithItsDataset) {
  const TemporaryFolder other;
  std::filesystem::rename(folder_.path(), other / "moved");
  std::filesystem::create_directory(folder_.path());

  if (!See(other / "moved/dataset.hdf5", "/data/demo_2")) GTEST_SKIP() << "python3-h5py is not installed";

  EXPECT_EQ(seen_["attributes"]["index"], 2);
}

TEST_F(Interop, H5dumpReadsEveryByteOfAnEpisodeFile) {
  if (RunInShell("h5dump --version 2>&1").code != 0) GTEST_SKIP() << "hdf5-tools is not installed";

  const ShellOutput dump = RunInShell("h5dump " + EpisodePath(folder_.path(), 0).string() + " 2>&1");

  EXPECT_EQ(dump.code, 0) << dump.text.substr(0, 500);
  EXPECT_THAT(dump.text, testing::HasSubstr("GROUP \"demo_0\""));
  EXPECT_THAT(dump.text, testing::HasSubstr("DATASET \"front_image\""));
}

}  // namespace interop_test
}  // namespace etude::store
