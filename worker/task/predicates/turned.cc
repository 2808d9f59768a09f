// SPDX-License-Identifier: Apache-2.0
// turned: the object was turned over about the world's x, either way.
#include <fmt/format.h>

#include <numbers>

#include "worker/task/predicates/geometry.h"
#include "worker/task/predicates/kind.h"

namespace etude::task {
namespace {

class Turned final : public Predicate {
 public:
  explicit Turned(const PredicateArguments& arguments)
      : object_(arguments.object("object")), by_(arguments.number("by")), within_(arguments.number("within")) {}

  bool Observe(const Observation& now) override {
    const ObjectState& state = StateOf(now, object_);
    error_ = TurnError(state.X_WO, state.X_WO_start, by_);
    return error_ < within_;
  }
  std::string Words() const override {
    return fmt::format("{} {:.2f} rad off its turn (< {:.2f})", object_, error_, within_);
  }

 private:
  std::string object_;
  double by_, within_;
  double error_ = 0;
};

}  // namespace

namespace kinds {

PredicateKind turned() {
  return {.name = "turned",
          .says = "the object is turned about the world's x against how it stood, either way",
          .parameters = {ObjectParameter("object", "target", "what turns"),
                         NumberParameter("by", "rad", std::numbers::pi / 2, 0, 3.2, "by this much,"),
                         NumberParameter("within", "rad", 0.5, 0, 3.2, "norm of the Euler error")},
          .make = [](PredicateArguments& arguments) { return std::make_unique<Turned>(arguments); }};
}

}  // namespace kinds
}  // namespace etude::task
