// SPDX-License-Identifier: Apache-2.0
#include "worker/task/scene_sampling.h"

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

#include "services/core/check.h"

namespace etude::task {
namespace {

constexpr int kSceneArrangements = 100;  // whole arrangements tried
constexpr int kDrawsPerObject = 100;     // places tried for one object of an arrangement
constexpr int kStartDraws = 100;
constexpr double kUsualHalf = 0.05;      // m, half as wide as objects are that kMinimumDistance is enough for
constexpr double kLowStartWidth = 0.30;  // m, +- x of a low start
constexpr double kLowStartNear = 0.05, kLowStartFar = 0.25;  // m, y
constexpr double kLowStartHeight = 0.05;                     // m above the lowest
constexpr int kWayStates = 16;                               // states that stand for a straight way
constexpr int kObstacleDraws = 60;
constexpr double kObstacleGap = 0.05;   // m between the obstacle and the middle of an object
constexpr double kClearAtEnds = 0.015;  // m kept free around the arm at the ends of its way
constexpr double kAsideMargin = 0.05;   // m around the whole way past an obstacle aside

// How much further than others a wide object has to be from its neighbours, m.
double Excess(const sim::ObjectInfo& object) {
  return std::max(0.0, object.half_extent.head<2>().maxCoeff() - kUsualHalf);
}

// How much further a wide object reaches from its middle, however it is turned, m.
double Beyond(const sim::ObjectInfo& object) {
  return Excess(object) > 0 ? object.half_extent.head<2>().norm() - kUsualHalf : 0;
}

// @param objects  those placed first, one after another
bool FarEnough(const sim::ObjectInfo& object, const Eigen::Vector3d& p, const std::vector<PlacedObject>& placed,
               const std::vector<sim::ObjectInfo>& objects) {
  for (std::size_t i = 0; i < placed.size(); ++i)
    if (!StandApart(object, p, objects[i], placed[i].X_WO.p)) return false;
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
      if (!FarEnough(objects[i], p, placed, objects)) continue;
      placed.push_back({objects[i].name, {p, FromEuler({0, 0, rng.Uniform(-yaw, yaw)})}, Beyond(objects[i])});
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

}  // namespace

bool StandApart(const sim::ObjectInfo& a, const Eigen::Vector3d& p_a, const sim::ObjectInfo& b,
                const Eigen::Vector3d& p_b) {
  const Eigen::Vector2d d = (p_a - p_b).head<2>();
  const double least = kMinimumDistance + Excess(a) + Excess(b);
  return d.norm() >= least && std::abs(d.x()) >= least;
}

const std::vector<LocationBox>& LocationBoxes() {
  static const std::vector<LocationBox> boxes{{0.28, 0.43, 0.15, 0.30},   {0.10, 0.30, 0.25, 0.40},
                                              {-0.02, 0.12, 0.25, 0.40},  {-0.12, 0.02, 0.25, 0.40},
                                              {-0.30, -0.10, 0.25, 0.40}, {-0.43, -0.28, 0.15, 0.30}};
  return boxes;
}

const std::vector<LocationBox>& RoomyBoxes() {
  static const std::vector<LocationBox> boxes = [] {
    std::vector<LocationBox> roomy = LocationBoxes();
    for (LocationBox& box : roomy) box.y_min = 0.12, box.y_max = 0.34;
    return roomy;
  }();
  return boxes;
}

double Dexterity(sim::Kinematics& kinematics, const Eigen::VectorXd& q) {
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(kinematics.Jacobian(q));
  return svd.singularValues().minCoeff();
}

bool SingularityBetween(sim::Kinematics& kinematics, const Eigen::VectorXd& a, const Eigen::VectorXd& b) {
  if (a.size() != 6) return false;
  return kinematics.Jacobian(a).determinant() * kinematics.Jacobian(b).determinant() < 0;
}

std::optional<std::vector<PlacedObject>> PlaceObjects(const std::vector<sim::ObjectInfo>& objects,
                                                      const std::vector<LocationBox>& all_boxes, double yaw, Rng& rng) {
  ETUDE_CHECK(objects.size() <= all_boxes.size(), "{} objects", objects.size());
  for (int arrangement = 0; arrangement < kSceneArrangements; ++arrangement) {
    std::vector<LocationBox> boxes = all_boxes;
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
    Eigen::Vector3d turn = DrawOffset(randomization.start_orientation, rng);
    if (!arm.turns_any_way()) turn.head<2>().setZero();
    const Pose X_WE{X_WE_home.p + shift, FromEuler(turn) * X_WE_home.q};
    const auto q = kinematics.Solve(X_WE, arm.q_home);
    if (q && Dexterity(kinematics, *q) > kStartDexterity && !checker.Collides(*q, kStartMargin)) return q;
  }
  return std::nullopt;
}

std::optional<Eigen::VectorXd> DrawLowStart(const sim::ArmInfo& arm, double lowest, sim::Kinematics& kinematics,
                                            collide::Checker& checker, Rng& rng) {
  const Pose X_WE_home = kinematics.X_WE(arm.q_home);
  for (int draw = 0; draw < kStartDraws; ++draw) {
    const double x = rng.Uniform(-kLowStartWidth, kLowStartWidth);
    const double y = rng.Uniform(kLowStartNear, kLowStartFar);
    const Pose X_WE{{x, y, lowest + rng.Uniform(0, kLowStartHeight)}, X_WE_home.q};
    const auto q = kinematics.Solve(X_WE, arm.q_home);
    if (q && !SingularityBetween(kinematics, arm.q_home, *q) && Dexterity(kinematics, *q) > kStartDexterity &&
        !checker.Collides(*q, kStartMargin))
      return q;
  }
  return std::nullopt;
}

namespace {

// The arm at some places along the hand's straight way, as far as it can follow.
std::vector<Eigen::VectorXd> StraightWay(const Eigen::VectorXd& q_start, const Pose& goal,
                                         sim::Kinematics& kinematics) {
  const Pose start = kinematics.X_WE(q_start);
  std::vector<Eigen::VectorXd> way{q_start};
  for (int i = 1; i <= kWayStates; ++i) {
    const double s = static_cast<double>(i) / kWayStates;
    const auto q = kinematics.Solve(Interpolate(start, goal, s), way.back());
    if (!q) break;
    way.push_back(*q);
  }
  return way;
}

bool Touches(const std::vector<Eigen::VectorXd>& way, const std::string& obstacle, double margin,
             collide::Checker& checker) {
  return std::any_of(way.begin(), way.end(), [&](const Eigen::VectorXd& q) {
    const auto collision = checker.Check(q, margin);
    if (!collision || collision->body_b == obstacle) return collision.has_value();
    // a low hand is as near to the table: what comes first says nothing about the obstacle
    const auto near = checker.Distances(q, margin);
    return std::any_of(near.begin(), near.end(), [&](const auto& pair) { return pair.body_b == obstacle; });
  });
}

bool ClearOfObjects(const sim::ObjectInfo& obstacle, const Eigen::Vector3d& p,
                    const std::vector<PlacedObject>& objects) {
  return std::all_of(objects.begin(), objects.end(), [&](const PlacedObject& object) {
    return (p - object.X_WO.p).head<2>().norm() > obstacle.half_extent.x() + kObstacleGap + object.beyond;
  });
}

}  // namespace

std::optional<PlacedObject> PlaceObstacle(const sim::ObjectInfo& obstacle, ObstaclePlace place,
                                          const std::vector<PlacedObject>& objects, const Eigen::VectorXd& q,
                                          const Pose& goal, sim::Kinematics& kinematics, collide::Checker& checker,
                                          Rng& rng) {
  const auto way = StraightWay(q, goal, kinematics);
  const Eigen::Vector3d start = kinematics.X_WE(q).p;
  for (int draw = 0; draw < kObstacleDraws; ++draw) {
    Eigen::Vector3d p(0, 0, obstacle.rest_height);
    if (place == ObstaclePlace::kInTheWay) {
      const double s = rng.Uniform(0.25, 0.8);
      p.x() = start.x() + s * (goal.p.x() - start.x()) + rng.Uniform(-0.05, 0.05);
      p.y() = start.y() + s * (goal.p.y() - start.y()) + rng.Uniform(-0.05, 0.05);
    } else {
      p.x() = rng.Uniform(-0.45, 0.45);
      p.y() = rng.Uniform(0.02, 0.42);
    }
    if (!ClearOfObjects(obstacle, p, objects)) continue;
    const Pose X_WO{p, FromEuler({rng.Uniform(-3, 3), 0, rng.Uniform(-3, 3)})};
    checker.SetObject(obstacle.name, X_WO);
    const std::vector<Eigen::VectorXd> ends{way.front(), way.back()};
    checker.SetGripper(1);
    const bool touches_closed = Touches(ends, obstacle.name, kClearAtEnds, checker);
    checker.SetGripper(0);
    if (touches_closed || Touches(ends, obstacle.name, kClearAtEnds, checker)) continue;
    const bool blocked = Touches(way, obstacle.name, place == ObstaclePlace::kInTheWay ? 0.0 : kAsideMargin, checker);
    if (blocked == (place == ObstaclePlace::kInTheWay)) return PlacedObject{obstacle.name, X_WO};
  }
  return std::nullopt;
}

}  // namespace etude::task
