// SPDX-License-Identifier: Apache-2.0
#include "worker/plan/shortcut.h"

#include <algorithm>
#include <utility>

namespace etude::plan::internal {
namespace {

// of the path's length: looking for collisions along a piece costs more than a smaller gain is worth
constexpr double kLeastGain = 0.005;

// A place on a polyline: the segment that ends at point `end`, and the point on it.
struct Place {
  std::size_t end = 1;
  Eigen::VectorXd q;
};

Place PlaceAt(const std::vector<Eigen::VectorXd>& path, double along) {
  for (std::size_t end = 1; end < path.size(); ++end) {
    const double span = (path[end] - path[end - 1]).norm();
    if (along <= span || end + 1 == path.size()) {
      const double part = span > 0 ? std::min(1.0, along / span) : 0;
      return {end, path[end - 1] + (path[end] - path[end - 1]) * part};
    }
    along -= span;
  }
  return {path.size() - 1, path.back()};
}

}  // namespace

double Length(const std::vector<Eigen::VectorXd>& path) {
  double length = 0;
  for (std::size_t i = 1; i < path.size(); ++i) length += (path[i] - path[i - 1]).norm();
  return length;
}

std::vector<Eigen::VectorXd> Shortcut(
    std::vector<Eigen::VectorXd> path, int tries, Rng& rng,
    const std::function<bool(const Eigen::VectorXd&, const Eigen::VectorXd&)>& is_segment_free) {
  for (int i = 0; i < tries && path.size() > 2; ++i) {
    const double length = Length(path);
    double from_along = rng.Uniform(0, length), to_along = rng.Uniform(0, length);
    if (from_along > to_along) std::swap(from_along, to_along);
    const Place from = PlaceAt(path, from_along), to = PlaceAt(path, to_along);
    if (from.end == to.end) continue;
    const double saved = to_along - from_along - (to.q - from.q).norm();
    if (saved < kLeastGain * length || !is_segment_free(from.q, to.q)) continue;

    std::vector<Eigen::VectorXd> shorter(path.begin(), path.begin() + from.end);
    shorter.push_back(from.q);
    shorter.push_back(to.q);
    shorter.insert(shorter.end(), path.begin() + to.end, path.end());
    path = std::move(shorter);
  }
  return path;
}

}  // namespace etude::plan::internal
