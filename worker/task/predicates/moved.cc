// SPDX-License-Identifier: Apache-2.0
// moved: the object's origin is away from where it stood, along a direction or in any.
#include <fmt/format.h>

#include "worker/task/predicates/geometry.h"
#include "worker/task/predicates/kinds.h"

namespace etude::task {
namespace {

Eigen::Vector3d DirectionOf(const std::string& along) {
  if (along == "any") return Eigen::Vector3d::Zero();
  if (along == "+x") return Eigen::Vector3d::UnitX();
  if (along == "-x") return -Eigen::Vector3d::UnitX();
  if (along == "+y") return Eigen::Vector3d::UnitY();
  if (along == "-y") return -Eigen::Vector3d::UnitY();
  return DirectionOfSide(along);
}

class Moved final : public Predicate {
 public:
  explicit Moved(const PredicateArguments& arguments)
      : object_(arguments.object("object")),
        by_(arguments.number("by")),
        along_(arguments.word("along")),
        direction_(DirectionOf(along_)) {}

  bool Observe(const Observation& now) override {
    const ObjectState& state = StateOf(now, object_);
    const Eigen::Vector3d moved = state.X_WO.p - state.X_WO_start.p;
    distance_ = direction_.isZero() ? moved.norm() : moved.dot(direction_);
    return distance_ > by_;
  }
  std::string Words() const override {
    return fmt::format("{} moved along {} by {:.3f} m (> {:.3f})", object_, along_, distance_, by_);
  }

 private:
  std::string object_;
  double by_;
  std::string along_;
  Eigen::Vector3d direction_;
  double distance_ = 0;
};

}  // namespace

PredicateKind kinds::moved() {
  std::vector<std::string> directions{"any", "+x", "-x", "+y", "-y"};
  directions.insert(directions.end(), Sides().begin(), Sides().end());
  return KindOf<Moved>(
      "moved", "the object's origin is away from where it stood",
      {ObjectParameter("object", "target", "what moves"), NumberParameter("by", "m", 0.03, 0, 2, "by more than this"),
       WordParameter("along", directions, "in this direction of the world or of the picture")});
}

}  // namespace etude::task
