// SPDX-License-Identifier: Apache-2.0
// on: the object stands on another one and on nothing else.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "worker/task/predicates/geometry.h"
#include "worker/task/predicates/kinds.h"

namespace etude::task {
namespace {

class On final : public Predicate {
 public:
  explicit On(const PredicateArguments& arguments)
      : object_(arguments.object("object")),
        of_(arguments.object("of")),
        aside_(arguments.number("aside")),
        within_(arguments.number("within")) {}

  bool Observe(const Observation& now) override {
    const ObjectState& upper = StateOf(now, object_);
    const ObjectState& lower = StateOf(now, of_);
    const Eigen::Vector3d p_upper = upper.X_WO * upper.centre, p_lower = lower.X_WO * lower.centre;
    gap_ = p_upper.z() - HalfHeight(upper.half_extent, upper.X_WO.q) - p_lower.z() -
           HalfHeight(lower.half_extent, lower.X_WO.q);
    off_ = (p_upper - p_lower).head<2>().norm();
    const auto touches = [&](const char* body) {
      return std::ranges::find(upper.contacts, body) != upper.contacts.end();
    };
    touches_ = touches(of_.c_str());
    return touches_ && !touches("world") && std::abs(gap_) < within_ && off_ < aside_;
  }
  std::string Words() const override {
    return fmt::format("{} {:.3f} m above {} (+-{:.3f}), {:.3f} m off its middle (< {:.3f}){}", object_, gap_, of_,
                       within_, off_, aside_, touches_ ? "" : ", not touching it");
  }

 private:
  std::string object_, of_;
  double aside_, within_;
  double gap_ = 0, off_ = 0;
  bool touches_ = false;
};

}  // namespace

PredicateKind kinds::on() {
  return KindOf<On>(
      "on", "the object stands on another one and not on the table",
      {ObjectParameter("object", "target", "what is placed"), ObjectParameter("of", "reference", "on what"),
       NumberParameter("aside", "m", 0.03, 0, 1, "middles at most so far apart, seen from above"),
       NumberParameter("within", "m", 0.01, 0, 0.1, "between the one's lowest and the other's top")});
}

}  // namespace etude::task
