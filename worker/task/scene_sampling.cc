// SPDX-License-Identifier: Apache-2.0
#include "worker/task/scene_sampling.h"

#include <Eigen/SVD>
#include <cmath>

#include "services/core/check.h"

namespace etude::task {
namespace {

constexpr int kArrangements = 100;    // whole arrangements tried
constexpr int kDrawsPerObject = 100;  // places tried for one object of an arrangement
constexpr int kStartDraws = 100;
constexpr double kStartMargin = 0.005;    // m kept free around the arm where it starts
constexpr double kStartDexterity = 0.06;  // m (home has 0.11): the arm can leave in any direction

bool FarEnough(const Eigen::Vector3d& p, const std::vector<PlacedObject>& placed) {
  for (const auto& other : placed) {
    const Eigen::Vector2d d = (p - other.X_WO.p).head<2>();
    if (d.norm() < kMinimumDistance || std::abs(d.x()) < kMinimumDistance) return false;
  }
  return true;
}

std::optional<std::vector<PlacedObject>> TryArrangement(const std::vector<sim::ObjectInfo>& objects,
                                                        const std::vector<LocationBox>& boxes, double yaw, Rng& rng) {
  std::vector<PlacedObject> placed;
  for (std::size_t i = 0; i < objects.size(); ++i) {
    const LocationBox& box = boxes[i];
    bool found = false;
    for (int draw = 0; draw < kDrawsPerObject && !found; ++draw) {
      const double x = rng.Uniform(box.x_min, box.x_max);
      const double y = rng.Uniform(box.y_min, box.y_max);
      const Eigen::Vector3d p(x, y, objects[i].rest_height);
      if (!FarEnough(p, placed)) continue;
      placed.push_back({objects[i].name, {p, FromEuler({0, 0, rng.Uniform(-yaw, yaw)})}});
      found = true;
    }
    if (!found) return std::nullopt;
  }
  return placed;
}

Eigen::Vector3d DrawOffset(double size, Rng& rng) {
  const double x = rng.Uniform(-size, size);
  const double y = rng.Uniform(-size, size);
  return {x, y, rng.Uniform(-size, size)};
}

// Smallest singular value of the tool's Jacobian: the worst ratio of tool speed to joint speed.
double Dexterity(sim::Kinematics& kinematics, const Eigen::VectorXd& q) {
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(kinematics.Jacobian(q));
  return svd.singularValues().minCoeff();
}

}  // namespace

const std::vector<LocationBox>& LocationBoxes() {
  static const std::vector<LocationBox> boxes{{0.28, 0.43, 0.15, 0.30},   {0.10, 0.30, 0.25, 0.40},
                                              {-0.02, 0.12, 0.25, 0.40},  {-0.12, 0.02, 0.25, 0.40},
                                              {-0.30, -0.10, 0.25, 0.40}, {-0.43, -0.28, 0.15, 0.30}};
  return boxes;
}

std::optional<std::vector<PlacedObject>> PlaceObjects(const std::vector<sim::ObjectInfo>& objects, double yaw,
                                                      Rng& rng) {
  ETUDE_CHECK(objects.size() <= LocationBoxes().size(), "{} objects", objects.size());
  for (int arrangement = 0; arrangement < kArrangements; ++arrangement) {
    std::vector<LocationBox> boxes = LocationBoxes();
    rng.Shuffle(boxes);
    if (auto placed = TryArrangement(objects, boxes, yaw, rng)) return placed;
  }
  return std::nullopt;
}

std::optional<Eigen::VectorXd> DrawStart(const sim::ArmInfo& arm, const RandomizationSpec& randomization,
                                         sim::Kinematics& kinematics, collide::Checker& checker, Rng& rng) {
  const Pose X_WE_home = kinematics.X_WE(arm.q_home);
  for (int draw = 0; draw < kStartDraws; ++draw) {
    const Eigen::Vector3d shift = DrawOffset(randomization.start_position, rng);
    const Eigen::Vector3d turn = DrawOffset(randomization.start_orientation, rng);
    const Pose X_WE{X_WE_home.p + shift, FromEuler(turn) * X_WE_home.q};
    const auto q = kinematics.Solve(X_WE, arm.q_home);
    if (q && Dexterity(kinematics, *q) > kStartDexterity && !checker.Check(*q, kStartMargin)) return q;
  }
  return std::nullopt;
}

std::string TargetOf(const CampaignSpec& spec, std::uint64_t index) {
  Rng rng(MixSeed({spec.seed, index}, "target"));
  return spec.objects[rng.Below(spec.objects.size())];
}

}  // namespace etude::task
