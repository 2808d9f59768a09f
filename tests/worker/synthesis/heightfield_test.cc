// SPDX-License-Identifier: Apache-2.0
// Tests worker/synthesis/heightfield.cc
#include "worker/synthesis/heightfield.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

#include "services/core/rng.h"
#include "tests/support/matchers.h"
#include "worker/synthesis/mass.h"

namespace etude::synthesis {
namespace heightfield_test {

/// A picture of a height field over x right, y up, both in -1..1; the object is where it is positive.
Picture PictureOf(const std::function<double(double, double)>& height, int size = 120) {
  Picture picture{.width = size, .height = size};
  picture.relief = 0.5;
  for (int i = 0; i < size * size; ++i) {
    const double h = height(2 * (i % size + 0.5) / size - 1, 1 - 2 * (i / size + 0.5) / size);
    picture.depth.push_back(static_cast<float>(std::max(h, 0.0)));
    picture.mask.push_back(h > 0);
    picture.rgb.insert(picture.rgb.end(), 3, 128);
  }
  return picture;
}

double Ball(double x, double y) { return std::sqrt(std::max(0.0, 0.64 - x * x - y * y)); }
double Ring(double x, double y) {
  const double off = std::hypot(x, y) - 0.55;
  return std::sqrt(std::max(0.0, 0.09 - off * off));
}

void ExpectSound(const assets::Mesh& mesh) {
  EXPECT_TRUE(IsWatertight(mesh));
  EXPECT_EQ(CountParts(mesh), 1);
  EXPECT_GT(Integrate(mesh).mass, 0);
  EXPECT_GT(SmallestFace(mesh), 1e-7);  // of a picture as wide as 1
  EXPECT_LE(mesh.faces.size(), 5000u);
  EXPECT_EQ(mesh.uv.size(), mesh.positions.size());
  EXPECT_EQ(mesh.normals.size(), mesh.positions.size());
}

int EulerCharacteristic(const assets::Mesh& mesh) {
  return static_cast<int>(mesh.positions.size()) - static_cast<int>(mesh.faces.size()) / 2;
}

TEST(Relief, OfAHemisphereIsABall) {
  const auto body = RaiseHeightfield(PictureOf(Ball), {.max_faces = 5000});
  ASSERT_TRUE(body.has_value()) << body.error().message;

  ExpectSound(body->mesh);
  EXPECT_FALSE(body->hole.has_value());
  EXPECT_EQ(EulerCharacteristic(body->mesh), 2);
  EXPECT_GT(body->mesh.faces.size(), 3500u);
  const MassProperties mass = Integrate(body->mesh);
  const double volume = 4 * std::numbers::pi / 3 * 0.4 * 0.4 * 0.4;
  EXPECT_NEAR(mass.mass, volume, 0.06 * volume);
  EXPECT_LT(mass.centre.norm(), 0.005);
}

TEST(Relief, OfARingKeepsItsHole) {
  const auto body = RaiseHeightfield(PictureOf(Ring));
  ASSERT_TRUE(body.has_value());

  ExpectSound(body->mesh);
  EXPECT_EQ(EulerCharacteristic(body->mesh), 0);
  ASSERT_TRUE(body->hole.has_value());
  EXPECT_LT(body->hole->centre.norm(), 0.01);
}

TEST(Relief, IsSoundForRaggedPictures) {
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    Rng rng(seed);
    Picture picture = PictureOf(Ball);
    for (auto& mask : picture.mask) mask = mask && rng.Bernoulli(0.8);
    for (auto& depth : picture.depth) depth *= static_cast<float>(rng.Uniform());
    const auto body = RaiseHeightfield(picture);
    ASSERT_TRUE(body.has_value());
    ExpectSound(body->mesh);
  }
}

TEST(Relief, KeepsTheLargestPart) {
  const auto body = RaiseHeightfield(PictureOf(
      [](double x, double y) { return std::max(0.5 - std::hypot(x + 0.4, y), 0.2 - std::hypot(x - 0.6, y)); }));
  ASSERT_TRUE(body.has_value());

  ExpectSound(body->mesh);
  for (const auto& p : body->mesh.positions) EXPECT_LT(p.x(), 0.1);
}

TEST(Relief, TextureCoordinatesAreThePlaceInThePicture) {
  HeightfieldOptions raw;
  raw.rounds = 0;
  const auto body = RaiseHeightfield(PictureOf(Ball), raw);
  ASSERT_TRUE(body.has_value());
  for (std::size_t i = 0; i < body->mesh.uv.size(); ++i) {
    EXPECT_NEAR(body->mesh.uv[i].x(), body->mesh.positions[i].x() + 0.5, 1e-3);
    EXPECT_NEAR(body->mesh.uv[i].y(), 0.5 - body->mesh.positions[i].y(), 1e-3);
  }
}

TEST(Smooth, KeepsVolumeAndTakesAwayNoise) {
  HeightfieldOptions raw;
  raw.rounds = 0;
  Rng rng(3);
  auto body = RaiseHeightfield(
      PictureOf([&](double x, double y) { return Ball(x, y) > 0 ? Ball(x, y) * rng.Uniform(0.9, 1.1) : 0; }), raw);
  ASSERT_TRUE(body.has_value());
  const auto roughness = [](const assets::Mesh& mesh) {
    double sum = 0;
    for (const auto& f : mesh.faces) sum += 1 - mesh.normals[f[0]].dot(mesh.normals[f[1]]);
    return sum;
  };
  const double volume = Integrate(body->mesh).mass;
  const double before = roughness(body->mesh);

  Smooth(body->mesh, 0.5, 5);
  EXPECT_NEAR(Integrate(body->mesh).mass, volume, 1e-9);
  EXPECT_LT(roughness(body->mesh), 0.5 * before);
  EXPECT_TRUE(IsWatertight(body->mesh));
}

TEST(Relief, RefusesAnEmptyOrInconsistentPicture) {
  EXPECT_EQ(RaiseHeightfield(PictureOf([](double, double) { return 0.0; })).error().code, Code::kInvalidArgument);
  Picture torn = PictureOf(Ball);
  torn.depth.pop_back();
  EXPECT_EQ(RaiseHeightfield(torn).error().code, Code::kInvalidArgument);
  HeightfieldOptions options;
  options.cut = 2;
  EXPECT_EQ(RaiseHeightfield(PictureOf(Ball), options).error().code, Code::kInvalidArgument);
}

}  // namespace heightfield_test
}  // namespace etude::synthesis
