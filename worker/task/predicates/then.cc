// SPDX-License-Identifier: Apache-2.0
// then: the children held one after another, and the last one holds now.
#include <fmt/format.h>

#include "worker/task/predicates/kinds.h"

namespace etude::task {
namespace {

// A child's turn comes once the one before it has held, at the same step at the earliest. All of them see every step,
// so that those with a memory know the past.
class Then final : public Predicate {
 public:
  explicit Then(PredicateArguments& arguments) : children_(std::move(arguments.children())) {}

  bool Observe(const Observation& now) override {
    bool last = false;
    for (std::size_t i = 0; i < children_.size(); ++i) {
      const bool holds = children_[i]->Observe(now);
      if (i + 1 == children_.size()) {
        last = holds && turn_ == i;
      } else if (turn_ == i && holds) {
        ++turn_;
      }
    }
    return last;
  }
  std::string Words() const override { return children_[turn_]->Words(); }

 private:
  std::vector<std::unique_ptr<Predicate>> children_;
  std::size_t turn_ = 0;
};

}  // namespace

PredicateKind kinds::then() {
  return CombinationOf<Then>("then", "the children held one after another, and the last one holds now");
}

}  // namespace etude::task
