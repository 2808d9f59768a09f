// SPDX-License-Identifier: Apache-2.0
// at_rest: the object's origin hardly moves.
#include "worker/task/predicates/kind.h"
#include "worker/task/predicates/less_than.h"

namespace etude::task::kinds {

PredicateKind at_rest() {
  return {.name = "at_rest",
          .says = "the object's origin hardly moves",
          .parameters = {ObjectParameter("object", "target", "what rests"),
                         NumberParameter("slower_than", "m/s", 0.03, 0, 10, "speed over the last control step")},
          .make = [](PredicateArguments& arguments) -> std::unique_ptr<Predicate> {
            return std::make_unique<LessThan>(
                arguments.object("object"), [](const ObjectState& state) { return state.speed; },
                arguments.number("slower_than"), "{} at {:.3f} m/s (< {:.3f})");
          }};
}

}  // namespace etude::task::kinds
