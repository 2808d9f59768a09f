// SPDX-License-Identifier: Apache-2.0
// beside: the object is on one side of another, as seen in the picture.
#include <fmt/format.h>

#include <cmath>

#include "worker/task/predicates/geometry.h"
#include "worker/task/predicates/kinds.h"

namespace etude::task {
namespace {

class Beside final : public Predicate {
 public:
  explicit Beside(const PredicateArguments& arguments)
      : object_(arguments.object("object")),
        of_(arguments.object("of")),
        side_(arguments.word("side")),
        bounds_{arguments.number("near"), arguments.number("far"), arguments.number("aside")} {}

  bool Observe(const Observation& now) override {
    const Eigen::Vector3d p_WO = StateOf(now, object_).X_WO.p, p_WR = StateOf(now, of_).X_WO.p;
    const Eigen::Vector3d d = p_WO - p_WR;
    along_ = d.dot(DirectionOfSide(side_));
    aside_ = d.cross(DirectionOfSide(side_)).z();
    return IsOnSide(side_, p_WO, p_WR, bounds_);
  }
  std::string Words() const override {
    return fmt::format("{} {} of {} by {:.3f} m ({:.2f}..{:.2f}), {:.3f} m off (< {:.2f})", object_, side_, of_, along_,
                       bounds_.near, bounds_.far, std::abs(aside_), bounds_.aside);
  }

 private:
  std::string object_, of_, side_;
  BesideBounds bounds_;
  double along_ = 0, aside_ = 0;
};

}  // namespace

PredicateKind kinds::beside() {
  const BesideBounds bounds;
  return KindOf<Beside>(
      "beside", "the object is on one side of another, as seen in the picture",
      {ObjectParameter("object", "target", "what is placed"), ObjectParameter("of", "reference", "beside what"),
       WordParameter("side", Sides(), "front is towards the camera"),
       NumberParameter("near", "m", bounds.near, 0, 1, "origins at least so far apart that way,"),
       NumberParameter("far", "m", bounds.far, 0, 1, "at most so far,"),
       NumberParameter("aside", "m", bounds.aside, 0, 1, "and at most so far across it")});
}

}  // namespace etude::task
