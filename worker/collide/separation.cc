// SPDX-License-Identifier: Apache-2.0
#include "worker/collide/separation.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace etude::collide {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

constexpr double kGood = 1e-5;      ///< m, what a distance may be off
constexpr int kIterations = 200;    ///< of the search for nearest points; flat shapes need about 5
constexpr double kTight = 1e-7;     ///< m, where that search ends
constexpr std::size_t kStarts = 6;  ///< places to search from for the direction along which an overlap is shortest
constexpr int kDescents = 40;       ///< steps of each

/// Two shapes in their places.
struct Pair {
  const Shape& a;
  const Isometry3d& X_WA;
  const Shape& b;
  const Isometry3d& X_WB;

  Vector3d FarA(const Vector3d& n) const { return X_WA * a.Support(X_WA.linear().transpose() * n); }
  Vector3d FarB(const Vector3d& n) const { return X_WB * b.Support(X_WB.linear().transpose() * n); }
  /// Gap along the unit vector n, from B to A: at most their distance, and equal to it for the right n.
  double Gap(const Vector3d& n) const { return n.dot(FarA(-n) - FarB(n)); }
};

// Whether p_WA and p_WB, of the shapes, are the nearest: a plane between the shapes must prove it.
bool Certified(const Pair& pair, const Vector3d& p_WA, const Vector3d& p_WB) {
  const double distance = (p_WA - p_WB).norm();
  return distance > 0 && distance - pair.Gap((p_WA - p_WB) / distance) <= std::min(kGood, 0.1 * distance);
}

Separation Apart(const Vector3d& p_WA, const Vector3d& p_WB) {
  const double distance = (p_WA - p_WB).norm();
  return {distance, p_WA, p_WB, (p_WA - p_WB) / distance};
}

/// Points of A minus points of B: where it is nearest to the origin, the shapes are nearest to each other.
struct Corner {
  Vector3d p_WA, p_WB;
  Vector3d difference() const { return p_WA - p_WB; }
};

struct Simplex {
  std::array<Corner, 4> corners;
  std::array<double, 4> weights{};
  int size = 0;

  Corner Nearest() const {
    Corner sum{Vector3d::Zero(), Vector3d::Zero()};
    for (int i = 0; i < size; ++i) {
      sum.p_WA += weights[i] * corners[i].p_WA;
      sum.p_WB += weights[i] * corners[i].p_WB;
    }
    return sum;
  }
};

// The point of the affine hull of the corners in `subset` that is nearest to the origin, as weights; false when it is
// not inside of their convex hull.
bool NearestOf(const Simplex& simplex, const std::array<int, 4>& subset, int count, std::array<double, 4>& weights) {
  weights = {1, 0, 0, 0};
  if (count == 1) return true;
  const Vector3d origin = simplex.corners[subset[0]].difference();
  Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, 3> edges(3, count - 1);
  for (int i = 1; i < count; ++i) edges.col(i - 1) = simplex.corners[subset[i]].difference() - origin;
  const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 3, 3> normal = edges.transpose() * edges;
  const Eigen::FullPivLU<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 3, 3>> lu(normal);
  if (lu.rank() < count - 1) return false;
  const Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 3, 1> along = lu.solve(-edges.transpose() * origin);
  weights[0] = 1 - along.sum();
  for (int i = 1; i < count; ++i) weights[i] = along[i - 1];
  for (int i = 0; i < count; ++i)
    if (!(weights[i] > -1e-12)) return false;
  return true;
}

// Leaves the corners that carry the point of the simplex nearest to the origin. At most 15 subsets: all are tried,
// which no degenerate simplex can upset.
void Reduce(Simplex& simplex) {
  double least = std::numeric_limits<double>::infinity();
  Simplex best;
  for (int mask = 1; mask < (1 << simplex.size); ++mask) {
    std::array<int, 4> subset{};
    int count = 0;
    for (int i = 0; i < simplex.size; ++i)
      if ((mask >> i) & 1) subset[count++] = i;
    Simplex candidate;
    if (!NearestOf(simplex, subset, count, candidate.weights)) continue;
    for (int i = 0; i < count; ++i) candidate.corners[i] = simplex.corners[subset[i]];
    candidate.size = count;
    const double norm = candidate.Nearest().difference().norm();
    if (norm >= least) continue;
    least = norm;
    best = candidate;
  }
  simplex = best;
}

// Source: Gilbert, Johnson & Keerthi 1988, with all faces of the simplex tried. Nothing when the shapes overlap.
std::optional<Corner> FindNearest(const Pair& pair) {
  Simplex simplex;
  simplex.corners[0] = {pair.FarA(Vector3d::UnitX()), pair.FarB(-Vector3d::UnitX())};
  simplex.size = 1;
  simplex.weights[0] = 1;
  for (int i = 0; i < kIterations; ++i) {
    const Vector3d v = simplex.Nearest().difference();
    const double distance = v.norm();
    if (distance < kTight || simplex.size == 4) return std::nullopt;
    const Vector3d n = v / distance;
    const Corner further{pair.FarA(-n), pair.FarB(n)};
    if (distance - n.dot(further.difference()) < kTight) break;
    simplex.corners[simplex.size++] = further;
    Reduce(simplex);
    if (simplex.Nearest().difference().norm() >= distance) break;  // as near as the numbers tell
  }
  return simplex.Nearest();
}

// Turns n to where the overlap along it is shortest nearby: down the gradient, which is where the overlap ends.
void Descend(const Pair& pair, Vector3d& n, double& depth) {
  double step = 1;
  for (int i = 0; i < kDescents; ++i) {
    const Vector3d reach = pair.FarB(n) - pair.FarA(-n);
    const Vector3d slope = reach - n * n.dot(reach);
    const double size = slope.norm();
    if (size < 1e-9) return;
    const Vector3d turned = (n - slope * (step * std::min(1.0, depth / (size * size)))).normalized();
    const double less = -pair.Gap(turned);
    if (less < depth) {
      n = turned;
      depth = less;
    } else {
      step /= 2;
    }
  }
}

// Directions to start from: FCL's, from centre to centre, those of faces, and 26 all around.
std::vector<Vector3d> WorthALook(const Pair& pair, const internal::FclContact& contact) {
  std::vector<Vector3d> directions{contact.normal, pair.X_WA.translation() - pair.X_WB.translation()};
  for (const Vector3d& normal : pair.a.FaceNormals())
    for (const double sign : {1.0, -1.0}) directions.push_back(sign * (pair.X_WA.linear() * normal));
  for (const Vector3d& normal : pair.b.FaceNormals())
    for (const double sign : {1.0, -1.0}) directions.push_back(sign * (pair.X_WB.linear() * normal));
  for (int i = 0; i < 27; ++i) directions.emplace_back(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1);
  return directions;
}

// Overlapping shapes: the direction that parts them soonest, found downhill from the best of those worth a look.
Separation Overlap(const Pair& pair, const internal::FclContact& contact) {
  struct Start {
    double depth;
    Vector3d n;
  };
  std::vector<Start> starts;
  for (const Vector3d& direction : WorthALook(pair, contact)) {
    if (direction.norm() < 1e-9) continue;
    const Vector3d n = direction.normalized();
    starts.push_back({-pair.Gap(n), n});
  }
  std::ranges::stable_sort(starts, {}, &Start::depth);
  Start best = starts.front();
  for (std::size_t i = 0; i < kStarts && best.depth > 0; ++i) {
    Descend(pair, starts[i].n, starts[i].depth);
    if (starts[i].depth < best.depth) best = starts[i];
  }
  const Vector3d half = best.n * (best.depth / 2);
  return {-best.depth, contact.p_W - half, contact.p_W + half, best.n};
}

}  // namespace

Separation Separate(const Shape& a, const Isometry3d& X_WA, const Shape& b, const Isometry3d& X_WB) {
  const Pair pair{a, X_WA, b, X_WB};
  // its points can be right where its number is not, and the other way round
  const auto answer = internal::AskDistance(a, X_WA, b, X_WB);
  if (answer && Certified(pair, answer->p_WA, answer->p_WB)) return Apart(answer->p_WA, answer->p_WB);
  if (const auto contact = internal::AskContact(a, X_WA, b, X_WB)) {
    const Separation overlap = Overlap(pair, *contact);
    if (overlap.distance < 0) return overlap;
  }
  if (const auto nearest = FindNearest(pair)) return Apart(nearest->p_WA, nearest->p_WB);
  return Overlap(pair, {(X_WA.translation() + X_WB.translation()) / 2, Vector3d::Zero()});
}

double Distance(const Shape& a, const Isometry3d& X_WA, const Shape& b, const Isometry3d& X_WB) {
  if (Touch(a, X_WA, b, X_WB)) return 0;
  return std::max(0.0, Separate(a, X_WA, b, X_WB).distance);
}

}  // namespace etude::collide
