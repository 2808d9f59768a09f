// SPDX-License-Identifier: Apache-2.0
// grasped: every group of fingers touches the object.
#include "worker/task/predicates/kinds.h"

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

PredicateKind kinds::grasped() {
  return KindOf<Grasped>("grasped", "every group of fingers touches the object",
                         {ObjectParameter("object", "target", "what is held")});
}

}  // namespace etude::task
