// SPDX-License-Identifier: Apache-2.0
// What motions cost an arm: which joints were asked for more torque than they have, and what it touched that nobody
// wanted touched. Tells a person why a robot fails.
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "worker/sim/world.h"
#include "worker/task/judge.h"

namespace etude::task {

/// Sums over control steps of one arm. Not thread-safe.
class Effort {
 public:
  /// A joint that was asked for more than its limit.
  struct Joint {
    std::string name;
    double limit = 0;   ///< N m
    double demand = 0;  ///< N m, the most
    int steps = 0;      ///< control steps beyond the limit
  };
  /// Two bodies that touched and should not have.
  struct Touch {
    std::string body, other;  ///< of the robot; "world" is the table
    int steps = 0;            ///< control steps; an overlap of the robot with itself ends a demonstration at once
  };

  /// After a World::Step. `wanted` may be touched: the object that a task is about, "" for none.
  void Observe(const sim::World& world, const std::string& wanted);
  /// The judge's self-contacts.
  void Add(const std::vector<Violation>& violations);
  /// Another's steps besides these. @pre of the same arm, or of none yet
  void Add(const Effort& other);

  int steps() const { return steps_; }
  std::vector<Joint> Saturated() const;  ///< the worst first
  std::vector<Touch> Touches() const;    ///< the longest first

 private:
  int steps_ = 0;
  std::vector<Joint> joints_;  ///< every joint of the arm
  std::map<std::pair<std::string, std::string>, int> touches_;
};

}  // namespace etude::task
