// SPDX-License-Identifier: Apache-2.0
// low: the object's origin is near the table.
#include "worker/task/predicates/kinds.h"
#include "worker/task/predicates/less_than.h"

namespace etude::task {

PredicateKind kinds::low() {
  const auto bound = NumberParameter("below", "m", 0.08, 0, 2, "lower than this");
  return LessThanKind(
      "low", "the object's origin is near the table", "what is low", bound,
      [](const ObjectState& state) { return state.X_WO.p.z(); }, "{}'s origin {:.3f} m above the table (< {:.3f})");
}

}  // namespace etude::task
