// SPDX-License-Identifier: Apache-2.0
// Tests trainer/policy/crop.cc
#include "trainer/policy/crop.h"

#include <gmock/gmock.h>

#include <numbers>

#include "services/spec/campaign_spec.h"

namespace etude::policy {
namespace crop_test {

Camera CameraOf(double fovy_deg, int side = 224) {
  const CameraSpec spec;
  Camera camera{.width = side, .height = side, .fovy = fovy_deg * std::numbers::pi / 180};
  camera.X_WC = {{spec.position[0], spec.position[1], spec.position[2]},
                 FromEuler({spec.euler[0], spec.euler[1], spec.euler[2]})};
  return camera;
}

ImageConfig Compact() {
  ImageConfig image;
  image.layers = {{.kind = "conv", .stride = 2}, {.kind = "conv", .stride = 2}};
  return image;
}

// corners of the work volume, in px from the crop's corner
void ExpectHolds(const ImageConfig& image, const codec::Region& crop, const Camera& camera) {
  for (int corner = 0; corner < 8; ++corner) {
    const auto at = [&](int axis) { return image.work_volume[2 * axis + ((corner >> axis) & 1)]; };
    const Eigen::Vector2d pixel = camera.Project({at(0), at(1), at(2)});
    EXPECT_GT(pixel.x(), crop.u);
    EXPECT_LT(pixel.x(), crop.u + crop.width);
    EXPECT_GT(pixel.y(), crop.v);
    EXPECT_LT(pixel.y(), crop.v + crop.height);
  }
}

TEST(ResolveCrop, OfTheDefaultCameraIsWhatCompactWasTunedOn) {
  const auto crop = ResolveCrop(Compact(), CameraOf(60));
  ASSERT_TRUE(crop) << crop.error().message;
  EXPECT_EQ(*crop, (codec::Region{40, 75, 144, 80}));
  ExpectHolds(Compact(), *crop, CameraOf(60));
}

// with compact's old numbers a seventh of the objects of a 40 degree campaign lay outside
TEST(ResolveCrop, FollowsTheCamera) {
  for (const double fovy : {40.0, 45.0, 50.0, 70.0, 90.0}) {
    const auto crop = ResolveCrop(Compact(), CameraOf(fovy));
    ASSERT_TRUE(crop) << crop.error().message;
    EXPECT_TRUE(codec::Fits(*crop, 224, 224)) << fovy;
    EXPECT_EQ(crop->width % 8, 0);
    EXPECT_EQ(crop->height % 8, 0);
    ExpectHolds(Compact(), *crop, CameraOf(fovy));
  }
  const auto narrow = ResolveCrop(Compact(), CameraOf(20));  // more than the picture has
  ASSERT_TRUE(narrow);
  EXPECT_EQ(narrow->width, 224);
  const auto small = ResolveCrop(Compact(), CameraOf(60, 112));
  ASSERT_TRUE(small);
  EXPECT_EQ(small->width, 80);
}

TEST(ResolveCrop, OfAMovingCameraHoldsWhatEachOfThemSees) {
  const ImageConfig image = Compact();
  std::vector<Camera> cameras{CameraOf(60), CameraOf(52), CameraOf(66)};
  cameras[1].X_WC.p += Eigen::Vector3d(0.1, 0.05, 0.1);
  cameras[2].X_WC.p -= Eigen::Vector3d(0.1, 0, 0.1);
  const auto crop = ResolveCrop(image, cameras);
  ASSERT_TRUE(crop) << crop.error().message;
  EXPECT_TRUE(codec::Fits(*crop, 224, 224));
  for (const Camera& camera : cameras) ExpectHolds(image, *crop, camera);
  const auto alone = ResolveCrop(image, cameras[0]);
  EXPECT_GT(crop->width, alone->width);
  EXPECT_EQ(*ResolveCrop(image, std::vector<Camera>(5, cameras[0])), *alone) << "one that stands still";

  cameras.push_back(CameraOf(20));
  EXPECT_EQ(ResolveCrop(image, cameras)->width, 224) << "no more than the picture has";
  ImageConfig fixed = image;
  fixed.crop = {41, 75, 144, 80};
  EXPECT_EQ(*ResolveCrop(fixed, cameras), (codec::Region{41, 75, 144, 80})) << "as it is asked for";
}

TEST(ResolveCrop, RefusesWhatCannotBe) {
  ImageConfig image = Compact();
  image.crop = {41, 75, 144, 80};
  EXPECT_TRUE(ResolveCrop(image, CameraOf(60)));
  const auto large = ResolveCrop(image, CameraOf(60, 128));
  ASSERT_FALSE(large);
  EXPECT_THAT(large.error().message, testing::HasSubstr("144x80 px at (41, 75)"));

  image.crop.clear();
  Camera away = CameraOf(60);
  away.X_WC.q = away.X_WC.q * FromEuler({0, std::numbers::pi, 0});
  EXPECT_FALSE(ResolveCrop(image, away));
  image.work_volume = {5, 6, 0, 1, 0, 1};
  EXPECT_FALSE(ResolveCrop(image, CameraOf(30)));
}

}  // namespace crop_test
}  // namespace etude::policy
