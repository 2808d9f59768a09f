// SPDX-License-Identifier: Apache-2.0
// all: every child holds now.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "worker/task/predicates/kinds.h"

namespace etude::task {
namespace {

class All final : public Predicate {
 public:
  explicit All(PredicateArguments& arguments)
      : children_(std::move(arguments.children())), holds_(children_.size(), false) {}

  bool Observe(const Observation& now) override {
    bool all = true;
    for (std::size_t i = 0; i < children_.size(); ++i) all &= holds_[i] = children_[i]->Observe(now);
    return all;
  }
  std::string Words() const override {
    std::vector<std::string> missing;
    for (std::size_t i = 0; i < children_.size(); ++i)
      if (!holds_[i]) missing.push_back(children_[i]->Words());
    return missing.empty() ? "everything holds" : fmt::format("{}", fmt::join(missing, "; "));
  }

 private:
  std::vector<std::unique_ptr<Predicate>> children_;
  std::vector<bool> holds_;
};

}  // namespace

PredicateKind kinds::all() { return CombinationOf<All>("all", "every child holds now"); }

}  // namespace etude::task
