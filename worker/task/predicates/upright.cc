// SPDX-License-Identifier: Apache-2.0
// upright: the object's vertical axis is near the world's.
#include <numbers>

#include "worker/task/predicates/geometry.h"
#include "worker/task/predicates/kinds.h"
#include "worker/task/predicates/less_than.h"

namespace etude::task {

PredicateKind kinds::upright() {
  const auto bound = NumberParameter("within", "rad", std::numbers::pi / 6, 0, 3.2, "tilted by less than this");
  return LessThanKind(
      "upright", "the object's vertical axis is near the world's", "what stands", bound,
      [](const ObjectState& state) { return TiltOf(state.X_WO); }, "{} tilted by {:.2f} rad (< {:.2f})");
}

}  // namespace etude::task
