// SPDX-License-Identifier: Apache-2.0
#include "worker/plan/joint_curve.h"

#include <algorithm>
#include <cmath>

#include "services/core/check.h"

namespace etude::plan::internal {

JointCurve::JointCurve(const std::vector<Eigen::VectorXd>& polyline, double spacing) {
  ETUDE_CHECK(polyline.size() >= 2 && spacing > 0, "{} points, spacing {}", polyline.size(), spacing);
  for (std::size_t i = 1; i < polyline.size(); ++i) length_ += (polyline[i] - polyline[i - 1]).norm();
  const int spans = std::max(3, static_cast<int>(std::ceil(length_ / spacing)));

  // control points at equal distances along the polyline
  controls_.push_back(polyline.front());
  std::size_t segment = 1;
  double passed = 0;  // length of the segments before this one
  for (int i = 0; i <= spans; ++i) {
    const double wanted = length_ * i / spans;
    double span = (polyline[segment] - polyline[segment - 1]).norm();
    while (passed + span < wanted && segment + 1 < polyline.size()) {
      passed += span;
      ++segment;
      span = (polyline[segment] - polyline[segment - 1]).norm();
    }
    const double part = span > 0 ? std::min(1.0, (wanted - passed) / span) : 0;
    controls_.push_back(polyline[segment - 1] + (polyline[segment] - polyline[segment - 1]) * part);
  }
  controls_.back() = polyline.back();

  // mirrored points beyond the ends make the curve start and end on the polyline
  controls_.front() = 2 * controls_[1] - controls_[2];
  controls_.push_back(2 * controls_.back() - controls_[controls_.size() - 2]);
}

JointCurve::State JointCurve::At(double u) const {
  const int spans = static_cast<int>(controls_.size()) - 3;
  const double along = std::clamp(u, 0.0, 1.0) * spans;
  const int i = std::min(static_cast<int>(along), spans - 1);
  const double t = along - i, r = 1 - t;
  const auto combine = [&](double a, double b, double c, double d) -> Eigen::VectorXd {
    return a * controls_[i] + b * controls_[i + 1] + c * controls_[i + 2] + d * controls_[i + 3];
  };
  State state;
  state.q =
      combine(r * r * r / 6, (3 * t * t * t - 6 * t * t + 4) / 6, (3 * r * r * r - 6 * r * r + 4) / 6, t * t * t / 6);
  state.dq = spans * combine(-r * r / 2, (3 * t * t - 4 * t) / 2, (-3 * r * r + 4 * r) / 2, t * t / 2);
  state.ddq = spans * spans * combine(r, 3 * t - 2, 3 * r - 2, t);
  return state;
}

}  // namespace etude::plan::internal
