// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/occluder.cc
#include "worker/task/occluder.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "tests/worker/sim/scene_fixture.h"

namespace etude::task {
namespace occluder_test {

constexpr int kWidth = 60, kHeight = 44;  // no multiples of a block
constexpr std::size_t kPixels = static_cast<std::size_t>(kWidth) * kHeight;

// An ellipse, off the grid.
std::vector<std::uint8_t> Target(double u, double v, double a, double b) {
  std::vector<std::uint8_t> target(kPixels, 0);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x)
      target[static_cast<std::size_t>(y) * kWidth + x] = std::hypot((x - u) / a, (y - v) / b) < 1 ? 255 : 0;
  return target;
}

struct Picture {
  std::vector<std::uint8_t> rgb = std::vector<std::uint8_t>(3 * kPixels, 7);

  bool Grey(std::size_t pixel) const {
    return std::all_of(&rgb[3 * pixel], &rgb[3 * pixel] + 3, [](std::uint8_t c) { return c == kOcclusionGrey; });
  }
  bool Untouched(std::size_t pixel) const {
    return std::all_of(&rgb[3 * pixel], &rgb[3 * pixel] + 3, [](std::uint8_t c) { return c == 7; });
  }
};

int BlockOf(std::size_t pixel) {
  const int columns = (kWidth + kOcclusionBlock - 1) / kOcclusionBlock;
  return static_cast<int>(pixel) / kWidth / kOcclusionBlock * columns +
         static_cast<int>(pixel) % kWidth / kOcclusionBlock;
}

int Shown(const std::vector<std::uint8_t>& target) {
  return static_cast<int>(kPixels - static_cast<std::size_t>(std::ranges::count(target, 0)));
}

TEST(CoverBlocks, ReachesTheShareToThePixelInWholeBlocksButForTheLast) {
  const auto order = OcclusionOrder(kWidth, kHeight, 5);
  for (const auto& target : {Target(30, 21, 11, 14), Target(3, 3, 9, 9), Target(58, 40, 8, 8), Target(20, 20, 2, 3)})
    for (const double share : {0.0, 0.01, 0.2, 0.42, 0.68, 0.8, 1.0}) {
      Picture picture;
      const int covered = CoverBlocks(target, kWidth, kHeight, share, order, picture.rgb);
      EXPECT_GE(covered, share * Shown(target) - 1e-9);
      EXPECT_LT(covered, share * Shown(target) + 1) << "no pixel more than it takes";
      int grey = 0;
      std::set<int> touched, whole;  // blocks
      for (std::size_t pixel = 0; pixel < kPixels; ++pixel) {
        ASSERT_TRUE(picture.Grey(pixel) || picture.Untouched(pixel)) << "either grey or as it was";
        grey += picture.Grey(pixel) && target[pixel] != 0;
        if (picture.Grey(pixel)) touched.insert(BlockOf(pixel));
      }
      EXPECT_EQ(grey, covered);
      whole = touched;
      for (std::size_t pixel = 0; pixel < kPixels; ++pixel)
        if (!picture.Grey(pixel)) whole.erase(BlockOf(pixel));
      EXPECT_LE(touched.size() - whole.size(), 1u) << "one block is cut at most";
    }
}

TEST(CoverBlocks, ChangesNothingInBlocksThatDoNotShowTheTarget) {
  const auto order = OcclusionOrder(kWidth, kHeight, 5);
  const auto target = Target(30, 21, 11, 14);
  std::set<int> shows;
  for (std::size_t pixel = 0; pixel < kPixels; ++pixel)
    if (target[pixel] != 0) shows.insert(BlockOf(pixel));
  Picture picture;
  CoverBlocks(target, kWidth, kHeight, 1, order, picture.rgb);
  for (std::size_t pixel = 0; pixel < kPixels; ++pixel)
    if (picture.Grey(pixel)) {
      EXPECT_TRUE(shows.contains(BlockOf(pixel))) << pixel;
    } else {
      EXPECT_EQ(target[pixel], 0) << pixel << ": all of it is covered";
    }
}

TEST(CoverBlocks, WithoutTargetOrShareNothingHappens) {
  const auto order = OcclusionOrder(kWidth, kHeight, 5);
  const Picture before;
  Picture picture;
  EXPECT_EQ(CoverBlocks(std::vector<std::uint8_t>(kPixels, 0), kWidth, kHeight, 1, order, picture.rgb), 0);
  EXPECT_EQ(CoverBlocks(Target(30, 21, 11, 14), kWidth, kHeight, 0, order, picture.rgb), 0);
  EXPECT_EQ(picture.rgb, before.rgb);
}

TEST(CoverBlocks, MoreIsCoveredInTheSameOrder) {
  const auto target = Target(30, 21, 14, 17);
  const auto order = OcclusionOrder(kWidth, kHeight, 8);
  Picture few, many;
  CoverBlocks(target, kWidth, kHeight, 0.2, order, few.rgb);
  CoverBlocks(target, kWidth, kHeight, 0.68, order, many.rgb);
  for (std::size_t pixel = 0; pixel < kPixels; ++pixel) EXPECT_TRUE(many.Grey(pixel) || !few.Grey(pixel)) << pixel;
}

TEST(OcclusionOrder, IsAllBlocksInAnOrderOfItsSeed) {
  auto order = OcclusionOrder(kWidth, kHeight, 5);
  EXPECT_EQ(order, OcclusionOrder(kWidth, kHeight, 5));
  EXPECT_NE(order, OcclusionOrder(kWidth, kHeight, 6));
  ASSERT_EQ(order.size(), 8u * 6u) << "60 x 44 px, the last ones cut";
  std::ranges::sort(order);
  for (int i = 0; i < static_cast<int>(order.size()); ++i) EXPECT_EQ(order[i], i);
}

// A can that is moved about, half of it hidden in each picture.
class OccluderTest : public testing::Test {
 protected:
  OccluderTest() : pixels_(static_cast<std::size_t>(camera_.width) * camera_.height) {
    plain_.resize(3 * pixels_);
    bodies_.resize(pixels_);
  }

  void PutCan(const Eigen::Vector3d& at) {
    world_.SetObject("coke", {at, Eigen::Quaterniond::Identity()});
    world_.Forward();
    renderer_.Render(world_, plain_);
    renderer_.RenderSegmentation(world_, bodies_);
    covered_ = plain_;
    occluder_.Cover(covered_);
  }
  bool Changed(std::size_t pixel) const {
    return !std::equal(&plain_[3 * pixel], &plain_[3 * pixel] + 3, &covered_[3 * pixel]);
  }
  bool OfCan(std::size_t pixel) const { return bodies_[pixel] == world_.BodyId("coke"); }

  std::shared_ptr<const sim::Scene> scene_ = sim::FullScene();
  const Camera& camera_ = scene_->camera();
  sim::World world_{scene_};
  sim::Renderer renderer_ = std::move(sim::Renderer::Open(scene_).value());
  Occluder occluder_{&world_, &renderer_, "coke", 0.5, 3};
  std::size_t pixels_;
  std::vector<std::uint8_t> plain_, covered_;
  std::vector<std::int32_t> bodies_;
};

TEST_F(OccluderTest, FollowsTheTargetThroughThePictures) {
  EXPECT_FALSE(occluder_.Report().contains("covered")) << "nothing was seen yet";
  for (const Eigen::Vector3d& at : {Eigen::Vector3d(0.35, 0.2, 0.15), {-0.3, 0.3, 0.15}, {0.0, 0.35, 0.15}}) {
    PutCan(at);
    int shown = 0, hidden = 0;
    for (std::size_t pixel = 0; pixel < pixels_; ++pixel) {
      shown += OfCan(pixel);
      hidden += Changed(pixel) && OfCan(pixel);
      if (!Changed(pixel)) continue;
      const Eigen::Vector2d here(static_cast<double>(pixel % camera_.width),
                                 static_cast<double>(pixel / camera_.width));
      EXPECT_LT((here - camera_.Project(at)).norm(), 24) << "near the target only";
    }
    ASSERT_GT(shown, 30);
    EXPECT_NEAR(hidden, 0.5 * shown, 1);
  }
  EXPECT_EQ(occluder_.Report()["pictures"], 3);
  EXPECT_NEAR(occluder_.Report()["covered"].get<double>(), 0.5, 0.02);
  EXPECT_EQ(occluder_.Report()["share"], 0.5);

  PutCan({0, -3, 1});
  EXPECT_EQ(covered_, plain_) << "it is out of sight";
  EXPECT_EQ(occluder_.Report()["pictures"], 3);
}

}  // namespace occluder_test
}  // namespace etude::task
