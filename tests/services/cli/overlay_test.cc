// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/overlay.cc: pixels where a closed form says that they must be, and none elsewhere.
#include "services/cli/overlay.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

namespace etude::cli {
namespace overlay_test {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int kSide = 64;  // px of the camera's picture
constexpr int kScale = 3;
constexpr Color kGround{40, 60, 50};
// of what modules speak of, see overlay.cc
constexpr Color kHand{255, 160, 40}, kTarget{50, 220, 255};

// At the world's origin, looking along -z, with a right angle of view: f = 32 px, (u, v) = (32 + 32 x/d, 32 - 32 y/d).
Camera SquareCamera() {
  Camera camera;
  camera.width = camera.height = kSide;
  camera.fovy = std::numbers::pi / 2;
  return camera;
}

struct Picture {
  std::vector<std::uint8_t> rgb;

  Picture() {
    for (int i = 0; i < kSide * kScale * kSide * kScale; ++i) rgb.insert(rgb.end(), kGround.begin(), kGround.end());
  }
  Color at(int x, int y) const {
    const std::size_t first = 3 * (static_cast<std::size_t>(y) * kSide * kScale + x);
    return {rgb.at(first), rgb.at(first + 1), rgb.at(first + 2)};
  }
  // The pixel over a place of the camera's picture, whose first pixel's corner is (0, 0).
  Color over(const Vector2d& pixel) const {
    return at(static_cast<int>(std::lround(pixel.x() * kScale - 0.5)),
              static_cast<int>(std::lround(pixel.y() * kScale - 0.5)));
  }
  // Pixels that are not as they were, in columns [x0, x1) and rows [y0, y1).
  int Changed(int x0 = 0, int y0 = 0, int x1 = kSide * kScale, int y1 = kSide * kScale) const {
    int changed = 0;
    for (int y = y0; y < y1; ++y)
      for (int x = x0; x < x1; ++x) changed += at(x, y) != kGround ? 1 : 0;
    return changed;
  }
};

Picture Draw(const policy::Insight& insight, const Camera& camera = SquareCamera()) {
  Picture picture;
  DrawOverlay(insight, camera, kScale, picture.rgb);
  return picture;
}

policy::Insight Modules(const char* json) {
  policy::Insight insight;
  insight.modules = OrderedJson::parse(json);
  return insight;
}

policy::Insight Waypoints(const std::vector<Vector3d>& places) {
  policy::Insight insight;
  for (const auto& p : places) insight.waypoints.push_back({{p, Eigen::Quaterniond::Identity()}, 0});
  return insight;
}

// ---- nothing ---------------------------------------------------------------------------------------

TEST(DrawOverlay, NothingIsDrawnWhereNothingIsSaid) {
  EXPECT_EQ(Draw({}).Changed(), 0);
  EXPECT_TRUE(Legend({}).empty());
  // what is said cannot be shown in a picture, or cannot be read
  const policy::Insight odd = Modules(R"({
      "TAR3D": {"entity": "target", "quantity": "position", "value": [0.1, 0.2, -1]},
      "CTRL": {}, "A": 7, "B": [], "C": {"value": null}, "D": {"quantity": "pixel"},
      "E": {"quantity": "pixel", "value": [1]}, "F": {"quantity": "pixel", "value": [10, null]},
      "G": {"quantity": "pixel", "value": ["10", "10"]}, "H": {"quantity": 3, "value": [10, 10]}})");
  EXPECT_EQ(Draw(odd).Changed(), 0);
  EXPECT_TRUE(Legend(odd).empty());
}

// ---- pixels ----------------------------------------------------------------------------------------

TEST(DrawOverlay, APixelIsACrossWithTheModulesName) {
  const auto insight = Modules(R"({"EE2D": {"entity": "ee", "quantity": "pixel", "value": [20.5, 40.5]}})");
  const Picture picture = Draw(insight);
  EXPECT_EQ(picture.over({20.5, 40.5}), kHand);
  // its arms reach 8 px of the large picture from (61, 121), with a dark edge
  for (const auto& [dx, dy] : {std::pair(8, 0), {-8, 0}, {0, 8}, {0, -8}})
    EXPECT_EQ(picture.at(61 + dx, 121 + dy), kHand);
  EXPECT_NE(picture.at(61 - 9, 121), kHand);
  EXPECT_NE(picture.at(61 - 9, 121), kGround);
  EXPECT_EQ(picture.at(61 - 11, 121), kGround);
  EXPECT_EQ(picture.at(61 + 5, 121 + 5), kGround) << "between the arms";
  // the name stands at its right, and nothing anywhere else
  EXPECT_GT(picture.Changed(61 + 11, 121 - 16, 61 + 60, 121 + 2), 20);
  EXPECT_EQ(picture.Changed(0, 0, kSide * kScale, 121 - 20), 0);
  EXPECT_EQ(picture.Changed(0, 121 + 12), 0);
  EXPECT_EQ(picture.Changed(0, 0, 61 - 10), 0);
}

TEST(DrawOverlay, APixelOutsideThePictureIsNotDrawn) {
  for (const char* value : {"[-1, 10]", "[10, 65]", "[1e300, 10]", "[10, -1e300]"})
    EXPECT_EQ(
        Draw(Modules(fmt::format(R"({{"EE2D": {{"entity": "ee", "quantity": "pixel", "value": {}}}}})", value).c_str()))
            .Changed(),
        0)
        << value;
  // at the very corner it is, as far as it lies inside
  const Picture corner = Draw(Modules(R"({"EE2D": {"entity": "ee", "quantity": "pixel", "value": [64, 64]}})"));
  EXPECT_EQ(corner.at(191, 191), kHand);
}

TEST(DrawOverlay, WhatIsSpokenOfHasOneHue) {
  const auto insight = Modules(R"({
      "LANG": {"entity": "target", "quantity": "class", "value": "coke", "probability": 0.971},
      "EE2D": {"entity": "ee", "quantity": "pixel", "value": [10, 40]},
      "TAR2D": {"entity": "target", "quantity": "pixel", "value": [50, 40]},
      "REF2D": {"entity": "reference", "quantity": "pixel", "value": [30, 60]},
      "CUBE2D": {"entity": "object:cube", "quantity": "pixel", "value": [5, 60]},
      "MILK2D": {"entity": "object:milk", "quantity": "pixel", "value": [60, 20]}})");
  const Picture picture = Draw(insight);
  EXPECT_EQ(picture.over({10, 40}), kHand);
  EXPECT_EQ(picture.over({50, 40}), kTarget);
  const auto legend = Legend(insight);
  ASSERT_EQ(legend.size(), 5u) << "a class is a word, not in the picture";
  for (std::size_t i = 0; i < legend.size(); ++i)
    for (std::size_t j = 0; j < i; ++j) EXPECT_NE(legend[i].color, legend[j].color) << i << " " << j;
  EXPECT_EQ(legend[0].text, "EE2D");
  EXPECT_EQ(legend[1].color, kTarget);
}

TEST(DrawOverlay, TheNamedObjectStandsInTheCorner) {
  const Picture picture =
      Draw(Modules(R"({"LANG": {"entity": "target", "quantity": "class", "value": "coke", "probability": 0.971}})"));
  EXPECT_GT(picture.Changed(0, 0, 140, 22), 60);
  EXPECT_EQ(picture.Changed(0, 22), 0);
  const Picture two = Draw(Modules(R"({"LANG": {"entity": "target", "quantity": "class", "value": "coke"},
      "TASK": {"entity": "command", "quantity": "task", "value": "pick"}})"));
  EXPECT_GT(two.Changed(0, 24, 140, 38), 30) << "the next line";
}

// ---- attention -------------------------------------------------------------------------------------

// 2 x 4 patches of 10 x 8 px over a view at (16, 24), all on one of them.
policy::Insight Looking(int patch, double weight) {
  policy::Insight insight = Modules(R"({"TAR2D": {"entity": "target"}})");
  insight.view = {16, 24, 40, 16};
  policy::ModuleAttention attention{2, 4};
  attention.mean.picture.resize(8);
  attention.mean.picture.at(static_cast<std::size_t>(patch)) = weight;
  insight.attention["TAR2D"] = attention;
  return insight;
}

TEST(DrawOverlay, TintsThePatchThatIsAttendedTo) {
  const Picture picture = Draw(Looking(6, 0.9));  // row 1, column 2: u 36..46, v 32..40
  const Color tinted = picture.over({41, 36});
  for (int c = 0; c < 3; ++c) {
    const auto i = static_cast<std::size_t>(c);
    EXPECT_NEAR(tinted[i], 0.45 * kGround[i] + 0.55 * kTarget[i], 1) << c;
  }
  for (const Vector2d& inside : {Vector2d(36.2, 32.2), Vector2d(45.8, 32.2), Vector2d(36.2, 39.2)})
    EXPECT_EQ(picture.over(inside), tinted) << inside.transpose();
  for (const Vector2d& outside : {Vector2d(35.5, 36), Vector2d(46.5, 36), Vector2d(41, 31.5)})
    EXPECT_EQ(picture.over(outside), kGround) << outside.transpose();
  ASSERT_EQ(Legend(Looking(6, 0.9)).size(), 1u);
  EXPECT_EQ(Legend(Looking(6, 0.9))[0].text, "TAR2D");
}

TEST(DrawOverlay, FramesWhatThePolicySees) {
  const Picture picture = Draw(Looking(0, 0.9));
  const auto corner = picture.at(16 * kScale, 24 * kScale + 47), other = picture.at((16 + 40) * kScale - 1, 80);
  EXPECT_NE(corner, kGround);
  EXPECT_EQ(corner, other);
  EXPECT_EQ(picture.at((16 + 40) * kScale, 80), kGround);
  policy::Insight whole;
  whole.view = {0, 0, kSide, kSide};
  EXPECT_EQ(Draw(whole).Changed(), 0) << "nothing to set off";
}

TEST(DrawOverlay, WhoLooksElsewhereIsNotShown) {
  policy::Insight elsewhere = Looking(6, 0.4);  // the rest is on the sentence
  EXPECT_EQ(Draw(elsewhere).over({41, 36}), kGround);
  EXPECT_TRUE(Legend(elsewhere).empty());
  policy::Insight unsaid = Looking(6, 0.9);
  unsaid.view = {};
  EXPECT_EQ(Draw(unsaid).Changed(), 0) << "where the patches lie is not known";
}

TEST(DrawOverlay, AFaintAttentionIsTintedFaintly) {
  policy::Insight insight = Looking(6, 0.8);
  auto& weights = insight.attention["TAR2D"].mean.picture;
  weights[0] = 0.02;   // a tenth of full
  weights[1] = 0.005;  // below what is shown
  const Picture picture = Draw(insight);
  EXPECT_NEAR(picture.over({21, 28})[2], kGround[2] + 0.055 * (kTarget[2] - kGround[2]), 1);
  EXPECT_EQ(picture.over({31, 28}), kGround);
}

// ---- projection ------------------------------------------------------------------------------------

TEST(DrawOverlay, WaypointsLieWhereAPinholeCameraPutsThem) {
  const std::vector<Vector3d> places{{-0.5, 0.25, -1}, {0.5, 0.5, -2}, {0.25, -0.5, -1}};
  const Picture picture = Draw(Waypoints(places));
  // 32 + 32 x/d, 32 - 32 y/d
  for (const Vector2d& pixel : {Vector2d(16, 24), Vector2d(40, 24), Vector2d(40, 48)})
    EXPECT_EQ(picture.over(pixel), kWhite) << pixel.transpose();
  // the lines between them: lighter than the ground, and the ground again 4 px beside
  for (const Vector2d& between : {Vector2d(28, 24), Vector2d(40, 36)}) {
    EXPECT_GT(picture.over(between)[0], 150) << between.transpose();
    EXPECT_EQ(picture.over(between + Vector2d(4, 4)), kGround);
    EXPECT_EQ(picture.over(between - Vector2d(4, 4)), kGround);
  }
  EXPECT_EQ(picture.Changed(0, 0, kSide * kScale, 24 * kScale - 6), 0);
  EXPECT_EQ(picture.Changed(0, 48 * kScale + 6), 0);
}

TEST(DrawOverlay, WaypointsFollowACameraThatIsElsewhere) {
  // turned by half a circle about the vertical and moved: what lay at the right now lies at the left
  Camera camera = SquareCamera();
  camera.X_WC = {{1, 2, 3}, Eigen::Quaterniond(Eigen::AngleAxisd(std::numbers::pi, Vector3d::UnitY()))};
  // in the camera: (0.5, 0, -1)
  const Picture picture = Draw(Waypoints({Vector3d(1 - 0.5, 2, 3 + 1)}), camera);
  EXPECT_EQ(picture.over({48, 32}), kWhite);
  EXPECT_EQ(picture.Changed(0, 0, 47 * kScale - 3), 0);
}

TEST(DrawOverlay, WhatLiesBehindTheCameraIsNotDrawn) {
  EXPECT_EQ(Draw(Waypoints({{0, 0, 1}, {0.2, 0, 2}, {0, 0.3, 0.5}})).Changed(), 0);
  EXPECT_EQ(Draw(Waypoints({{5, 0, -1}, {7, 0, -1}})).Changed(), 0) << "outside";
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(Draw(Waypoints({{nan, 0, -1}, {0, nan, -2}})).Changed(), 0);
  // from before the camera to behind it, below: the line leaves the picture downwards and never comes in from above
  const Picture picture = Draw(Waypoints({{0, -0.25, -1}, {0, -0.25, 1}}));
  EXPECT_EQ(picture.over({32, 40}), kWhite);
  EXPECT_GT(picture.over({32, 60})[0], 150);
  EXPECT_EQ(picture.Changed(0, 0, kSide * kScale, 40 * kScale - 6), 0);
}

TEST(DrawOverlay, ADisplacementBeginsWhereThePolicySaysTheHandIs) {
  const char* said = R"({
      "EE3D": {"entity": "ee", "quantity": "position", "value": [-0.5, 0, -1]},
      "DISP": {"entity": "target", "quantity": "displacement", "value": [0.75, -0.5, 0]}})";
  const Picture picture = Draw(Modules(said));  // (16, 32) to (40, 48)
  for (const double part : {0.1, 0.5, 0.9}) {
    const Color on = picture.over(Vector2d(16, 32) + part * Vector2d(24, 16));
    for (std::size_t i = 0; i < 3; ++i) EXPECT_NEAR(on[i], kTarget[i], 60) << part << " " << i;
  }
  EXPECT_EQ(picture.over({20, 44}), kGround);
  EXPECT_EQ(Legend(Modules(said)).size(), 1u);
  // without the hand nobody knows where it begins
  EXPECT_EQ(Draw(Modules(R"({"DISP": {"entity": "target", "quantity": "displacement", "value": [0.75, -0.5, 0]}})"))
                .Changed(),
            0);
}

TEST(VisiblePart, IsTheSegmentItselfInsideThePicture) {
  const auto seen = VisiblePart(SquareCamera(), {-0.5, 0.25, -1}, {0.5, 0.5, -2});
  ASSERT_TRUE(seen);
  EXPECT_TRUE((*seen)[0].isApprox(Vector2d(16, 24), 1e-12)) << (*seen)[0].transpose();
  EXPECT_TRUE((*seen)[1].isApprox(Vector2d(40, 24), 1e-12)) << (*seen)[1].transpose();
}

TEST(VisiblePart, EndsAtThePicturesEdge) {
  // at depth 1 from (32, 32) towards (96, 0): it meets u = 64 half-way, at v = 16
  const auto right = VisiblePart(SquareCamera(), {0, 0, -1}, {2, 1, -1});
  ASSERT_TRUE(right);
  EXPECT_TRUE((*right)[0].isApprox(Vector2d(32, 32), 1e-12));
  EXPECT_TRUE((*right)[1].isApprox(Vector2d(64, 16), 1e-12)) << (*right)[1].transpose();
  // both ends outside, across the picture
  const auto across = VisiblePart(SquareCamera(), {-4, 0.5, -1}, {4, 0.5, -1});
  ASSERT_TRUE(across);
  EXPECT_TRUE((*across)[0].isApprox(Vector2d(0, 16), 1e-12)) << (*across)[0].transpose();
  EXPECT_TRUE((*across)[1].isApprox(Vector2d(64, 16), 1e-12)) << (*across)[1].transpose();
  // past a corner
  EXPECT_FALSE(VisiblePart(SquareCamera(), {0.9, 2, -1}, {2, 0.9, -1}));
  EXPECT_FALSE(VisiblePart(SquareCamera(), {3, 0, -1}, {3, 0, -1}));
}

TEST(VisiblePart, IsCutWhereItPassesTheCamera) {
  // straight over the camera's head: along v = 32 - 32 * 0.25/d, d from 1 down to 0
  const auto seen = VisiblePart(SquareCamera(), {0, 0.25, -1}, {0, 0.25, 3});
  ASSERT_TRUE(seen);
  EXPECT_TRUE((*seen)[0].isApprox(Vector2d(32, 24), 1e-12));
  EXPECT_NEAR((*seen)[1].x(), 32, 1e-9);
  EXPECT_NEAR((*seen)[1].y(), 0, 1e-9) << "the upper edge, not a point behind mirrored to below";
  // the same the other way round
  const auto back = VisiblePart(SquareCamera(), {0, 0.25, 3}, {0, 0.25, -1});
  ASSERT_TRUE(back);
  EXPECT_TRUE((*back)[0].isApprox((*seen)[1], 1e-9));
  EXPECT_TRUE((*back)[1].isApprox((*seen)[0], 1e-9));
  EXPECT_FALSE(VisiblePart(SquareCamera(), {0, 0, 0}, {0, 0, 1}));
}

// Against many points of the segment, each projected by itself.
TEST(VisiblePart, HoldsEveryVisiblePointOfTheSegmentAndNoOther) {
  const Camera camera = SquareCamera();
  std::uint32_t state = 7;
  const auto draw = [&] {
    state = state * 1664525u + 1013904223u;
    return 4.0 * (state >> 8) / double(1 << 24) - 2;
  };
  int visible = 0;
  for (int i = 0; i < 400; ++i) {
    const Vector3d a(draw(), draw(), draw()), b(draw(), draw(), draw());
    const auto seen = VisiblePart(camera, a, b);
    for (int k = 0; k <= 50; ++k) {
      const Vector3d p = a + (b - a) * (k / 50.0);
      const Vector2d pixel = camera.Project(p);
      const bool inside = -p.z() > 0.011 && pixel.x() > 0.01 && pixel.y() > 0.01 && pixel.x() < kSide - 0.01 &&
                          pixel.y() < kSide - 0.01;
      if (!inside) continue;
      ++visible;
      ASSERT_TRUE(seen) << i;
      const Vector2d way = (*seen)[1] - (*seen)[0], from = pixel - (*seen)[0];
      EXPECT_NEAR(way.x() * from.y() - way.y() * from.x(), 0, 1e-6 * (1 + way.norm())) << "on the line";
      EXPECT_GE(from.dot(way), -1e-6);
      EXPECT_LE(from.dot(way), way.squaredNorm() + 1e-6);
    }
    if (!seen) continue;
    for (const auto& end : *seen) {
      EXPECT_GE(end.minCoeff(), -1e-9);
      EXPECT_LE(end.maxCoeff(), kSide + 1e-9);
    }
  }
  EXPECT_GT(visible, 500);
}

}  // namespace overlay_test
}  // namespace etude::cli
