// SPDX-License-Identifier: Apache-2.0
// at_rest: the object's origin hardly moves.
#include "worker/task/predicates/kinds.h"
#include "worker/task/predicates/less_than.h"

namespace etude::task {

PredicateKind kinds::at_rest() {
  const auto bound = NumberParameter("slower_than", "m/s", 0.03, 0, 10, "speed over the last control step");
  return LessThanKind(
      "at_rest", "the object's origin hardly moves", "what rests", bound,
      [](const ObjectState& state) { return state.speed; }, "{} at {:.3f} m/s (< {:.3f})");
}

}  // namespace etude::task
