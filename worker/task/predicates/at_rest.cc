// SPDX-License-Identifier: Apache-2.0
// at_rest: the object's origin hardly moves.
#include <fmt/format.h>

#include "worker/task/predicates/kind.h"

namespace etude::task {
namespace {

class AtRest final : public Predicate {
 public:
  explicit AtRest(const PredicateArguments& arguments)
      : object_(arguments.object("object")), slower_than_(arguments.number("slower_than")) {}

  bool Observe(const Observation& now) override {
    speed_ = StateOf(now, object_).speed;
    return speed_ < slower_than_;
  }
  std::string Words() const override {
    return fmt::format("{} at {:.3f} m/s (< {:.3f})", object_, speed_, slower_than_);
  }

 private:
  std::string object_;
  double slower_than_;
  double speed_ = 0;
};

}  // namespace

namespace kinds {

PredicateKind at_rest() {
  return {.name = "at_rest",
          .says = "the object's origin hardly moves",
          .parameters = {ObjectParameter("object", "target", "what rests"),
                         NumberParameter("slower_than", "m/s", 0.03, 0, 10, "speed over the last control step")},
          .make = [](PredicateArguments& arguments) { return std::make_unique<AtRest>(arguments); }};
}

}  // namespace kinds
}  // namespace etude::task
