// SPDX-License-Identifier: Apache-2.0
// low: the object's origin is near the table.
#include <fmt/format.h>

#include "worker/task/predicates/kind.h"

namespace etude::task {
namespace {

class Low final : public Predicate {
 public:
  explicit Low(const PredicateArguments& arguments)
      : object_(arguments.object("object")), below_(arguments.number("below")) {}

  bool Observe(const Observation& now) override {
    height_ = StateOf(now, object_).X_WO.p.z();
    return height_ < below_;
  }
  std::string Words() const override {
    return fmt::format("{}'s origin {:.3f} m above the table (< {:.3f})", object_, height_, below_);
  }

 private:
  std::string object_;
  double below_;
  double height_ = 0;
};

}  // namespace

namespace kinds {

PredicateKind low() {
  return {.name = "low",
          .says = "the object's origin is near the table",
          .parameters = {ObjectParameter("object", "target", "what is low"),
                         NumberParameter("below", "m", 0.08, 0, 2, "lower than this")},
          .make = [](PredicateArguments& arguments) { return std::make_unique<Low>(arguments); }};
}

}  // namespace kinds
}  // namespace etude::task
