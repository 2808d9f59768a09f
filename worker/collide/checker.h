// SPDX-License-Identifier: Apache-2.0
// Collision and distance queries of the arm against itself, the table and the objects, with FCL.
// Only worker/collide includes fcl/*.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "worker/sim/world.h"

namespace etude::collide {

struct Collision {
  std::string body_a, body_b;  ///< arm body (or held object) first
  double distance = 0;         ///< m; 0 when they penetrate
};

/// How near a body of the arm (or what it holds) is to another body.
struct Proximity {
  std::string body_a, body_b;  ///< arm body or held object; what it is near to
  std::string carrier;         ///< arm body that body_a is fixed to: itself, or the tool's for what is held
  double distance = 0;         ///< m; negative when they overlap: the depth
  Eigen::Vector3d p_WA, p_WB;  ///< m, world: nearest points of both; p_WA - p_WB = distance * normal
  Eigen::Vector3d normal;      ///< unit, world, from b to a: moving a along it makes the distance larger
};

/// Which pairs of bodies to look at.
enum class PairSet {
  kOthers,     ///< the arm against everything else
  kSelfToo,    ///< and against itself
  kSelfApart,  ///< only against itself, and of those pairs the ones that nothing makes near: apart at home
};

/// Answers for one arm in one scene. Verdicts are a pure function of what was set and of q: no
/// state is kept from one query to the next. One per thread (it owns kinematics and FCL objects).
class Checker {
 public:
  explicit Checker(std::shared_ptr<const sim::Scene> scene);
  Checker(Checker&&) noexcept;
  ~Checker();

  /// Where the objects are now. An object that was never set is not in the scene yet.
  void SetObject(const std::string& name, const Pose& X_WO);
  /// As after construction: no object is in the scene, none is allowed, none is held.
  void ClearObjects();
  /// Gripper opening used for the fingers' pose, 0 open .. 1 closed.
  void SetGripper(double gripper);
  double gripper() const;
  /// Contacts of the arm with these bodies are wanted (the target while it is grasped or pushed);
  /// replaces the former list. What the arm holds is still checked against all others.
  void Allow(std::set<std::string> bodies);
  /// Object that moves with the tool: X_EO. Its contacts with the table and with the gripper are
  /// allowed. Nothing to detach: the object then is where it was last set. One object at most is
  /// held.
  void Attach(const std::string& object, const std::optional<Pose>& X_EO);

  /// First collision at q, nothing when free. `margin` (m) inflates: pairs closer than it collide. Two bodies of the
  /// arm keep what they always keep (pieces.h) from a margin of 2 mm on, and nothing below it.
  std::optional<Collision> Check(const Eigen::VectorXd& q, double margin = 0.0);
  /// Whether Check would find one, without the time that its description takes.
  bool Collides(const Eigen::VectorXd& q, double margin = 0.0);
  /// The straight joint-space segment a -> b, both ends included, at steps of at most `resolution`
  /// rad (largest joint), by bisection. The collision found is not the first along the way.
  std::optional<Collision> CheckSegment(const Eigen::VectorXd& a, const Eigen::VectorXd& b, double resolution = 0.02,
                                        double margin = 0.0);
  /// Nearest pair between arm (and what it holds) and the rest, self-collision and allowed pairs
  /// apart. Infinite distance and empty names when there is no such pair.
  Collision Nearest(const Eigen::VectorXd& q);
  /// Everything nearer than `within` (m) to the arm and to what it holds, allowed pairs apart: one entry for each pair
  /// of bodies, with the points where they are nearest, in a fixed order (tool to base). Distances are right to 1e-5 m.
  std::vector<Proximity> Distances(const Eigen::VectorXd& q, double within, PairSet pairs = PairSet::kOthers);
  /// Two bodies of the arm that overlap.
  struct Overlap {
    std::string body_a, body_b;
    double depth = 0;  ///< m, see Separation
  };
  /// Pairs of SelfPairs() that overlap by more than `depth` (m), the bodies of the arm being at `X_WB` (in the order of
  /// ArmInfo::bodies, e.g. World::ArmPoses: as they are, fingers too). One entry for each pair of bodies.
  std::vector<Overlap> SelfOverlaps(const std::vector<Pose>& X_WB, double depth);
  /// Configurations checked since construction.
  std::uint64_t checks() const;
  /// Pairs of arm bodies that self collision tests.
  std::vector<std::pair<std::string, std::string>> SelfPairs() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Another opening of the gripper for as long as this lives: others ask the checker, too.
class WithGripper {
 public:
  WithGripper(Checker& checker, double gripper) : checker_(checker), before_(checker.gripper()) {
    checker_.SetGripper(gripper);
  }
  ~WithGripper() { checker_.SetGripper(before_); }
  WithGripper(const WithGripper&) = delete;
  WithGripper& operator=(const WithGripper&) = delete;

 private:
  Checker& checker_;
  const double before_;
};

}  // namespace etude::collide
