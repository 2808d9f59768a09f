// SPDX-License-Identifier: Apache-2.0
// grasped: every group of fingers touches the object.
#include "worker/task/predicates/kind.h"

namespace etude::task {
namespace {

class Grasped final : public Predicate {
 public:
  explicit Grasped(const PredicateArguments& arguments) : object_(arguments.object("object")) {}

  bool Observe(const Observation& now) override { return grasped_ = StateOf(now, object_).grasped; }
  std::string Words() const override { return object_ + (grasped_ ? " grasped" : " not grasped"); }

 private:
  std::string object_;
  bool grasped_ = false;
};

}  // namespace

namespace kinds {

PredicateKind grasped() {
  return {.name = "grasped",
          .says = "every group of fingers touches the object",
          .parameters = {ObjectParameter("object", "target", "what is held")},
          .make = [](PredicateArguments& arguments) { return std::make_unique<Grasped>(arguments); }};
}

}  // namespace kinds
}  // namespace etude::task
