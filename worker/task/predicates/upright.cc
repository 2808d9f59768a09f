// SPDX-License-Identifier: Apache-2.0
// upright: the object's vertical axis is near the world's.
#include <numbers>

#include "worker/task/predicates/geometry.h"
#include "worker/task/predicates/kind.h"
#include "worker/task/predicates/less_than.h"

namespace etude::task::kinds {

PredicateKind upright() {
  return {.name = "upright",
          .says = "the object's vertical axis is near the world's",
          .parameters = {ObjectParameter("object", "target", "what stands"),
                         NumberParameter("within", "rad", std::numbers::pi / 6, 0, 3.2, "tilted by less than this")},
          .make = [](PredicateArguments& arguments) -> std::unique_ptr<Predicate> {
            return std::make_unique<LessThan>(
                arguments.object("object"), [](const ObjectState& state) { return TiltOf(state.X_WO); },
                arguments.number("within"), "{} tilted by {:.2f} rad (< {:.2f})");
          }};
}

}  // namespace etude::task::kinds
