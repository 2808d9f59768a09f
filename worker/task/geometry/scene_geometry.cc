// SPDX-License-Identifier: Apache-2.0
#include "worker/task/geometry/scene_geometry.h"

#include <algorithm>
#include <limits>
#include <numbers>

#include "services/core/check.h"

namespace etude::task {

double Support(const sim::Geometry& piece, const Pose& X_WG, const Eigen::Vector3d& direction) {
  using Shape = sim::Geometry::Shape;
  const Eigen::Vector3d d = X_WG.q.conjugate() * direction;  // in G
  const double centre = direction.dot(X_WG.p);
  switch (piece.shape) {
    case Shape::kBox:
      return centre + d.cwiseAbs().dot(piece.size);
    case Shape::kSphere:
      return centre + piece.size.x();
    case Shape::kCapsule:
      return centre + piece.size.x() + std::abs(d.z()) * piece.size.y();
    case Shape::kCylinder:
      return centre + piece.size.x() * d.head<2>().norm() + std::abs(d.z()) * piece.size.y();
    case Shape::kConvex: {
      double most = -std::numeric_limits<double>::infinity();
      for (const auto& vertex : piece.vertices) most = std::max(most, d.dot(vertex));
      return centre + most;
    }
  }
  return centre;
}

Eigen::Quaterniond Hand(double pitch) {
  return Eigen::Quaterniond(Eigen::AngleAxisd(-pitch, Eigen::Vector3d::UnitX())) * LevelHand();
}
Eigen::Quaterniond LevelHand() { return FromEuler({std::numbers::pi, 0, std::numbers::pi / 2}); }
Eigen::Quaterniond TurnedHand() { return FromEuler({std::numbers::pi / 2, 0, std::numbers::pi / 2}); }
Eigen::Vector3d ApproachOf(double pitch) { return {0, std::cos(pitch), -std::sin(pitch)}; }

Eigen::Vector3d DirectionOf(Whereto to) {
  switch (to) {
    case Whereto::kLeft:
      return Eigen::Vector3d::UnitX();
    case Whereto::kRight:
      return -Eigen::Vector3d::UnitX();
    case Whereto::kFront:
      return Eigen::Vector3d::UnitY();
    case Whereto::kBehind:
      return -Eigen::Vector3d::UnitY();
    case Whereto::kHere:
    case Whereto::kOnTop:
    case Whereto::kInside:
      break;
  }
  ETUDE_CHECK(false, "no direction");
  return Eigen::Vector3d::Zero();
}

namespace {

// Where the first body stands that the first joint turns: the root may be a pedestal, or a torso.
Eigen::Vector2d FirstAxis(const sim::ArmInfo& arm, sim::Kinematics& kinematics) {
  Eigen::VectorXd turned = arm.q_home;
  turned[0] += 0.1;
  const auto home = kinematics.ArmPoses(arm.q_home, 0), after = kinematics.ArmPoses(turned, 0);
  for (std::size_t i = 0; i < home.size(); ++i)
    if (AngleBetween(home[i].q, after[i].q) > 0.05) return home[i].p.head<2>();
  return home.front().p.head<2>();
}

}  // namespace

SceneGeometry::SceneGeometry(const sim::Scene& scene, sim::Kinematics& kinematics)
    : objects_(scene.objects()),
      natural_pitch_(scene.arm().approach_pitch),
      turned_pitch_(scene.arm().turned_pitch),
      joint_speed_(scene.arm().planned_speed.minCoeff()),
      turns_any_way_(scene.arm().turns_any_way()) {
  for (const auto& piece : scene.geometry()) pieces_[piece.body].push_back(piece);
  MeasureHand(scene, kinematics);
  const Eigen::Vector3d forward = ApproachOf(0);
  ahead_open_ = Reach(Part::kHand, false, LevelHand(), forward);
  ahead_closed_ = Reach(Part::kHand, true, LevelHand(), forward);
  palm_ahead_ = Reach(Part::kPalm, true, LevelHand(), forward);
  base_ = FirstAxis(scene.arm(), kinematics);
}

void SceneGeometry::MeasureHand(const sim::Scene& scene, sim::Kinematics& kinematics) {
  const auto& arm = scene.arm();
  const Eigen::VectorXd q_other = (arm.q_home.array() + 0.2).matrix().cwiseMin(arm.q_max).cwiseMax(arm.q_min);
  const auto in_hand = [&](const Eigen::VectorXd& q, double gripper) {
    const Pose X_EW = kinematics.X_WE(q).inverse();
    std::vector<Pose> poses = kinematics.ArmPoses(q, gripper);
    for (Pose& pose : poses) pose = X_EW * pose;
    return poses;
  };
  const auto same = [](const Pose& a, const Pose& b) {
    return (a.p - b.p).norm() < 1e-6 && AngleBetween(a.q, b.q) < 1e-5;
  };
  const auto open = in_hand(arm.q_home, 0), elsewhere = in_hand(q_other, 0), half = in_hand(arm.q_home, 0.5),
             closed = in_hand(arm.q_home, 1);
  for (std::size_t i = 0; i < arm.bodies.size(); ++i) {
    const auto pieces = pieces_.find(arm.bodies[i]);
    if (pieces == pieces_.end() || !same(open[i], elsewhere[i])) continue;  // the arm moves it: not the hand
    // a jaw that stays where it is holds, too
    const bool listed = std::ranges::any_of(
        arm.finger_groups, [&](const auto& group) { return std::ranges::find(group, arm.bodies[i]) != group.end(); });
    const bool finger = listed || !same(open[i], closed[i]);
    for (const auto& piece : pieces->second) {
      (finger ? fingers_[0] : palm_).emplace_back(piece, open[i] * piece.X_BG);
      if (!finger) continue;
      fingers_[1].emplace_back(piece, half[i] * piece.X_BG);
      fingers_[2].emplace_back(piece, closed[i] * piece.X_BG);
    }
  }
  ETUDE_CHECK(!fingers_[0].empty() && !palm_.empty(), "the hand has no collision pieces");
}

namespace {

double SupportOf(const std::vector<std::pair<sim::Geometry, Pose>>& pieces, const Eigen::Quaterniond& q_WE,
                 const Eigen::Vector3d& direction) {
  double most = -std::numeric_limits<double>::infinity();
  for (const auto& [piece, X_EG] : pieces)
    most = std::max(most, Support(piece, Pose{Eigen::Vector3d::Zero(), q_WE} * X_EG, direction));
  return most;
}

}  // namespace

double SceneGeometry::FurthestReach(const Eigen::Quaterniond& q_WE, const Eigen::Vector3d& direction) const {
  double most = SupportOf(palm_, q_WE, direction);
  for (const Placed& fingers : fingers_) most = std::max(most, SupportOf(fingers, q_WE, direction));
  return most;
}

double SceneGeometry::Reach(Part part, bool closed, const Eigen::Quaterniond& q_WE,
                            const Eigen::Vector3d& direction) const {
  const double fingers = SupportOf(fingers_[closed ? 2 : 0], q_WE, direction);
  const double palm = SupportOf(palm_, q_WE, direction);
  return part == Part::kFingers ? fingers : part == Part::kPalm ? palm : std::max(fingers, palm);
}

const sim::ObjectInfo& SceneGeometry::object(const std::string& name) const {
  const auto it =
      std::find_if(objects_.begin(), objects_.end(), [&](const auto& object) { return object.name == name; });
  ETUDE_CHECK(it != objects_.end(), "object={}", name);
  return *it;
}

Eigen::Vector3d SceneGeometry::Centre(const std::string& name) const {
  const auto& info = object(name);
  return {0, 0, info.half_extent.z() - info.rest_height};
}

double SceneGeometry::HeightOnTable(const std::string& name, const Eigen::Quaterniond& q_WO) const {
  const auto pieces = pieces_.find(name);
  ETUDE_CHECK(pieces != pieces_.end(), "object={}", name);
  double below = -std::numeric_limits<double>::infinity();
  for (const auto& piece : pieces->second) {
    const Pose X_WG = Pose{Eigen::Vector3d::Zero(), q_WO} * piece.X_BG;
    below = std::max(below, Support(piece, X_WG, -Eigen::Vector3d::UnitZ()));
  }
  return below;
}

}  // namespace etude::task
