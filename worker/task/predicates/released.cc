// SPDX-License-Identifier: Apache-2.0
// released: no body of the robot touches the object.
#include "worker/task/predicates/kinds.h"

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

PredicateKind kinds::released() {
  return KindOf<Released>("released", "no body of the robot touches the object",
                          {ObjectParameter("object", "target", "what is let go")});
}

}  // namespace etude::task
