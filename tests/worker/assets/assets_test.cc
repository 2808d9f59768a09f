// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstring>
#include <map>
#include <numbers>

#include "worker/assets/object_parts.h"
#include "worker/assets/scene_description.h"

namespace etude::assets {
namespace assets_test {

using Eigen::Vector3d;

struct NamedMesh {
  const char* name;
  Mesh mesh;
  double volume;  ///< m^3, of the ideal shape; 0: only closedness is checked
  double tolerance;
};

std::vector<NamedMesh> AllMeshes() {
  const double can = std::numbers::pi * kCanRadius * kCanRadius * kCanHeight;
  const double box = 4 * kMilkHalf * kMilkHalf * kMilkShoulder;
  const double roof = 2 * kMilkHalf * (kMilkRidge - kMilkShoulder) * (kMilkHalf + kMilkFin);
  const double fin = 4 * kMilkHalf * kMilkFin * (kMilkHeight - kMilkRidge);
  return {{"can", CanMesh(0.04), can, 0.07},
          {"milk", MilkMesh(0.061), box + roof + fin, 1e-6},
          {"milk_gable", MilkGableHull(0.061), roof, 1e-6},
          {"bread", BreadMesh(0.0363), 0, 0},
          {"bottle", BottleMesh(0.0649), 0, 0},
          {"bottle_cap", BottleCapMesh(0.0649), 0, 0},
          {"bottle_shoulder", BottleShoulderHull(0.0649), 0, 0}};
}

double SignedVolume(const Mesh& mesh) {
  double volume = 0;
  for (const auto& f : mesh.faces)
    volume += mesh.positions[f[0]].dot(mesh.positions[f[1]].cross(mesh.positions[f[2]])) / 6;
  return volume;
}

TEST(Mesh, IsClosedAndFacesOutwards) {
  for (const auto& [name, mesh, volume, tolerance] : AllMeshes()) {
    // the sum of area vectors over a closed surface is zero
    Vector3d sum = Vector3d::Zero();
    double area = 0;
    for (const auto& f : mesh.faces) {
      const Vector3d a =
          (mesh.positions[f[1]] - mesh.positions[f[0]]).cross(mesh.positions[f[2]] - mesh.positions[f[0]]) / 2;
      sum += a;
      area += a.norm();
    }
    EXPECT_LT(sum.norm(), 1e-9 * area + 1e-12) << name;
    EXPECT_GT(SignedVolume(mesh), 0) << name;
    if (volume > 0) {
      EXPECT_NEAR(SignedVolume(mesh) / volume, 1, tolerance) << name;
    }
  }
}

TEST(Mesh, NormalsAgreeWithFaces) {
  for (const auto& [name, mesh, volume, tolerance] : AllMeshes())
    for (const auto& f : mesh.faces) {
      const Vector3d normal =
          (mesh.positions[f[1]] - mesh.positions[f[0]]).cross(mesh.positions[f[2]] - mesh.positions[f[0]]).normalized();
      for (const int i : f) {
        EXPECT_NEAR(mesh.normals[i].norm(), 1, 1e-9) << name;
        EXPECT_GT(mesh.normals[i].dot(normal), 0.7) << name << " vertex " << i;
      }
    }
}

TEST(Mesh, MshHasCountsThenNumbers) {
  const Mesh mesh = MilkGableHull(0.061);
  const auto bytes = ToMsh(mesh);
  std::int32_t counts[4];
  ASSERT_GE(bytes.size(), sizeof counts);
  std::memcpy(counts, bytes.data(), sizeof counts);
  const auto n = static_cast<std::int32_t>(mesh.positions.size());
  EXPECT_THAT(counts, testing::ElementsAre(n, n, n, static_cast<std::int32_t>(mesh.faces.size())));
  EXPECT_EQ(bytes.size(), 16 + n * 32 + mesh.faces.size() * 12);
  float x;
  std::memcpy(&x, bytes.data() + 16, 4);
  EXPECT_EQ(x, static_cast<float>(mesh.positions[0].x()));
}

TEST(Objects, StandOnTheirLowestPointWithinTheirBox) {
  const std::map<std::string, Mesh> meshes{
      {"coke", CanMesh(0.04)}, {"milk", MilkMesh(0.061)}, {"bread", BreadMesh(0.0363)}};
  for (const auto& [name, mesh] : meshes) {
    const auto object = MakeObject(name);
    ASSERT_TRUE(object) << object.error().message;
    Vector3d low = mesh.positions[0], high = low;
    for (const Vector3d& p : mesh.positions) {
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    }
    EXPECT_NEAR(low.z(), -object->rest_height, 1e-9) << name;
    EXPECT_LT(((high - low) / 2 - object->half_extent).cwiseAbs().maxCoeff(), 1e-4) << name;
  }
}

TEST(Objects, UnknownNameSaysTheNearest) {
  const auto object = MakeObject("cokee");
  ASSERT_FALSE(object);
  EXPECT_EQ(object.error().code, Code::kInvalidArgument);
  EXPECT_THAT(object.error().message, testing::HasSubstr("did you mean 'coke'"));
}

Color MeanColor(Canvas canvas) {
  Color sum = Color::Zero();
  for (int y = 0; y < canvas.height(); ++y)
    for (int x = 0; x < canvas.width(); ++x) sum += canvas.at(x, y);
  return sum / (canvas.width() * canvas.height());
}

TEST(Textures, AreTheColourOfTheirThing) {
  const Color coke = MeanColor(CokeTexture()), pepsi = MeanColor(PepsiTexture()), milk = MeanColor(MilkTexture()),
              bread = MeanColor(BreadTexture());
  EXPECT_GT(coke[0], 1.5 * coke[1]);
  EXPECT_GT(coke[0], 1.5 * coke[2]);
  EXPECT_GT(pepsi[2], 1.3 * pepsi[0]);
  EXPECT_GT(milk.minCoeff(), 0.5);
  EXPECT_GT(bread[0], bread[1]);
  EXPECT_GT(bread[1], bread[2]);
}

TEST(Canvas, PaintsCoverage) {
  Canvas canvas(4, 4, Color::Zero());
  canvas.Paint(Rectangle({1, 1}, {3, 4}), Color::Ones());
  EXPECT_EQ(canvas.at(0, 0), Color::Zero());
  EXPECT_EQ(canvas.at(1, 2), Color::Ones());
  const auto bytes = canvas.ToTexture();
  ASSERT_EQ(bytes.size(), 8u + 48u);
  EXPECT_EQ(bytes[8 + 3 * (4 * 2 + 1)], 255);
}

TEST(SceneDescription, IsAPureFunctionOfTheSpec) {
  SceneSpec spec;
  const auto a = DescribeScene(spec, {}), b = DescribeScene(spec, {});
  ASSERT_TRUE(a && b);
  EXPECT_EQ(a->mjcf, b->mjcf);
  EXPECT_EQ(a->sha256, b->sha256);
  EXPECT_EQ(a->sha256.size(), 64u);
  spec.objects = {"coke", "pepsi"};
  const auto two = DescribeScene(spec, {});
  EXPECT_NE(two->sha256, a->sha256);
  EXPECT_EQ(two->objects.size(), 2u);
  int cans = 0;
  for (const auto& file : two->files) cans += file.name == "can.msh";
  EXPECT_EQ(cans, 1) << "both cans share one mesh";
}

TEST(SceneDescription, RefusesWhatItDoesNotKnow) {
  SceneSpec spec;
  spec.objects = {"coke", "coke"};
  EXPECT_THAT(DescribeScene(spec, {}).error().message, testing::HasSubstr("twice"));
  spec.objects = {"coke"};
  spec.camera.position = {1, 2};
  EXPECT_THAT(DescribeScene(spec, {}).error().message, testing::HasSubstr("camera"));
}

}  // namespace assets_test
}  // namespace etude::assets
