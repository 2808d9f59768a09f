// SPDX-License-Identifier: Apache-2.0
#include "worker/task/distractor_placing.h"

#include <algorithm>
#include <cmath>

#include "services/core/check.h"

namespace etude::task {
namespace {

constexpr int kArrangements = 40;   // whole arrangements tried
constexpr int kDrawsPerThing = 60;  // places tried for one thing of an arrangement
constexpr LocationBox kTable{-0.45, 0.45, 0.06, 0.42};
constexpr double kGap = 0.03;     // m between the bounding boxes of two things, along the table
constexpr double kColumn = 0.05;  // m along x between those of a thing and of what the hand goes to
constexpr double kShade = 0.15;   // m along y within which a thing may hide what is behind it

bool Contains(const std::vector<std::string>& names, const std::string& name) {
  return std::ranges::find(names, name) != names.end();
}

// How far the thing reaches from its middle along the table however it is turned, m.
double Radius(const sim::ObjectInfo& thing) { return thing.half_extent.head<2>().norm(); }

const sim::ObjectInfo& InfoOf(const std::vector<sim::ObjectInfo>& infos, const std::string& name) {
  const auto it = std::ranges::find(infos, name, &sim::ObjectInfo::name);
  ETUDE_CHECK(it != infos.end(), "object={}", name);
  return *it;
}

bool IsClearOf(const Eigen::Vector3d& p, double radius, const PlacedObject& object, const PlacedScene& scene) {
  const double reach = radius + Radius(InfoOf(*scene.infos, object.name));
  const Eigen::Vector2d d = (p - object.X_WO.p).head<2>();
  if (d.norm() < reach + kGap) return false;
  if (Contains(scene.roles, object.name)) return std::abs(d.x()) >= reach + kColumn;
  // the camera looks from +y: what stands before an object hides it
  return std::abs(d.x()) >= reach || d.y() < 0 || d.y() > reach + kShade;
}

std::optional<std::vector<PlacedObject>> TryArrangement(const std::vector<sim::ObjectInfo>& distractors,
                                                        const PlacedScene& scene, Rng& rng) {
  std::vector<PlacedObject> placed;
  for (std::size_t i = 0; i < distractors.size(); ++i) {
    const double radius = Radius(distractors[i]);
    const auto fits = [&](const Eigen::Vector3d& p) {
      for (const auto& object : *scene.objects)
        if (!IsClearOf(p, radius, object, scene)) return false;
      for (std::size_t k = 0; k < placed.size(); ++k)
        if ((p - placed[k].X_WO.p).head<2>().norm() < radius + Radius(distractors[k]) + kGap) return false;
      return true;
    };
    for (int draw = 0; draw < kDrawsPerThing && placed.size() == i; ++draw) {
      const double x = rng.Uniform(kTable.x_min, kTable.x_max), y = rng.Uniform(kTable.y_min, kTable.y_max);
      const double turn = rng.Uniform(-scene.yaw, scene.yaw);
      const Eigen::Vector3d p(x, y, distractors[i].rest_height);
      if (fits(p)) placed.push_back({distractors[i].name, {p, FromEuler({0, 0, turn})}});
    }
    if (placed.size() == i) return std::nullopt;
  }
  return placed;
}

}  // namespace

std::optional<std::vector<PlacedObject>> PlaceDistractors(const std::vector<sim::ObjectInfo>& distractors,
                                                          const PlacedScene& scene, collide::Checker& checker,
                                                          Rng& rng) {
  if (distractors.empty()) return std::vector<PlacedObject>{};
  for (int arrangement = 0; arrangement < kArrangements; ++arrangement) {
    auto placed = TryArrangement(distractors, scene, rng);
    if (!placed) continue;
    for (const auto& thing : *placed) checker.SetObject(thing.name, thing.X_WO);
    if (scene.feasible()) return placed;
  }
  return std::nullopt;
}

}  // namespace etude::task
