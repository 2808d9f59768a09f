// SPDX-License-Identifier: Apache-2.0
// A table with a coke (target), a milk carton (reference) and a loaf of bread, for tests of predicates.
#pragma once

#include <gmock/gmock.h>

#include <memory>
#include <numbers>
#include <string>

#include "worker/task/predicates/predicate.h"

namespace etude::task {

inline constexpr double kQuarter = std::numbers::pi / 2;

inline Pose At(double x, double y, double z, const Eigen::Vector3d& rpy = Eigen::Vector3d::Zero()) {
  return {{x, y, z}, FromEuler(rpy)};
}

/// Fixture: `now` is the scene as it starts, everything upright and at rest.
class PredicateTest : public testing::Test {
 protected:
  PredicateTest() {
    Put("coke", At(0, 0.3, 0.04), {0.025, 0.025, 0.04});
    Put("milk", At(0.1, 0.25, 0.06), {0.02, 0.02, 0.06});
    Put("bread", At(-0.2, 0.3, 0.03), {0.03, 0.03, 0.03});
  }

  static Cast TheCast() { return {.target = "coke", .reference = "milk", .objects = {"bread", "coke", "milk"}}; }

  /// @param yaml  "{risen: {by: 3 cm}}"
  static Result<std::unique_ptr<Predicate>> Try(const std::string& yaml) {
    const auto json = ParseYaml(yaml, "test");
    EXPECT_TRUE(json.has_value()) << yaml;
    const auto spec = PredicateFromJson(*json, "test");
    EXPECT_TRUE(spec.has_value()) << spec.error().message;
    return MakePredicate(*spec, TheCast());
  }
  static std::unique_ptr<Predicate> Make(const std::string& yaml) {
    auto made = Try(yaml);
    EXPECT_TRUE(made.has_value()) << made.error().message;
    return std::move(*made);
  }

  ObjectState& coke() { return now["coke"]; }
  ObjectState& milk() { return now["milk"]; }
  ObjectState& bread() { return now["bread"]; }

  Observation now;

 private:
  void Put(const std::string& name, const Pose& X_WO, const Eigen::Vector3d& half_extent) {
    now[name] = {.X_WO = X_WO, .X_WO_start = X_WO, .contacts = {"world"}, .half_extent = half_extent};
  }
};

}  // namespace etude::task
