// SPDX-License-Identifier: Apache-2.0
// What varies from episode to episode: where the objects stand, where the arm starts. All draws come from
// seeded streams that the caller hands in, so that a scene is a function of its seeds.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "services/core/rng.h"
#include "services/spec/episode_plan.h"
#include "worker/collide/checker.h"

namespace etude::task {

/// Objects stand at least this far apart, and this far along x too (distinct columns of the picture).
inline constexpr double kMinimumDistance = 0.10;  // m

/// Kept free around the arm where it starts.
inline constexpr double kStartMargin = 0.005;  // m

/// Whether two objects at p_a and p_b (origins, world) stand that far apart; wide ones stand further.
bool StandApart(const sim::ObjectInfo& a, const Eigen::Vector3d& p_a, const sim::ObjectInfo& b,
                const Eigen::Vector3d& p_b);

/// A part of the table that one object is put into.
struct LocationBox {
  double x_min, x_max, y_min, y_max;  ///< m, world
};
/// Six of them, from the robot's left to its right: the original's.
const std::vector<LocationBox>& LocationBoxes();
/// The same columns with room in front of and behind every object, for relations.
const std::vector<LocationBox>& RoomyBoxes();

struct PlacedObject {
  std::string name;
  Pose X_WO;
  double beyond = 0;  ///< m that a wide one reaches further from its middle than others, however it is turned
};

/// Objects upright, each in one of `boxes` of its own, turned by up to +-`yaw` (rad) about the vertical.
/// @returns nothing when no arrangement was found within a fixed number of draws.
std::optional<std::vector<PlacedObject>> PlaceObjects(const std::vector<sim::ObjectInfo>& objects,
                                                      const std::vector<LocationBox>& boxes, double yaw, Rng& rng);

/// Smallest singular value of the tool's Jacobian at q: the worst ratio of tool speed to joint speed.
double Dexterity(sim::Kinematics& kinematics, const Eigen::VectorXd& q);
/// m, what starts have at least (the UR5's home has 0.11): the arm can leave in any direction.
inline constexpr double kStartDexterity = 0.06;

/// True when an arm of six joints would have to pass a singularity between the two: the sign of its Jacobian's
/// determinant differs. Never for other arms.
bool SingularityBetween(sim::Kinematics& kinematics, const Eigen::VectorXd& a, const Eigen::VectorXd& b);

/// Arm configuration near home whose hand is moved by uniform offsets, free of collisions.
/// @pre `checker` knows the objects; its gripper is open
/// @returns nothing when none was found within a fixed number of draws.
std::optional<Eigen::VectorXd> DrawStart(const sim::ArmInfo& arm, const RandomizationSpec& randomization,
                                         sim::Kinematics& kinematics, collide::Checker& checker, Rng& rng);

/// The same for tasks with an obstacle: the hand anywhere before the objects and low, `lowest` (m, of E) or a little
/// above, so that something on the table can be in its way.
std::optional<Eigen::VectorXd> DrawLowStart(const sim::ArmInfo& arm, double lowest, sim::Kinematics& kinematics,
                                            collide::Checker& checker, Rng& rng);

/// Puts the obstacle on the table, aside of the straight way of the hand from `q` to `goal` or in it, clear of the
/// objects, of the arm at `q` and of the hand at `goal`; `checker` knows the objects and gets it.
/// @returns nothing when no place was found within a fixed number of draws.
std::optional<PlacedObject> PlaceObstacle(const sim::ObjectInfo& obstacle, ObstaclePlace place,
                                          const std::vector<PlacedObject>& objects, const Eigen::VectorXd& q,
                                          const Pose& goal, sim::Kinematics& kinematics, collide::Checker& checker,
                                          Rng& rng);

}  // namespace etude::task
