// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <numbers>

#include "worker/assets/object_parts.h"

namespace etude::assets {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int kAround = 28;      ///< segments of round visuals
constexpr int kHullAround = 16;  ///< of convex collision pieces

std::vector<ProfilePoint> Lowered(std::vector<ProfilePoint> profile, double rest_height) {
  for (ProfilePoint& point : profile) point.z -= rest_height;
  return profile;
}

/// An axis-aligned quad's uv with u to the right and the given rows.
std::vector<Vector2d> Rows(double top, double bottom) { return {{0, bottom}, {1, bottom}, {1, top}, {0, top}}; }

}  // namespace

Mesh BallMesh() {
  constexpr int kRows = 16;
  std::vector<ProfilePoint> profile;
  for (int i = 0; i <= kRows; ++i) {
    const double angle = std::numbers::pi * i / kRows;  // from the lower pole
    profile.push_back({i % kRows == 0 ? 0 : kBallRadius * std::sin(angle), -kBallRadius * std::cos(angle),
                       1 - static_cast<double>(i) / kRows});
  }
  return Lathe(profile, kAround);
}

Mesh CanMesh(double rest_height) {
  // rows: lid 0 .. .08, label .10 .. .94, base .96 .. 1 (see the can textures)
  const double r = kCanRadius, h = kCanHeight;
  return Lathe(Lowered({{0, .002, 1},
                        {r * .78, .002, .99},
                        {r * .84, 0, .98},
                        {r, .006, .94},
                        {r, h - .006, .11},
                        {r * .90, h - .0005, .08},
                        {r * .86, h, .06},
                        {r * .82, h - .002, .04},
                        {0, h - .002, 0}},
                       rest_height),
               kAround);
}

Mesh MilkMesh(double rest_height) {
  const double w = kMilkHalf, low = -rest_height, side = kMilkShoulder + low, ridge = kMilkRidge + low,
               top = kMilkHeight + low, f = kMilkFin;
  Mesh mesh;
  const auto wall = [&](double ax, double ay, double bx, double by, double z0, double z1, double row1, double row0) {
    mesh.AddPolygon({{ax, ay, z0}, {bx, by, z0}, {bx, by, z1}, {ax, ay, z1}}, Rows(row1, row0));
  };
  wall(w, -w, w, w, low, side, .2, 1);
  wall(w, w, -w, w, low, side, .2, 1);
  wall(-w, w, -w, -w, low, side, .2, 1);
  wall(-w, -w, w, -w, low, side, .2, 1);
  mesh.AddPolygon({{-w, w, low}, {w, w, low}, {w, -w, low}, {-w, -w, low}}, Rows(.02, .03));
  // the roof: two slopes that meet in a fin along x, and the two folded-in gables
  mesh.AddPolygon({{-w, -w, side}, {w, -w, side}, {w, -f, ridge}, {-w, -f, ridge}}, Rows(.08, .2));
  mesh.AddPolygon({{w, w, side}, {-w, w, side}, {-w, f, ridge}, {w, f, ridge}}, Rows(.08, .2));
  mesh.AddPolygon({{w, -w, side}, {w, w, side}, {w, f, ridge}, {w, -f, ridge}}, Rows(.02, .06));
  mesh.AddPolygon({{-w, w, side}, {-w, -w, side}, {-w, -f, ridge}, {-w, f, ridge}}, Rows(.02, .06));
  wall(w, -f, w, f, ridge, top, .0, .08);
  wall(w, f, -w, f, ridge, top, .0, .08);
  wall(-w, f, -w, -f, ridge, top, .0, .08);
  wall(-w, -f, w, -f, ridge, top, .0, .08);
  mesh.AddPolygon({{-w, -f, top}, {w, -f, top}, {w, f, top}, {-w, f, top}}, Rows(.02, .03));
  return mesh;
}

Mesh MilkGableHull(double rest_height) {
  const double w = kMilkHalf, side = kMilkShoulder - rest_height, ridge = kMilkRidge - rest_height;
  Mesh mesh = Extrude({{-w, side}, {w, side}, {kMilkFin, ridge}, {-kMilkFin, ridge}}, w, false);
  for (auto* list : {&mesh.positions, &mesh.normals})  // the ridge runs along x: turn by 90 degrees
    for (Vector3d& v : *list) v = {-v.y(), v.x(), v.z()};
  return mesh;
}

Mesh BreadMesh(double rest_height) {
  constexpr int kTop = 10;
  const double low = -rest_height, side = kBreadSide + low, rise = kBreadHeight - kBreadSide;
  const double bevel = 0.004;
  std::vector<Vector2d> outline{{-kBreadHalfX + bevel, low}, {kBreadHalfX - bevel, low}, {kBreadHalfX, low + bevel}};
  for (int i = 0; i <= kTop; ++i) {
    const double angle = std::numbers::pi * i / kTop;
    // a flattened arch (superellipse): a loaf's crust, not a barrel
    const double c = std::cos(angle), s = std::sin(angle);
    outline.emplace_back(std::copysign(std::pow(std::abs(c), 0.8), c) * kBreadHalfX, side + std::pow(s, 0.8) * rise);
  }
  outline.emplace_back(-kBreadHalfX, low + bevel);
  return Extrude(outline, kBreadHalfY, true);
}

Mesh BottleMesh(double rest_height) {
  const double r = kBottleRadius, n = kBottleNeckRadius;
  return Lathe(Lowered({{0, .003, 1},
                        {r * .70, .001, 1},
                        {r * .86, 0, 1},
                        {r, .005, .95},
                        {r, kBottleShoulder - .004, .4},
                        {r * .96, kBottleShoulder + .004, .4},
                        {r * .82, kBottleShoulder + .013, .4},
                        {r * .60, kBottleShoulder + .022, .3},
                        {n, kBottleNeck + .002, .2},
                        {n, kBottleHeight - .012, 0},
                        {0, kBottleHeight - .012, 0}},
                       rest_height),
               kAround);
}

Mesh BottleLabelMesh(double rest_height) {
  const double r = kBottleRadius + 0.0003;
  return Lathe(Lowered({{kBottleRadius - .001, .032, 1}, {r, .033, 1}, {r, .062, 0}, {kBottleRadius - .001, .063, 0}},
                       rest_height),
               kAround);
}

Mesh BottleCapMesh(double rest_height) {
  const double r = kBottleNeckRadius + .0008, h = kBottleHeight;
  return Lathe(
      Lowered({{0, h - .013, 1}, {r, h - .013, 1}, {r, h - .0015, 0}, {r - .0015, h, 0}, {0, h, 0}}, rest_height),
      kHullAround);
}

Mesh BottleShoulderHull(double rest_height) {
  const double r = kBottleRadius, s = kBottleShoulder;
  return Lathe(Lowered({{0, s, 1},
                        {r, s, 1},
                        {r * .93, s + .008, 1},
                        {r * .72, s + .018, 1},
                        {kBottleNeckRadius, kBottleNeck + .001, 0},
                        {0, kBottleNeck + .001, 0}},
                       rest_height),
               kHullAround);
}

}  // namespace etude::assets
