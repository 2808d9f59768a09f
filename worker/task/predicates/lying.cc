// SPDX-License-Identifier: Apache-2.0
// lying: the object's vertical axis is near the horizontal and its origin is low.
#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "worker/task/predicates/geometry.h"
#include "worker/task/predicates/kinds.h"

namespace etude::task {
namespace {

class Lying final : public Predicate {
 public:
  explicit Lying(const PredicateArguments& arguments)
      : object_(arguments.object("object")), within_(arguments.number("within")), below_(arguments.number("below")) {}

  bool Observe(const Observation& now) override {
    const Pose& X_WO = StateOf(now, object_).X_WO;
    slope_ = std::abs(TiltOf(X_WO) - std::numbers::pi / 2);
    height_ = X_WO.p.z();
    return slope_ < within_ && height_ < below_;
  }
  std::string Words() const override {
    return fmt::format("{} {:.2f} rad off lying (< {:.2f}), its origin {:.3f} m above the table (< {:.3f})", object_,
                       slope_, within_, height_, below_);
  }

 private:
  std::string object_;
  double within_, below_;
  double slope_ = 0, height_ = 0;
};

}  // namespace

PredicateKind kinds::lying() {
  return KindOf<Lying>("lying", "the object lies on its side on the table",
                       {ObjectParameter("object", "target", "what lies"),
                        // a lying cone (a pear) leans that much
                        NumberParameter("within", "rad", 0.7, 0, 1.6, "its axis is so near to the horizontal"),
                        NumberParameter("below", "m", 0.08, 0, 1, "its origin is lower than this")});
}

}  // namespace etude::task
