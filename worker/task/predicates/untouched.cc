// SPDX-License-Identifier: Apache-2.0
// untouched: objects never were away from where they stood.
#include <fmt/format.h>

#include <algorithm>

#include "worker/task/predicates/kinds.h"

namespace etude::task {
namespace {

class Untouched final : public Predicate {
 public:
  explicit Untouched(const PredicateArguments& arguments)
      : objects_(arguments.objects("objects")), within_(arguments.number("within")) {}

  bool Observe(const Observation& now) override {
    for (const auto& object : objects_) {
      const ObjectState& state = StateOf(now, object);
      const double distance = (state.X_WO.p - state.X_WO_start.p).norm();
      if (distance <= most_) continue;
      most_ = distance;
      which_ = object;
    }
    return most_ <= within_;
  }
  std::string Words() const override {
    if (which_.empty()) return "nothing moved";
    return fmt::format("{} was moved by {:.3f} m (<= {:.3f})", which_, most_, within_);
  }

 private:
  std::vector<std::string> objects_;
  double within_;
  double most_ = 0;
  std::string which_;
};

}  // namespace

PredicateKind kinds::untouched() {
  return KindOf<Untouched>("untouched", "the objects never were away from where they stood",
                           {ObjectsParameter("objects", "others", "others: all but target and reference"),
                            NumberParameter("within", "m", 0.02, 0, 1, "at most so far, from the first step on")});
}

}  // namespace etude::task
