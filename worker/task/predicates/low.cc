// SPDX-License-Identifier: Apache-2.0
// low: the object's origin is near the table.
#include "worker/task/predicates/kind.h"
#include "worker/task/predicates/less_than.h"

namespace etude::task::kinds {

PredicateKind low() {
  return {.name = "low",
          .says = "the object's origin is near the table",
          .parameters = {ObjectParameter("object", "target", "what is low"),
                         NumberParameter("below", "m", 0.08, 0, 2, "lower than this")},
          .make = [](PredicateArguments& arguments) -> std::unique_ptr<Predicate> {
            return std::make_unique<LessThan>(
                arguments.object("object"), [](const ObjectState& state) { return state.X_WO.p.z(); },
                arguments.number("below"), "{}'s origin {:.3f} m above the table (< {:.3f})");
          }};
}

}  // namespace etude::task::kinds
