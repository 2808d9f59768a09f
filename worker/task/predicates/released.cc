// SPDX-License-Identifier: Apache-2.0
// released: no body of the robot touches the object.
#include "worker/task/predicates/kind.h"

namespace etude::task {
namespace {

class Released final : public Predicate {
 public:
  explicit Released(const PredicateArguments& arguments) : object_(arguments.object("object")) {}

  bool Observe(const Observation& now) override {
    touched_ = StateOf(now, object_).touched;
    return !touched_;
  }
  std::string Words() const override { return object_ + (touched_ ? " touched by the robot" : " released"); }

 private:
  std::string object_;
  bool touched_ = false;
};

}  // namespace

namespace kinds {

PredicateKind released() {
  return {.name = "released",
          .says = "no body of the robot touches the object",
          .parameters = {ObjectParameter("object", "target", "what is let go")},
          .make = [](PredicateArguments& arguments) { return std::make_unique<Released>(arguments); }};
}

}  // namespace kinds
}  // namespace etude::task
