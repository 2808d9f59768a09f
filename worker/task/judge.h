// SPDX-License-Identifier: Apache-2.0
// The one judge of demonstrations and rollouts: it looks at every control step, whoever drives.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "services/core/config.h"
#include "worker/collide/checker.h"
#include "worker/task/criteria.h"
#include "worker/task/geometry/scene_geometry.h"
#include "worker/task/predicates/predicate.h"

namespace etude::task {

/// Control steps in a row for which the strict condition must hold: 0.4 s.
inline constexpr int kDwell = 50;
inline constexpr double kSelfContactDepth = 0.001;  ///< m of overlap of two bodies of the robot that count
inline constexpr double kSpeedShare = 1.05;         ///< of a joint's speed limit: faster counts
inline constexpr int kTorqueSteps = 10;             ///< control steps in a row: more beyond the torque limit count

/// Something a robot must not do, however the task ends.
struct Violation {
  enum class Kind {
    kContact,      ///< the robot, or the target, touched what has to be avoided
    kSelfContact,  ///< two bodies of the robot overlap; `worst` is the depth in m
    kJointSpeed,   ///< `worst` is the share of the joint's limit
    kTorque,       ///< demanded beyond the joint's limit; `worst` is the share of it
  };
  Kind kind = Kind::kContact;
  std::string what;  ///< "forearm-coke", or a joint
  int step = 0;      ///< the first control step,
  int steps = 1;     ///< and how many in a row
  double worst = 0;
};
std::string_view ToString(Violation::Kind kind);

/// Whom the judge looks at.
struct JudgeCase {
  Criteria criteria;
  std::string target, reference;
  std::vector<std::string> avoid;  ///< objects that neither the robot nor the target must touch; distractors too
};

/// Judges one attempt. Feed it every control step. Not thread-safe.
///
/// The strict condition counts at a step when it holds and the latched criterion has held by then: success therefore
/// implies success_latched.
class Judge {
 public:
  /// @pre `world` is in its start state. `checker` and `shapes` are of its scene and outlive the judge.
  /// @error kInvalidArgument: the criteria do not fit the scene, see MakePredicate
  static Result<Judge> Make(const JudgeCase& judged, const sim::World& world, const SceneGeometry& shapes,
                            collide::Checker* checker);
  Judge(Judge&&) noexcept = default;
  Judge& operator=(Judge&&) noexcept = default;

  /// After every World::Step.
  void Observe(const sim::World& world);
  /// Somebody else moved this object of the scene: where it is now is where it stood. Call before Observe.
  void Displaced(const sim::World& world, const std::string& object);

  int held() const { return held_; }             ///< control steps in a row, now
  bool done() const { return done_step_ >= 0; }  ///< it held for kDwell
  bool success() const { return done() && violations_.empty(); }
  /// The authors' criterion, true once and for all.
  bool success_latched() const { return latched_step_ >= 0; }
  const std::vector<Violation>& violations() const { return violations_; }
  /// The robot has touched the target.
  bool touched() const { return touched_; }
  /// Objects other than the target that moved by more than kDisturbedDistance, in order of name.
  std::vector<std::string> disturbed() const;

  /// What the strict condition lacks: "coke not grasped".
  std::string Words() const { return strict_->Words(); }
  /// {"success_latched", "done_step", "latched_step", "violations", "disturbed_objects"}, for Episode::details.
  OrderedJson Report() const;

 private:
  Judge() = default;
  void ObserveObjects(const sim::World& world);
  void ObserveContacts(const sim::World& world);
  void ObserveArm(const sim::World& world);
  void Note(Violation::Kind kind, const std::string& what, int first_step, double worst);

  JudgeCase case_;
  collide::Checker* checker_ = nullptr;
  std::unique_ptr<Predicate> strict_, latched_;
  Observation now_;
  std::map<std::string, double> moved_;  // m, by object, at most
  std::vector<Violation> violations_;
  std::vector<int> torque_steps_;  // by joint, in a row
  int step_ = 0, held_ = 0, done_step_ = -1, latched_step_ = -1;
  bool touched_ = false;
};

}  // namespace etude::task
