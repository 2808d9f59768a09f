// SPDX-License-Identifier: Apache-2.0
// Conditions on what stands on the table and what the robot does with it: one kind a file in this folder, combined
// by all, any and then. Success of a task is one such tree, whoever drives.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "services/core/result.h"
#include "services/episode/pose.h"
#include "services/spec/predicate_spec.h"

namespace etude::task {

/// One object as it is after a control step.
struct ObjectState {
  Pose X_WO, X_WO_start;                                  ///< now, and before anything moved
  double speed = 0;                                       ///< m/s of its origin over the last control step
  bool grasped = false;                                   ///< every group of fingers touches it
  bool touched = false;                                   ///< some body of the robot touches it
  std::vector<std::string_view> contacts;                 ///< bodies in contact with it; "world" is the table
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();       ///< m, of its upright bounding box, in its frame
  Eigen::Vector3d half_extent = Eigen::Vector3d::Zero();  ///< m, of that box
};

/// Every object of the scene by name.
using Observation = std::map<std::string, ObjectState>;

/// The state of an object that the scene has.
const ObjectState& StateOf(const Observation& now, const std::string& object);

/// Who plays which role: what "target", "reference" and "others" stand for.
struct Cast {
  std::string target, reference;     ///< reference: "" when the task has none
  std::vector<std::string> objects;  ///< of the scene, target and reference too
};

/// A condition. It may remember what it saw. Not thread-safe.
class Predicate {
 public:
  virtual ~Predicate() = default;
  /// Looks at one control step; called at every one of them, in order. @returns whether the condition holds now
  virtual bool Observe(const Observation& now) = 0;
  /// What it saw last and what it needs: "coke risen by 0.012 m (> 0.030)".
  virtual std::string Words() const = 0;
};

/// @error kInvalidArgument: an unknown kind or parameter (with the nearest known one), a wrong unit, a value out of its
/// range, a role that nothing plays, children where there are none; the message names the kind
Result<std::unique_ptr<Predicate>> MakePredicate(const PredicateSpec& spec, const Cast& cast);

}  // namespace etude::task
