// SPDX-License-Identifier: Apache-2.0
// Tests worker/view/scene_picture.cc: what is written is what the camera sees
#include "worker/view/scene_picture.h"

#include <gmock/gmock.h>

#include <cmath>
#include <filesystem>
#include <numbers>
#include <opencv2/imgcodecs.hpp>

#include "services/episode/camera.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude {
namespace scene_picture_test {

CampaignSpec SmallSpec() {
  CampaignSpec spec;
  spec.tasks = {"pick"};
  spec.objects = {"coke", "milk", "bread"};
  spec.camera.width = 96;
  spec.camera.height = 64;
  return spec;
}

class ScenePicture : public testing::Test {
 protected:
  // What is said while the pictures are written.
  std::string Write(const std::string& name, const ScenePictureOptions& options) {
    testing::internal::CaptureStdout();
    const Status status = WriteScenePictures(SmallSpec(), folder_ / name, options, {});
    const std::string said = testing::internal::GetCapturedStdout();
    EXPECT_THAT(status, IsOk());
    return said;
  }
  cv::Mat Read(const std::string& name) { return cv::imread((folder_ / name).string(), cv::IMREAD_UNCHANGED); }

  TemporaryFolder folder_;
};

// Metres along the viewing direction to the table, z = 0, at a pixel.
double DepthOfTable(const CameraSpec& spec, int u, int v) {
  const double focal = spec.height / 2.0 / std::tan(spec.fovy_deg * std::numbers::pi / 360);
  const Eigen::Vector3d ray_C((u + 0.5 - spec.width / 2.0) / focal, -(v + 0.5 - spec.height / 2.0) / focal, -1);
  const Eigen::Vector3d ray_W = FromEuler(Eigen::Vector3d::Map(spec.euler.data())) * ray_C;
  return -spec.position[2] / ray_W.z();
}

TEST_F(ScenePicture, DepthIsMillimetresAlongTheViewAndSegmentsAreBodies) {
  const std::string said = Write("scene.png", {.segmentation = true, .depth = true});
  for (const char* file : {"scene.png\n", "scene-segmentation.png\n", "scene-depth.png\n", "episode 0: \""})
    EXPECT_THAT(said, testing::HasSubstr(file));
  const cv::Mat colour = Read("scene.png"), bodies = Read("scene-segmentation.png"), depth = Read("scene-depth.png");
  ASSERT_EQ(colour.type(), CV_8UC3);
  ASSERT_EQ(depth.type(), CV_16UC1);
  for (const cv::Mat& picture : {colour, bodies, depth}) EXPECT_EQ(picture.size(), cv::Size(96, 64));

  const cv::Vec3b table(90, 90, 90), nothing(0, 0, 0);
  int on_table = 0, nearer = 0;
  for (int v = 0; v < 64; ++v)
    for (int u = 0; u < 96; ++u) {
      const auto body = bodies.at<cv::Vec3b>(v, u);
      const double expected = 1000 * DepthOfTable(SmallSpec().camera, u, v), found = depth.at<std::uint16_t>(v, u);
      if (body == table) {
        ++on_table;
        EXPECT_NEAR(found, expected, 0.004 * expected) << u << " " << v;
      } else if (body != nothing && expected > 0) {
        nearer += found < expected;
        EXPECT_LT(found, 1.01 * expected) << "what stands on the table is before it";
      }
    }
  EXPECT_GT(on_table, 1000);
  EXPECT_GT(nearer, 100) << "objects and robot";
}

TEST_F(ScenePicture, EpisodesAreSideBySideInTheOrderAskedFor) {
  Write("first.png", {.indices = {4}});
  Write("second.png", {.indices = {0}});
  Write("both.png", {.indices = {4, 0}});
  const cv::Mat first = Read("first.png"), second = Read("second.png"), both = Read("both.png");
  ASSERT_EQ(both.size(), cv::Size(192, 64));
  EXPECT_EQ(cv::norm(both.colRange(0, 96), first, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(both.colRange(96, 192), second, cv::NORM_INF), 0);
  EXPECT_GT(cv::norm(first, second, cv::NORM_INF), 50) << "two scenes";
}

TEST_F(ScenePicture, AnotherAttemptIsAnotherSceneWithTheSameTarget) {
  const std::string once = Write("a.png", {.indices = {2}}), again = Write("b.png", {.indices = {2}, .attempt = 1});
  EXPECT_GT(cv::norm(Read("a.png"), Read("b.png"), cv::NORM_INF), 50);
  const auto asked = [](const std::string& said) { return said.substr(said.find(" ("), 16); };  // " (ur5: pick coke"
  EXPECT_EQ(asked(once), asked(again));
}

TEST_F(ScenePicture, AJpegsSegmentsAreJpegAndItsDepthIsNot) {
  Write("scene.jpg", {.segmentation = true, .depth = true});
  EXPECT_EQ(ReadBinaryFile(folder_ / "scene.jpg").value()[0], 0xff);
  EXPECT_EQ(ReadBinaryFile(folder_ / "scene-segmentation.jpg").value()[0], 0xff);
  EXPECT_EQ(Read("scene-depth.png").type(), CV_16UC1) << "millimetres survive no JPEG";
}

TEST_F(ScenePicture, SaysWhatIsWrong) {
  EXPECT_THAT(WriteScenePictures(SmallSpec(), folder_ / "a.png", {.indices = {}}, {}), HasCode(Code::kInvalidArgument));
  CampaignSpec spec = SmallSpec();
  spec.robots = {"ur55"};
  EXPECT_THAT(WriteScenePictures(spec, folder_ / "a.png", {}, {}), MessageHas("did you mean 'ur5'?"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "a.png"));
}

}  // namespace scene_picture_test
}  // namespace etude
