// SPDX-License-Identifier: Apache-2.0
// turned: the object was turned over about the world's x, either way.
#include <numbers>

#include "worker/task/predicates/geometry.h"
#include "worker/task/predicates/kinds.h"
#include "worker/task/predicates/less_than.h"

namespace etude::task {

PredicateKind kinds::turned() {
  return {.name = "turned",
          .says = "the object is turned about the world's x against how it stood, either way",
          .parameters = {ObjectParameter("object", "target", "what turns"),
                         NumberParameter("by", "rad", std::numbers::pi / 2, 0, 3.2, "by this much,"),
                         NumberParameter("within", "rad", 0.5, 0, 3.2, "norm of the Euler error")},
          .make = [](PredicateArguments& arguments) -> std::unique_ptr<Predicate> {
            const double by = arguments.number("by");
            return std::make_unique<LessThan>(
                arguments.object("object"),
                [by](const ObjectState& state) { return TurnError(state.X_WO, state.X_WO_start, by); },
                arguments.number("within"), "{} {:.2f} rad off its turn (< {:.2f})");
          }};
}

}  // namespace etude::task
