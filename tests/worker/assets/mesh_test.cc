// SPDX-License-Identifier: Apache-2.0
// Tests worker/assets/mesh.cc and geom_writer.cc against closed forms
#include "worker/assets/mesh.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <sstream>

#include "services/core/rng.h"
#include "worker/assets/geom_writer.h"

namespace etude::assets {
namespace mesh_test {

using Eigen::Vector2d;
using Eigen::Vector3d;

struct Measures {
  double volume = 0, area = 0;
};

Measures Measure(const Mesh& mesh) {
  Measures sum;
  for (const auto& f : mesh.faces) {
    const Vector3d &a = mesh.positions[f[0]], &b = mesh.positions[f[1]], &c = mesh.positions[f[2]];
    sum.volume += a.dot(b.cross(c)) / 6;
    sum.area += (b - a).cross(c - a).norm() / 2;
  }
  return sum;
}

TEST(Lathe, OfAnyProfileIsAStackOfPyramidStumps) {
  Rng rng(1);
  for (int round = 0; round < 50; ++round) {
    std::vector<ProfilePoint> profile{{0, 0, 1}};
    for (double z = 0; profile.size() < 8; z += rng.Uniform(0.01, 0.2)) profile.push_back({rng.Uniform(0.1, 1), z, 0});
    profile.push_back({0, profile.back().z, 0});
    const int segments = 3 + static_cast<int>(rng.Below(30));

    // a regular polygon with corners at radius r has the area r^2 n / 2 sin(2 pi / n)
    const double disc = segments / 2.0 * std::sin(2 * std::numbers::pi / segments);
    double volume = 0;
    for (std::size_t i = 1; i < profile.size(); ++i) {
      const double a = profile[i - 1].radius, b = profile[i].radius;
      volume += disc * (profile[i].z - profile[i - 1].z) * (a * a + a * b + b * b) / 3;
    }
    EXPECT_NEAR(Measure(Lathe(profile, segments)).volume, volume, 1e-9);
  }
}

TEST(Lathe, OfAConeHasItsArea) {
  const double r = 0.3, h = 0.4;  // slant 0.5
  const Mesh cone = Lathe({{0, 0, 1}, {r, 0, 1}, {0, h, 0}}, 2000);
  EXPECT_NEAR(Measure(cone).area, std::numbers::pi * r * (r + 0.5), 1e-5);
}

TEST(Lathe, TheTextureGoesOnceAroundCounterClockwiseFromX) {
  const Mesh mesh = Lathe({{1, 0, 1}, {1, 2, 0}}, 12);
  for (std::size_t i = 0; i < mesh.positions.size(); ++i) {
    const Vector3d& p = mesh.positions[i];
    const double angle = 2 * std::numbers::pi * mesh.uv[i].x();
    EXPECT_LT((p.head<2>() - Vector2d(std::cos(angle), std::sin(angle))).norm(), 1e-12);
    EXPECT_NEAR(mesh.uv[i].y(), 1 - p.z() / 2, 1e-12);
    EXPECT_LT((mesh.normals[i] - Vector3d(p.x(), p.y(), 0)).norm(), 1e-12) << "outwards";
  }
}

// The normals that a bend of a lathe by this angle has beside each other.
double NormalsApart(double bend_deg) {
  const double bend = bend_deg * std::numbers::pi / 180;
  const Mesh mesh = Lathe({{1, 0, 0}, {1, 1, 0}, {1 + std::sin(bend), 1 + std::cos(bend), 0}}, 8);
  double apart = 0;
  for (std::size_t i = 0; i < mesh.positions.size(); ++i)
    for (std::size_t j = 0; j < i; ++j)
      if ((mesh.positions[i] - mesh.positions[j]).norm() < 1e-12)
        apart = std::max(apart, std::acos(std::clamp(mesh.normals[i].dot(mesh.normals[j]), -1.0, 1.0)));
  return apart * 180 / std::numbers::pi;
}

TEST(Lathe, CornersSharperThan40DegreesStaySharp) {
  EXPECT_NEAR(NormalsApart(39), 0, 1e-5);
  EXPECT_NEAR(NormalsApart(41), 41, 1e-5);
  EXPECT_NEAR(NormalsApart(90), 90, 1e-5);
}

/// Corners of a convex polygon on an ellipse, counter-clockwise.
std::vector<Vector2d> RandomPolygon(Rng& rng) {
  std::vector<double> angles(3 + rng.Below(8));
  for (double& angle : angles) angle = rng.Uniform(0, 2 * std::numbers::pi);
  std::sort(angles.begin(), angles.end());
  std::vector<Vector2d> polygon;
  for (const double angle : angles) polygon.emplace_back(2 + 0.5 * std::cos(angle), 0.2 * std::sin(angle) - 1);
  return polygon;
}

TEST(Extrude, HasTheVolumeAndAreaOfAPrism) {
  Rng rng(2);
  for (int round = 0; round < 50; ++round) {
    const std::vector<Vector2d> polygon = RandomPolygon(rng);
    double area = 0, length = 0;
    for (std::size_t i = 0; i < polygon.size(); ++i) {
      const Vector2d &p = polygon[i], &q = polygon[(i + 1) % polygon.size()];
      area += (p.x() * q.y() - p.y() * q.x()) / 2;
      length += (q - p).norm();
    }
    for (const bool smooth : {false, true}) {
      const Mesh mesh = Extrude(polygon, 0.3, smooth);
      EXPECT_NEAR(Measure(mesh).volume, 0.6 * area, 1e-12);
      EXPECT_NEAR(Measure(mesh).area, 0.6 * length + 2 * area, 1e-12);
      for (const Vector2d& uv : mesh.uv) EXPECT_TRUE(uv.minCoeff() >= -1e-12 && uv.maxCoeff() <= 1 + 1e-12);
    }
  }
}

TEST(Extrude, SmoothSidesShareTheirNormals) {
  std::vector<Vector2d> polygon;
  for (int i = 0; i < 12; ++i)
    polygon.emplace_back(std::cos(i * std::numbers::pi / 6), std::sin(i * std::numbers::pi / 6));
  for (const bool smooth : {false, true}) {
    const Mesh mesh = Extrude(polygon, 1, smooth);
    double worst = 0;  // how far a side's normal is from that of the cylinder through the corners
    for (std::size_t i = 0; i < mesh.positions.size(); ++i) {
      const Vector3d& p = mesh.positions[i];
      if (std::abs(mesh.normals[i].y()) < 0.5)
        worst = std::max(worst, (mesh.normals[i] - Vector3d(p.x(), 0, p.z())).norm());
    }
    EXPECT_NEAR(worst, smooth ? 0 : 2 * std::sin(std::numbers::pi / 24), 1e-9);
  }
}

TEST(Mesh, AppendedPartsKeepTheirFaces) {
  Mesh mesh = Extrude({{0, 0}, {1, 0}, {0, 1}}, 0.5, false);
  const std::size_t faces = mesh.faces.size(), corners = mesh.positions.size();
  Mesh other = mesh;
  for (Vector3d& p : other.positions) p += Vector3d(5, 0, 0);
  mesh.Append(other);
  EXPECT_EQ(mesh.faces.size(), 2 * faces);
  EXPECT_EQ(mesh.uv.size(), 2 * corners);
  EXPECT_NEAR(Measure(mesh).volume, 1, 1e-12) << "two halves of a cube";
  EXPECT_EQ(mesh.faces[faces][0], mesh.faces[0][0] + static_cast<int>(corners));
}

TEST(GeomWriter, NumbersReadBackTheSame) {
  Rng rng(3);
  for (int round = 0; round < 200; ++round) {
    std::vector<double> values(1 + rng.Below(5));
    for (double& value : values) value = rng.Normal() * std::pow(10, rng.Uniform(-12, 12));
    std::istringstream text(Numbers(values));
    for (const double value : values) {
      std::string word;
      text >> word;
      ASSERT_EQ(std::stod(word), value);
    }
  }
  EXPECT_EQ(Numbers(Vector3d(1, 0.5, -2)), "1 0.5 -2");
}

TEST(GeomWriter, LeavesOutWhatIsTheIdentity) {
  EXPECT_EQ(PoseAttributes({}), "");
  EXPECT_EQ(PoseAttributes({{0, 0, 0.5}, Eigen::Quaterniond::Identity()}), " pos=\"0 0 0.5\"");
  EXPECT_EQ(PoseAttributes({{0, 0, 0}, Eigen::Quaterniond(0, 1, 0, 0)}), " quat=\"0 1 0 0\"") << "w comes first";
  EXPECT_EQ(Geom("object", "sphere", {0.1}, {}, "mass=\"1\""),
            "<geom class=\"object\" type=\"sphere\" size=\"0.1\" mass=\"1\"/>\n");
  EXPECT_EQ(Geom("visual", "mesh", {}, {}), "<geom class=\"visual\" type=\"mesh\"/>\n");
}

}  // namespace mesh_test
}  // namespace etude::assets
