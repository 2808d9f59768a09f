// SPDX-License-Identifier: Apache-2.0
#include "worker/plan/potential_field.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

namespace etude::plan::internal {
namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using collide::Proximity;

constexpr double kStep = 0.005;         ///< m of the tool, a step of the flow
constexpr double kTurn = 0.03;          ///< rad of the tool
constexpr double kJointStep = 0.05;     ///< rad of any joint
constexpr double kTable = 0.012;        ///< m, rho_0 of what is not named as an obstacle
constexpr double kLeastRange = 0.02;    ///< m, rho_0 of what is circled at least
constexpr double kPassed = 0.2;         ///< cosine between normal and way where an obstacle counts as passed
constexpr double kUpwards = 0.7;        ///< part of up in the side on which it is passed
constexpr double kLimitRange = 0.08;    ///< rad, rho_0 of joint limits
constexpr double kPerRadian = 0.1;      ///< m that a turn of one radian counts for
constexpr double kAtGoal = 0.8;         ///< of the distance at start and goal is left to them
constexpr double kShrink = 0.3;         ///< m of rho_0 for each m of way to them
constexpr double kDamping = 0.02;       ///< m, of the inverse of the tool's Jacobian
constexpr double kPointDamping = 0.05;  ///< m, of that of points
constexpr double kDonePosition = 3e-4, kDoneAngle = 1e-3;
constexpr int kMaxSteps = 800;
constexpr int kStillSteps = 24;    ///< hardly moved during these: an equilibrium, or to and fro
constexpr double kStill = 0.12;    ///< of the way that free steps would have gone
constexpr int kNoGainSteps = 140;  ///< no nearer to the goal during these
constexpr int kHalvings = 4;       ///< of a step that would collide

double Way(const Pose& a, const Pose& b) { return (a.p - b.p).norm() + kPerRadian * AngleBetween(a.q, b.q); }

Vector6 ErrorOf(const Pose& now, const Pose& goal) {
  Eigen::Quaterniond turn = goal.q * now.q.conjugate();
  if (turn.w() < 0) turn.coeffs() *= -1;
  const Eigen::AngleAxisd angle_axis(turn);
  Vector6 error;
  error << goal.p - now.p, angle_axis.axis() * angle_axis.angle();
  return error;
}

// J^T (J J^T + d^2 I)^-1 v
Eigen::VectorXd DampedInverse(const Eigen::MatrixXd& J, const Eigen::VectorXd& v, double damping) {
  const Eigen::MatrixXd normal = J * J.transpose() + damping * damping * Eigen::MatrixXd::Identity(J.rows(), J.rows());
  return J.transpose() * normal.ldlt().solve(v);
}

// Khatib's FIRAS force eta (1/rho - 1/rho_0) / rho^2 with eta such that it equals `unit` half way to the obstacle,
// where it then stops what comes straight at it with that step; bounded.
double Repulsion(double rho, double rho_0, double unit) {
  if (rho >= rho_0) return 0;
  const double part = std::max(rho / rho_0, 0.2);
  return unit * std::min(2.0, (1 / part - 1) / (4 * part * part));
}

class Flow {
 public:
  Flow(const FieldProblem& problem, sim::Kinematics& kinematics, collide::Checker& checker)
      : problem_(problem), kinematics_(kinematics), checker_(checker) {}

  FieldResult Run();

 private:
  Eigen::VectorXd Direction(const Eigen::VectorXd& q, const Vector6& error);
  Eigen::VectorXd Repelled(const Eigen::VectorXd& q);
  Eigen::VectorXd FromLimits(const Eigen::VectorXd& q) const;
  Eigen::Vector3d Circulation(const Eigen::Vector3d& ahead);
  bool Advance(Eigen::VectorXd& q, const Eigen::VectorXd& step) const;
  bool IsTrapped() const;
  std::string Describe(const Pose& X_WE) const;

  const FieldProblem& problem_;
  sim::Kinematics& kinematics_;
  collide::Checker& checker_;
  std::vector<Proximity> near_;                   ///< at the present q
  std::vector<Pose> tool_;                        ///< poses so far
  std::vector<double> left_;                      ///< way to the goal at each
  int best_ = 0;                                  ///< step of the least of them
  std::map<std::string, Eigen::Vector3d> sides_;  ///< by obstacle: on which side the tool passes it
};

Eigen::VectorXd Flow::Repelled(const Eigen::VectorXd& q) {
  std::vector<sim::Kinematics::BodyPoint> points;
  std::vector<double> speeds;
  std::vector<Eigen::Vector3d> normals;
  for (const Proximity& pair : near_) {
    const double speed = Repulsion(pair.distance, problem_.influence->Of(pair, tool_.back()), kStep);
    if (speed <= 0) continue;
    points.push_back({pair.carrier, pair.p_WA});
    speeds.push_back(speed);
    normals.push_back(pair.normal);
  }
  if (points.empty()) return Eigen::VectorXd::Zero(q.size());
  const std::vector<Eigen::MatrixXd> jacobians = kinematics_.PointJacobians(q, points);
  // d rho / dq of all of them at once, so that fingers side by side do not count twice
  Eigen::MatrixXd slopes(static_cast<Eigen::Index>(points.size()), q.size());
  for (Eigen::Index i = 0; i < slopes.rows(); ++i) slopes.row(i) = normals[i].transpose() * jacobians[i];
  return DampedInverse(slopes, Eigen::Map<const Eigen::VectorXd>(speeds.data(), slopes.rows()), kPointDamping);
}

Eigen::VectorXd Flow::FromLimits(const Eigen::VectorXd& q) const {
  Eigen::VectorXd speed(q.size());
  for (Eigen::Index i = 0; i < q.size(); ++i)
    speed[i] = Repulsion(q[i] - problem_.q_min[i], kLimitRange, kJointStep / 4) -
               Repulsion(problem_.q_max[i] - q[i], kLimitRange, kJointStep / 4);
  return speed;
}

// Around what lies ahead. Source: De Luca & Oriolo 1994, "Local incremental planning for nonholonomic mobile robots":
// a field that turns around an obstacle has no equilibrium in front of it. The side is that of the first look, leaning
// upwards because the table is below, and stays until the obstacle is passed.
Eigen::Vector3d Flow::Circulation(const Eigen::Vector3d& ahead) {
  std::map<std::string, std::pair<double, Eigen::Vector3d>> blocking;  // by obstacle: how much, and its normal
  for (const Proximity& pair : near_) {
    const double rho_0 = problem_.influence->Of(pair, tool_.back());
    if (rho_0 < kLeastRange || pair.distance >= rho_0 || pair.normal.dot(ahead) > kPassed) continue;
    const double weight = std::min(1.0, 1.5 * (1 - pair.distance / rho_0));
    auto& [most, normal] = blocking[pair.body_b];
    if (weight > most) {
      most = weight;
      normal = pair.normal;
    }
  }
  std::erase_if(sides_, [&](const auto& side) { return !blocking.contains(side.first); });
  Eigen::Vector3d step = Eigen::Vector3d::Zero();
  for (const auto& [name, block] : blocking) {
    const Eigen::Vector3d leaning = block.second + kUpwards * Eigen::Vector3d::UnitZ();
    const Eigen::Vector3d& side = sides_.try_emplace(name, leaning).first->second;
    const Eigen::Vector3d across = side - ahead * ahead.dot(side);
    step += across * (kStep * block.first / std::max(across.norm(), 0.1));
  }
  return step;
}

// The step of the flow at q: attraction, saturated so that position and orientation arrive together, and repulsion.
Eigen::VectorXd Flow::Direction(const Eigen::VectorXd& q, const Vector6& error) {
  const double linear = error.head<3>().norm(), angular = error.tail<3>().norm();
  const double saturation = std::min({1.0, kStep / std::max(linear, 1e-12), kTurn / std::max(angular, 1e-12)});
  Vector6 twist = error * saturation;
  if (linear > kStep) twist.head<3>() += Circulation(error.head<3>() / linear);
  Eigen::VectorXd step = DampedInverse(kinematics_.Jacobian(q), twist, kDamping);
  step += Repelled(q) + FromLimits(q);
  return step * std::min(1.0, kJointStep / std::max(step.cwiseAbs().maxCoeff(), 1e-12));
}

// Takes the step, or the part of it that stays free.
bool Flow::Advance(Eigen::VectorXd& q, const Eigen::VectorXd& step) const {
  double part = 1;
  for (int i = 0; i <= kHalvings; ++i, part /= 2) {
    Eigen::VectorXd next = (q + step * part).cwiseMax(problem_.q_min).cwiseMin(problem_.q_max);
    if (problem_.settle) next = problem_.settle(next);
    if (!problem_.is_free(next)) continue;
    q = next;
    return true;
  }
  return false;
}

bool Flow::IsTrapped() const {
  const int now = static_cast<int>(tool_.size()) - 1;
  if (now - best_ > kNoGainSteps) return true;
  if (now < kStillSteps) return false;
  // near the goal, steps are small because little is left
  const double free_way = std::min(kStep * kStillSteps, left_[now]);
  return Way(tool_[now - kStillSteps], tool_[now]) < kStill * free_way;
}

std::string Flow::Describe(const Pose& X_WE) const {
  const auto nearest = std::ranges::min_element(near_, {}, &Proximity::distance);
  const double done = 1 - Way(X_WE, problem_.X_WE_goal) / std::max(left_.front(), 1e-9);
  std::string text = fmt::format("held at {:.0f} % of the way", 100 * std::max(0.0, done));
  if (nearest != near_.end())
    text += fmt::format(", {} {:.0f} mm from {}", nearest->body_a, 1e3 * nearest->distance, nearest->body_b);
  return text;
}

FieldResult Flow::Run() {
  FieldResult result;
  Eigen::VectorXd q = problem_.q_start;
  for (int step = 0; step <= kMaxSteps; ++step) {
    const Pose X_WE = kinematics_.X_WE(q);
    result.path.push_back(q);
    tool_.push_back(X_WE);
    left_.push_back(Way(X_WE, problem_.X_WE_goal));
    if (left_.back() < left_[best_] - kStep / 10) best_ = step;
    near_ = checker_.Distances(q, problem_.influence->largest());
    for (const Proximity& pair : near_)
      if (const double rho_0 = problem_.influence->Of(pair, X_WE); rho_0 > 0)
        result.keep = std::min(result.keep, pair.distance / rho_0);

    const Vector6 error = ErrorOf(X_WE, problem_.X_WE_goal);
    if (error.head<3>().norm() < kDonePosition && error.tail<3>().norm() < kDoneAngle) {
      result.reached = true;
      return result;
    }
    if (IsTrapped() || !Advance(q, Direction(q, error))) break;
  }
  result.trap = Describe(tool_.back());
  return result;
}

}  // namespace

Influence::Influence(collide::Checker& checker, const Place& start, const Place& goal, double clearance,
                     const std::vector<std::string>& obstacles)
    : clearance_(clearance),
      least_(std::min(clearance, kTable)),
      obstacles_(obstacles),
      X_WE_start_(start.X_WE),
      X_WE_goal_(goal.X_WE),
      at_start_(NearerThan(checker, start.q)),
      at_goal_(NearerThan(checker, goal.q)) {}

std::map<Influence::Names, double> Influence::NearerThan(collide::Checker& checker, const Eigen::VectorXd& q) const {
  std::map<Names, double> distances;
  for (const Proximity& pair : checker.Distances(q, 2 * largest()))
    distances[{pair.body_a, pair.body_b}] = pair.distance;
  return distances;
}

double Influence::Of(const Proximity& pair, const Pose& X_WE) const {
  const bool is_obstacle =
      obstacles_.empty() ? pair.body_b != "world" : std::ranges::count(obstacles_, pair.body_b) > 0;
  double rho_0 = is_obstacle ? clearance_ : least_;
  const auto bound = [&](const std::map<Names, double>& distances, const Pose& end) {
    const auto found = distances.find({pair.body_a, pair.body_b});
    if (found != distances.end())
      rho_0 = std::min(rho_0, std::max(0.0, kAtGoal * found->second) + kShrink * Way(X_WE, end));
  };
  bound(at_start_, X_WE_start_);
  bound(at_goal_, X_WE_goal_);
  return rho_0;
}

double Influence::PartLeft(collide::Checker& checker, const Eigen::VectorXd& q, const Pose& X_WE) const {
  double part = 1;
  for (const Proximity& pair : checker.Distances(q, largest()))
    if (const double rho_0 = Of(pair, X_WE); rho_0 > 0) part = std::min(part, pair.distance / rho_0);
  return part;
}

FieldResult FollowField(const FieldProblem& problem, sim::Kinematics& kinematics, collide::Checker& checker) {
  return Flow(problem, kinematics, checker).Run();
}

}  // namespace etude::plan::internal
