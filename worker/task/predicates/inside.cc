// SPDX-License-Identifier: Apache-2.0
// inside: the object's middle is within another's walls and its lowest point below the rim.
#include <fmt/format.h>

#include "worker/task/predicates/geometry.h"
#include "worker/task/predicates/kinds.h"

namespace etude::task {
namespace {

class Inside final : public Predicate {
 public:
  explicit Inside(const PredicateArguments& arguments)
      : object_(arguments.object("object")), of_(arguments.object("of")), deep_(arguments.number("deep")) {}

  bool Observe(const Observation& now) override {
    const ObjectState& inner = StateOf(now, object_);
    const ObjectState& outer = StateOf(now, of_);
    const Eigen::Vector3d p_WI = inner.X_WO * inner.centre;
    const Eigen::Vector3d p_OI = outer.X_WO.inverse() * p_WI - outer.centre;
    out_ = (p_OI.head<2>().cwiseAbs() - outer.half_extent.head<2>()).maxCoeff();
    const double rim = (outer.X_WO * outer.centre).z() + HalfHeight(outer.half_extent, outer.X_WO.q);
    below_ = rim - (p_WI.z() - HalfHeight(inner.half_extent, inner.X_WO.q));
    return out_ < 0 && below_ > deep_;
  }
  std::string Words() const override {
    return fmt::format("{} {:.3f} m below the rim of {} (> {:.3f}), its middle {:.3f} m {} it", object_, below_, of_,
                       deep_, std::abs(out_), out_ < 0 ? "within" : "outside");
  }

 private:
  std::string object_, of_;
  double deep_;
  double out_ = 0, below_ = 0;
};

}  // namespace

PredicateKind kinds::inside() {
  return KindOf<Inside>(
      "inside", "the object's middle is within another's walls and its lowest point below the rim",
      {ObjectParameter("object", "target", "what is dropped in"), ObjectParameter("of", "reference", "into what"),
       NumberParameter("deep", "m", 0.01, 0, 1, "its lowest point is more than this below the rim")});
}

}  // namespace etude::task
