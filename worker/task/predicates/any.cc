// SPDX-License-Identifier: Apache-2.0
// any: some child holds now.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "worker/task/predicates/kinds.h"

namespace etude::task {
namespace {

class Any final : public Predicate {
 public:
  explicit Any(PredicateArguments& arguments) : children_(std::move(arguments.children())) {}

  bool Observe(const Observation& now) override {
    bool any = false;
    for (const auto& child : children_) any |= child->Observe(now);  // each sees every step
    return any;
  }
  std::string Words() const override {
    std::vector<std::string> words;
    for (const auto& child : children_) words.push_back(child->Words());
    return fmt::format("either {}", fmt::join(words, " or "));
  }

 private:
  std::vector<std::unique_ptr<Predicate>> children_;
};

}  // namespace

PredicateKind kinds::any() { return CombinationOf<Any>("any", "some child holds now"); }

}  // namespace etude::task
