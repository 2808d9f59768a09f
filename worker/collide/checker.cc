// SPDX-License-Identifier: Apache-2.0
#include "worker/collide/checker.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <map>

#include "services/core/check.h"
#include "worker/collide/pieces.h"
#include "worker/collide/self_pairs.h"
#include "worker/collide/separation.h"

namespace etude::collide {

using internal::ArmStructure;
using internal::Piece;
using internal::Role;

struct Checker::Impl {
  using PiecePair = std::pair<int, int>;

  explicit Impl(std::shared_ptr<const sim::Scene> scene_in);

  void AddPieces();
  void PlaceStatics();
  void FindSelfPairs();
  bool BodiesTouch(int a, int b) const;
  void RebuildPairs();
  void AddPairsOf(int piece);
  bool ArmMayTouch(const Piece& arm_piece, const Piece& other) const;
  bool HeldMayTouch(const Piece& other) const;
  void PlaceArm(const Eigen::VectorXd& q);
  void PlaceArm(const std::vector<Pose>& poses);
  void FindSelfPiecePairs();
  void SetMargin(double margin);
  std::optional<PiecePair> FindCollision(const Eigen::VectorXd& q, double new_margin);
  Collision Describe(PiecePair pair) const;
  bool IsHeld(const Piece& piece) const { return !held.empty() && piece.body_name() == held; }

  std::shared_ptr<const sim::Scene> scene;
  sim::Kinematics kinematics;
  ArmStructure structure;
  std::vector<Piece> pieces;  ///< of the arm first, from the tool to the base
  int arm_pieces = 0;
  Eigen::MatrixXi self_tested;          ///< by arm body; the last column is the world
  std::map<std::string, Pose> objects;  ///< X_WO of those that were set
  std::set<std::string> body_names;
  std::set<std::string> allowed;
  std::string held;
  Eigen::Isometry3d X_BO = Eigen::Isometry3d::Identity();  ///< held object in the tool's body
  double gripper = 0;
  double margin = 0;
  bool pairs_valid = false;
  std::vector<PiecePair> pairs;       ///< in the order they are tested
  std::vector<PiecePair> self_pairs;  ///< of the arm against itself; first those that are apart at home
  int apart_pairs = 0;                ///< how many those are
  int first_self_pair = 0;            ///< pairs from here on are self collision
  int first_held_pair = 0;            ///< and from here on what is held against the arm: both move
  std::uint64_t checks = 0;
};

Checker::Impl::Impl(std::shared_ptr<const sim::Scene> scene_in)
    : scene(std::move(scene_in)), kinematics(scene), structure(internal::FindStructure(scene->arm(), kinematics)) {
  AddPieces();
  PlaceStatics();
  FindSelfPairs();
  FindSelfPiecePairs();
}

void Checker::Impl::AddPieces() {
  const std::vector<std::string>& bodies = scene->arm().bodies;
  for (int body = static_cast<int>(bodies.size()) - 1; body >= 0; --body)
    for (const sim::Geometry& geometry : scene->geometry())
      if (geometry.body == bodies[body]) pieces.emplace_back(geometry, Role::kArm, body);
  arm_pieces = static_cast<int>(pieces.size());

  const std::set<std::string> arm_bodies(bodies.begin(), bodies.end());
  std::set<std::string> object_names;
  for (const sim::ObjectInfo& object : scene->objects()) object_names.insert(object.name);
  for (const sim::Geometry& geometry : scene->geometry()) {
    body_names.insert(geometry.body);
    if (arm_bodies.contains(geometry.body)) continue;
    const bool is_object = object_names.contains(geometry.body);
    pieces.emplace_back(geometry, is_object ? Role::kObject : Role::kStatic, -1);
  }
  body_names.insert(arm_bodies.begin(), arm_bodies.end());
}

void Checker::Impl::PlaceStatics() {
  const Eigen::VectorXd& q_home = scene->arm().q_home;
  for (Piece& piece : pieces) {
    if (piece.role() != Role::kStatic) continue;
    Pose X_WB;
    if (piece.body_name() != "world") X_WB = kinematics.BodyPoses(q_home, 0, {piece.body_name()}).front();
    piece.Place(internal::ToIsometry(X_WB));
  }
}

bool Checker::Impl::BodiesTouch(int a, int b) const {
  const int world = static_cast<int>(scene->arm().bodies.size());
  for (const Piece& first : pieces) {
    if (first.role() != Role::kArm || first.body() != a) continue;
    for (const Piece& second : pieces) {
      const bool of_b = b == world ? second.role() == Role::kStatic : second.role() == Role::kArm && second.body() == b;
      if (of_b && internal::Near(first, second, 0)) return true;
    }
  }
  return false;
}

// Leaves out pairs that the joints cannot bring together or that touch by construction: at most one
// joint between them, in touch at home, or in touch nearly everywhere.
void Checker::Impl::FindSelfPairs() {
  constexpr int kSamples = 64;
  const int n = static_cast<int>(scene->arm().bodies.size());
  self_tested = Eigen::MatrixXi::Zero(n, n + 1);
  Eigen::MatrixXi touches = Eigen::MatrixXi::Zero(n, n + 1);
  const auto for_pairs = [n](auto&& function) {
    for (int a = 0; a < n; ++a)
      for (int b = a + 1; b <= n; ++b) function(a, b);
  };

  for (const Eigen::VectorXd& q : internal::SpreadConfigurations(scene->arm(), kSamples)) {
    PlaceArm(q);
    for_pairs([&](int a, int b) { touches(a, b) += BodiesTouch(a, b) ? 1 : 0; });
  }
  for_pairs([&](int a, int b) {
    self_tested(a, b) = structure.joints_between(a, b) > 1 && touches(a, b) < kSamples * 95 / 100 ? 1 : 0;
    // a link that only turns on the base may hit the table, but not if it starts on it
    if (b == n && structure.joints_between(a, b) == 1) self_tested(a, b) = 1;
  });
  for (const double opening : {0.0, 1.0}) {
    gripper = opening;
    PlaceArm(scene->arm().q_home);
    for_pairs([&](int a, int b) {
      // a gripper that touches the table at home is an error of the scene, not a pair to leave out
      const bool fixed = b < n || structure.joints_between(a, b) <= 1;
      if (self_tested(a, b) == 1 && fixed && BodiesTouch(a, b)) self_tested(a, b) = 0;
    });
  }
  gripper = 0;
}

void Checker::Impl::PlaceArm(const Eigen::VectorXd& q) { PlaceArm(kinematics.ArmPoses(q, gripper)); }

void Checker::Impl::PlaceArm(const std::vector<Pose>& poses) {
  int body = -1;
  Eigen::Matrix3d R_WB;
  for (int i = 0; i < arm_pieces; ++i) {
    if (pieces[i].body() != body) {
      body = pieces[i].body();
      R_WB = poses[body].q.toRotationMatrix();
    }
    pieces[i].Place(R_WB, poses[body].p);
  }
  if (held.empty()) return;
  const Eigen::Isometry3d X_WO = internal::ToIsometry(poses[structure.tool_body]) * X_BO;
  for (Piece& piece : pieces)
    if (IsHeld(piece)) piece.Place(X_WO);
}

bool Checker::Impl::ArmMayTouch(const Piece& arm_piece, const Piece& other) const {
  if (allowed.contains(other.body_name()) || IsHeld(other)) return true;
  if (other.role() == Role::kObject) return !objects.contains(other.body_name());
  return self_tested(arm_piece.body(), self_tested.cols() - 1) == 0;
}

bool Checker::Impl::HeldMayTouch(const Piece& other) const {
  return other.role() != Role::kObject || IsHeld(other) || allowed.contains(other.body_name()) ||
         !objects.contains(other.body_name());
}

void Checker::Impl::AddPairsOf(int piece) {
  const Piece& first = pieces[piece];
  for (int other = arm_pieces; other < static_cast<int>(pieces.size()); ++other) {
    const bool may_touch = first.role() == Role::kArm ? ArmMayTouch(first, pieces[other]) : HeldMayTouch(pieces[other]);
    if (!may_touch) pairs.emplace_back(piece, other);
  }
}

void Checker::Impl::RebuildPairs() {
  if (pairs_valid) return;
  pairs.clear();
  for (int i = 0; i < static_cast<int>(pieces.size()); ++i)
    if (pieces[i].role() == Role::kArm || IsHeld(pieces[i])) AddPairsOf(i);

  first_self_pair = static_cast<int>(pairs.size());
  pairs.insert(pairs.end(), self_pairs.begin(), self_pairs.end());
  first_held_pair = static_cast<int>(pairs.size());
  // whatever the hand may touch besides: it holds the target, which it is allowed to touch
  for (int arm = 0; arm < arm_pieces; ++arm)
    for (int other = arm_pieces; other < static_cast<int>(pieces.size()); ++other)
      if (IsHeld(pieces[other]) && !structure.with_tool[pieces[arm].body()]) pairs.emplace_back(arm, other);
  pairs_valid = true;
}

void Checker::Impl::FindSelfPiecePairs() {
  for (int a = 0; a < arm_pieces; ++a) {
    for (int b = a + 1; b < arm_pieces; ++b) {
      const int low = std::min(pieces[a].body(), pieces[b].body());
      const int high = std::max(pieces[a].body(), pieces[b].body());
      if (low != high && self_tested(low, high) == 1) self_pairs.emplace_back(a, b);
    }
  }
  PlaceArm(scene->arm().q_home);
  const auto close = std::stable_partition(self_pairs.begin(), self_pairs.end(), [&](const PiecePair& pair) {
    const Piece &a = pieces[pair.first], &b = pieces[pair.second];
    return Distance(a.shape(), a.X_WG(), b.shape(), b.X_WG()) > 2 * internal::kSelfRoom;
  });
  apart_pairs = static_cast<int>(close - self_pairs.begin());
}

void Checker::Impl::SetMargin(double new_margin) {
  if (new_margin == margin) return;
  margin = new_margin;
  for (Piece& piece : pieces) piece.SetMargin(margin);
}

std::optional<Checker::Impl::PiecePair> Checker::Impl::FindCollision(const Eigen::VectorXd& q, double new_margin) {
  ++checks;
  RebuildPairs();
  SetMargin(new_margin);
  PlaceArm(q);
  for (int i = 0; i < static_cast<int>(pairs.size()); ++i) {
    const Piece &a = pieces[pairs[i].first], &b = pieces[pairs[i].second];
    const int self = i < first_held_pair ? i - first_self_pair : -1;
    // nearly all pairs end here
    if (internal::AabbGap(a, b) > (self < 0 ? margin : internal::kSelfRoom)) continue;
    const bool near = self < 0 ? internal::Near(a, b, margin) : internal::NearSelf(a, b, margin, self < apart_pairs);
    if (near) return pairs[i];
  }
  return std::nullopt;
}

Collision Checker::Impl::Describe(PiecePair pair) const {
  const Piece& a = pieces[pair.first];
  const Piece& b = pieces[pair.second];
  return {a.body_name(), b.body_name(), Distance(a.shape(), a.X_WG(), b.shape(), b.X_WG())};
}

Checker::Checker(std::shared_ptr<const sim::Scene> scene) : impl_(std::make_unique<Impl>(std::move(scene))) {}
Checker::Checker(Checker&&) noexcept = default;
Checker::~Checker() = default;

void Checker::SetObject(const std::string& name, const Pose& X_WO) {
  ETUDE_CHECK(std::ranges::any_of(impl_->scene->objects(), [&](const auto& object) { return object.name == name; }),
              "no object '{}' in the scene", name);
  if (impl_->objects.insert_or_assign(name, X_WO).second) impl_->pairs_valid = false;
  if (name == impl_->held) return;
  for (Piece& piece : impl_->pieces)
    if (piece.role() == Role::kObject && piece.body_name() == name) piece.Place(internal::ToIsometry(X_WO));
}

void Checker::ClearObjects() {
  impl_->objects.clear();
  impl_->allowed.clear();
  impl_->held.clear();
  impl_->pairs_valid = false;
}

void Checker::SetGripper(double gripper) { impl_->gripper = gripper; }

double Checker::gripper() const { return impl_->gripper; }

void Checker::Allow(std::set<std::string> bodies) {
  for (const std::string& body : bodies)
    ETUDE_CHECK(impl_->body_names.contains(body), "no body '{}' in the scene", body);
  impl_->allowed = std::move(bodies);
  impl_->pairs_valid = false;
}

void Checker::Attach(const std::string& object, const std::optional<Pose>& X_EO) {
  if (X_EO) {
    ETUDE_CHECK(impl_->held.empty() || impl_->held == object, "already holds '{}'", impl_->held);
    ETUDE_CHECK(impl_->body_names.contains(object), "no object '{}' in the scene", object);
    impl_->held = object;
    impl_->X_BO = internal::ToIsometry(impl_->structure.X_BE * *X_EO);
  } else if (impl_->held == object) {
    impl_->held.clear();
    if (const auto it = impl_->objects.find(object); it != impl_->objects.end()) SetObject(object, Pose(it->second));
  }
  impl_->pairs_valid = false;
}

std::optional<Collision> Checker::Check(const Eigen::VectorXd& q, double margin) {
  const auto pair = impl_->FindCollision(q, margin);
  if (!pair) return std::nullopt;
  return impl_->Describe(*pair);
}

bool Checker::Collides(const Eigen::VectorXd& q, double margin) { return impl_->FindCollision(q, margin).has_value(); }

std::optional<Collision> Checker::CheckSegment(const Eigen::VectorXd& a, const Eigen::VectorXd& b, double resolution,
                                               double margin) {
  ETUDE_CHECK(resolution > 0, "resolution={}", resolution);
  if (auto collision = Check(b, margin)) return collision;
  const auto steps = static_cast<std::uint32_t>(std::ceil((b - a).cwiseAbs().maxCoeff() / resolution));
  if (steps == 0) return std::nullopt;

  // numbers with their bits reversed visit the halves, then the quarters, and so on
  const int bits = std::bit_width(steps - 1);
  for (std::uint32_t i = 0; i < (1u << bits); ++i) {
    std::uint32_t step = 0;
    for (int bit = 0; bit < bits; ++bit) step |= ((i >> bit) & 1u) << (bits - 1 - bit);
    if (step >= steps) continue;
    if (auto collision = Check(a + (b - a) * (static_cast<double>(step) / steps), margin)) return collision;
  }
  return std::nullopt;
}

Collision Checker::Nearest(const Eigen::VectorXd& q) {
  Impl& impl = *impl_;
  ++impl.checks;
  impl.RebuildPairs();
  impl.PlaceArm(q);

  // nearest boxes first, so that most pairs are beyond the best distance by their boxes alone
  std::vector<std::pair<double, int>> order;
  for (int i = 0; i < impl.first_self_pair; ++i) {
    const auto& [a, b] = impl.pairs[i];
    order.emplace_back(internal::AabbGap(impl.pieces[a], impl.pieces[b]), i);
  }
  std::ranges::sort(order);
  Collision nearest{"", "", std::numeric_limits<double>::infinity()};
  for (const auto& [gap, i] : order) {
    if (gap >= nearest.distance) break;
    const Collision found = impl.Describe(impl.pairs[i]);
    if (found.distance < nearest.distance) nearest = found;
  }
  return nearest;
}

std::vector<Proximity> Checker::Distances(const Eigen::VectorXd& q, double within, PairSet set) {
  Impl& impl = *impl_;
  ++impl.checks;
  impl.RebuildPairs();
  impl.PlaceArm(q);

  std::vector<Proximity> found;
  const int begin = set == PairSet::kSelfApart ? impl.first_self_pair : 0;
  const int end = set == PairSet::kOthers    ? impl.first_self_pair
                  : set == PairSet::kSelfToo ? impl.first_held_pair
                                             : impl.first_self_pair + impl.apart_pairs;
  for (int i = begin; i < end; ++i) {
    const Piece& a = impl.pieces[impl.pairs[i].first];
    const Piece& b = impl.pieces[impl.pairs[i].second];
    if (internal::AabbGap(a, b) >= within) continue;
    const Separation separation = Separate(a.shape(), a.X_WG(), b.shape(), b.X_WG());
    if (separation.distance >= within) continue;
    auto entry = std::ranges::find_if(
        found, [&](const Proximity& other) { return other.body_a == a.body_name() && other.body_b == b.body_name(); });
    if (entry == found.end()) {
      const int carrier = a.role() == Role::kArm ? a.body() : impl.structure.tool_body;
      found.push_back({a.body_name(), b.body_name(), impl.scene->arm().bodies[carrier], within});
      entry = found.end() - 1;
    }
    if (separation.distance >= entry->distance) continue;
    entry->distance = separation.distance;
    entry->p_WA = separation.p_WA;
    entry->p_WB = separation.p_WB;
    entry->normal = separation.normal;
  }
  return found;
}

std::vector<Checker::Overlap> Checker::SelfOverlaps(const std::vector<Pose>& X_WB, double depth) {
  Impl& impl = *impl_;
  impl.PlaceArm(X_WB);
  std::vector<Overlap> found;
  for (const auto& [first, second] : impl.self_pairs) {
    const Piece &a = impl.pieces[first], &b = impl.pieces[second];
    // shapes that overlap by more than `depth` have boxes that do along every axis
    if (internal::AabbGap(a, b) > -depth || !Touch(a.shape(), a.X_WG(), b.shape(), b.X_WG())) continue;
    const double overlap = -Separate(a.shape(), a.X_WG(), b.shape(), b.X_WG()).distance;
    if (overlap <= depth) continue;
    const auto known = std::ranges::find_if(
        found, [&](const Overlap& other) { return other.body_a == a.body_name() && other.body_b == b.body_name(); });
    if (known == found.end()) {
      found.push_back({a.body_name(), b.body_name(), overlap});
    } else {
      known->depth = std::max(known->depth, overlap);
    }
  }
  return found;
}

std::uint64_t Checker::checks() const { return impl_->checks; }

std::vector<std::pair<std::string, std::string>> Checker::SelfPairs() const {
  const std::vector<std::string>& bodies = impl_->scene->arm().bodies;
  std::vector<std::pair<std::string, std::string>> names;
  for (std::size_t a = 0; a < bodies.size(); ++a)
    for (std::size_t b = a + 1; b < bodies.size(); ++b)
      if (impl_->self_tested(a, b) == 1) names.emplace_back(bodies[a], bodies[b]);
  return names;
}

}  // namespace etude::collide
