// SPDX-License-Identifier: Apache-2.0
#include "worker/task/scene_sampling.h"

#include <gmock/gmock.h>

#include <map>
#include <set>

namespace etude::task {
namespace scene_sampling_test {

std::vector<sim::ObjectInfo> SixObjects() {
  std::vector<sim::ObjectInfo> objects;
  for (const char* name : {"cube", "coke", "pepsi", "milk", "bread", "bottle"})
    objects.push_back({name, {0.025, 0.025, 0.05}, 0.04, 0.1});
  return objects;
}

bool Inside(const LocationBox& box, const Eigen::Vector3d& p) {
  return p.x() >= box.x_min && p.x() < box.x_max && p.y() >= box.y_min && p.y() < box.y_max;
}

TEST(PlaceObjects, KeepsItsRulesOverManySeeds) {
  const auto objects = SixObjects();
  std::map<std::string, std::set<int>> boxes_seen;
  for (std::uint64_t seed = 0; seed < 2000; ++seed) {
    Rng rng(seed);
    const auto placed = PlaceObjects(objects, LocationBoxes(), 0.3, rng);
    ASSERT_TRUE(placed.has_value()) << seed;
    ASSERT_EQ(placed->size(), 6u);
    std::set<int> used;
    for (const auto& object : *placed) {
      EXPECT_DOUBLE_EQ(object.X_WO.p.z(), 0.04);
      const Eigen::Vector3d rpy = ToEuler(object.X_WO.q);
      EXPECT_LE(std::abs(rpy.z()), 0.3);
      EXPECT_NEAR(rpy.head<2>().norm(), 0, 1e-12);
      int in_boxes = 0;
      for (int b = 0; b < 6; ++b)
        if (Inside(LocationBoxes()[b], object.X_WO.p)) ++in_boxes, boxes_seen[object.name].insert(b);
      EXPECT_GE(in_boxes, 1) << seed << " " << object.name;
      for (const auto& other : *placed) {
        if (other.name == object.name) continue;
        EXPECT_GE(std::abs(other.X_WO.p.x() - object.X_WO.p.x()), kMinimumDistance) << seed;
      }
    }
  }
  for (const auto& [name, boxes] : boxes_seen) EXPECT_EQ(boxes.size(), 6u) << name << " is never put somewhere";
}

TEST(PlaceObjects, IsAFunctionOfTheSeed) {
  const auto objects = SixObjects();
  Rng a(7), b(7), c(8);
  const auto first = PlaceObjects(objects, LocationBoxes(), 0.3, a),
             again = PlaceObjects(objects, LocationBoxes(), 0.3, b),
             other = PlaceObjects(objects, LocationBoxes(), 0.3, c);
  for (std::size_t i = 0; i < objects.size(); ++i) {
    EXPECT_EQ((*first)[i].X_WO.p, (*again)[i].X_WO.p);
    EXPECT_NE((*first)[i].X_WO.p, (*other)[i].X_WO.p);
  }
}

TEST(PlaceObjects, ZeroYawStandsStraight) {
  Rng rng(3);
  const auto placed = PlaceObjects(SixObjects(), LocationBoxes(), 0.0, rng);
  ASSERT_TRUE(placed.has_value());
  for (const auto& object : *placed) EXPECT_NEAR(AngleBetween(object.X_WO.q, Eigen::Quaterniond::Identity()), 0, 1e-9);
}

}  // namespace scene_sampling_test
}  // namespace etude::task
