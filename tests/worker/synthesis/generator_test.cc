// SPDX-License-Identifier: Apache-2.0
// Tests worker/synthesis/generator.cc, the drawings and pattern.cc
#include "worker/synthesis/generator.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "services/spec/object_names.h"
#include "tests/support/matchers.h"
#include "worker/synthesis/drawn_object.h"
#include "worker/synthesis/heightfield.h"
#include "worker/synthesis/mass.h"
#include "worker/synthesis/pattern.h"

namespace etude::synthesis {
namespace generator_test {

/// Mean difference of two pictures' colours, 0..255.
double Difference(const Picture& a, const Picture& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.rgb.size(); ++i) sum += std::abs(a.rgb[i] - b.rgb[i]);
  return sum / static_cast<double>(a.rgb.size());
}

TEST(Draw, IsAFunctionOfTheSeed) {
  const Picture once = Draw("strawberry", 5).value(), again = Draw("strawberry", 5).value();
  EXPECT_EQ(once.rgb, again.rgb);
  EXPECT_EQ(once.depth, again.depth);
  EXPECT_EQ(once.mask, again.mask);
}

TEST(Draw, EveryClassHasRoomDepthAndVariety) {
  for (const ClassFacts& known : KnownClasses()) {
    const Picture first = Draw(known.name, 0).value(), second = Draw(known.name, 1).value();
    EXPECT_GT(Difference(first, second), 3) << known.name;

    const auto object = std::count(first.mask.begin(), first.mask.end(), 1);
    EXPECT_GT(object, 0.2 * first.pixels()) << known.name;
    EXPECT_EQ(*std::max_element(first.depth.begin(), first.depth.end()), 1.0f) << known.name;
    EXPECT_GT(first.relief, 0.1) << known.name;
    for (int i = 0; i < first.width; ++i) {
      EXPECT_EQ(first.mask[i], 0) << known.name << " is cut by the picture's upper border";
      EXPECT_EQ(first.mask[first.pixels() - 1 - i], 0) << known.name << " is cut by the lower border";
      EXPECT_EQ(first.mask[static_cast<std::size_t>(i) * first.width], 0) << known.name << " is cut at the left";
    }
  }
}

TEST(Draw, EveryClassIsASoundBody) {
  for (const ClassFacts& known : KnownClasses())
    for (const std::uint64_t seed : {1, 2, 3}) {
      const auto body = RaiseHeightfield(Draw(known.name, seed).value());
      ASSERT_THAT(body, IsOk());
      EXPECT_TRUE(IsWatertight(body->mesh)) << known.name;
      EXPECT_EQ(CountParts(body->mesh), 1) << known.name;
      EXPECT_GT(Integrate(body->mesh).mass, 0) << known.name;
      EXPECT_GT(SmallestFace(body->mesh), 1e-8) << known.name;
      EXPECT_LE(body->mesh.faces.size(), 5000u) << known.name;
      EXPECT_EQ(body->hole.has_value(), known.name == "donut" || known.name == "mug") << known.name << " " << seed;
    }
}

TEST(Draw, KnowsTheClassesThatCampaignsName) {
  std::vector<std::string> names;
  for (const ClassFacts& known : KnownClasses()) names.push_back(known.name);
  EXPECT_EQ(names, GeneratedClasses());
}

TEST(DrawObject, TenDifferentInstancesThatAHandCanGrasp) {
  for (const ClassFacts& known : KnownClasses()) {
    std::set<std::vector<std::uint8_t>> textures;
    std::set<std::vector<double>> extents;
    for (int i = 0; i < kInstancesPerClass; ++i) {
      const auto object = DrawObject(known.name, i, kObjectSeed);
      ASSERT_THAT(object, IsOk());
      const ObjectFacts& facts = object->facts;
      textures.insert(object->texture.rgb);
      extents.insert(facts.extent_m);
      EXPECT_EQ(facts.split, i < 3 ? "train" : "test");
      EXPECT_TRUE(IsWatertight(object->visual)) << facts.name;
      EXPECT_GT(SmallestFace(object->visual), 1e-11) << facts.name;
      EXPECT_LE(facts.extent_m[0], 0.0681) << facts.name;  // fingers open to 0.085
      EXPECT_GE(facts.extent_m[0], 0.045) << facts.name;
      EXPECT_GE(facts.extent_m[2], 0.062) << facts.name;  // pads close between 0.047 and 0.069
      EXPECT_LE(facts.extent_m[2], 0.100) << facts.name;
      EXPECT_GT(facts.mass_kg, 0.02) << facts.name;
      EXPECT_LT(facts.mass_kg, 0.30) << facts.name;
      EXPECT_GT(facts.foot_m[3], 0.009) << facts.name;
    }
    EXPECT_EQ(textures.size(), 10u) << known.name;
    EXPECT_EQ(extents.size(), 10u) << known.name;
  }
}

TEST(Draw, RefusesAnUnknownClass) {
  EXPECT_THAT(Draw("lemmon", 0), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(Draw("lemmon", 0), MessageHas("lemon"));
}

TEST(Pattern, SpotsAreASpacingApart) {
  for (double x = -1; x < 1; x += 0.013) {
    const Spot spot = NearestSpot({x, 0.3 * x}, 0.1, 4);
    EXPECT_LT(spot.offset.norm(), 0.15);
    EXPECT_GE(spot.random, 0);
    EXPECT_LT(spot.random, 1);
  }
}

TEST(Pattern, RampGoesBothWays) {
  EXPECT_EQ(Ramp(1, 2, 0.5), 0);
  EXPECT_EQ(Ramp(1, 2, 2.5), 1);
  EXPECT_EQ(Ramp(2, 1, 0.5), 1);
  EXPECT_DOUBLE_EQ(Ramp(1, 2, 1.5), 0.5);
}

}  // namespace generator_test
}  // namespace etude::synthesis
