// SPDX-License-Identifier: Apache-2.0
// upright: the object's vertical axis is near the world's.
#include <fmt/format.h>

#include <numbers>

#include "worker/task/predicates/geometry.h"
#include "worker/task/predicates/kind.h"

namespace etude::task {
namespace {

class Upright final : public Predicate {
 public:
  explicit Upright(const PredicateArguments& arguments)
      : object_(arguments.object("object")), within_(arguments.number("within")) {}

  bool Observe(const Observation& now) override {
    tilt_ = TiltOf(StateOf(now, object_).X_WO);
    return tilt_ < within_;
  }
  std::string Words() const override {
    return fmt::format("{} tilted by {:.2f} rad (< {:.2f})", object_, tilt_, within_);
  }

 private:
  std::string object_;
  double within_;
  double tilt_ = 0;
};

}  // namespace

namespace kinds {

PredicateKind upright() {
  return {.name = "upright",
          .says = "the object's vertical axis is near the world's",
          .parameters = {ObjectParameter("object", "target", "what stands"),
                         NumberParameter("within", "rad", std::numbers::pi / 6, 0, 3.2, "tilted by less than this")},
          .make = [](PredicateArguments& arguments) { return std::make_unique<Upright>(arguments); }};
}

}  // namespace kinds
}  // namespace etude::task
