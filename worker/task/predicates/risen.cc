// SPDX-License-Identifier: Apache-2.0
// risen: the object's origin is higher than where it stood, or higher above the table.
#include <fmt/format.h>

#include "worker/task/predicates/kinds.h"

namespace etude::task {
namespace {

class Risen final : public Predicate {
 public:
  explicit Risen(const PredicateArguments& arguments)
      : object_(arguments.object("object")), by_(arguments.number("by")), start_(arguments.word("from") == "start") {}

  bool Observe(const Observation& now) override {
    const ObjectState& state = StateOf(now, object_);
    height_ = state.X_WO.p.z() - (start_ ? state.X_WO_start.p.z() : 0);
    return height_ > by_;
  }
  std::string Words() const override {
    return fmt::format("{} {} by {:.3f} m (> {:.3f})", object_, start_ ? "risen" : "above the table", height_, by_);
  }

 private:
  std::string object_;
  double by_;
  bool start_;
  double height_ = 0;
};

}  // namespace

PredicateKind kinds::risen() {
  return KindOf<Risen>(
      "risen", "the object's origin is higher than where it stood",
      {ObjectParameter("object", "target", "what rises"), NumberParameter("by", "m", 0.03, 0, 2, "by more than this"),
       WordParameter("from", {"start", "table"}, "above its own start, or above the table")});
}

}  // namespace etude::task
