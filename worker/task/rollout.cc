// SPDX-License-Identifier: Apache-2.0
#include "worker/task/rollout.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

namespace etude::task {
namespace {

constexpr double kMaxLinear = 0.8;      // m/s of the reference
constexpr double kMaxAngular = 3.0;     // rad/s
constexpr double kMaxReach = 2.0;       // m from the world's origin: nothing sane is beyond
constexpr int kStepsAfterSuccess = 12;  // so that a video shows it
// The fingers close above one and open below the other: a wavering answer does not make them flutter.
constexpr double kCloseAbove = 0.6;
constexpr double kOpenBelow = 0.4;

Eigen::Vector3d RotationVector(const Eigen::Quaterniond& q) {
  const Eigen::AngleAxisd turn(q.w() < 0 ? Eigen::Quaterniond(-q.coeffs()) : q);
  return turn.angle() * turn.axis();
}

Eigen::Vector3d Limited(const Eigen::Vector3d& v, double most) {
  const double norm = v.norm();
  return norm > most ? Eigen::Vector3d(v * (most / norm)) : v;
}

// Distance between what a module said (an array of three numbers) and the truth, if it said it.
std::optional<double> ErrorOf(const OrderedJson& modules, const char* module, const char* key,
                              const Eigen::Vector3d& truth) {
  if (!modules.is_object() || !modules.contains(module)) return std::nullopt;
  const auto& outputs = modules[module];
  if (!outputs.is_object() || !outputs.contains(key)) return std::nullopt;
  const auto& values = outputs[key];
  if (!values.is_array() || values.size() < 3) return std::nullopt;
  Eigen::Vector3d said;
  for (int i = 0; i < 3; ++i) {
    if (!values[i].is_number()) return std::nullopt;
    said[i] = values[i].get<double>();
  }
  if (!said.allFinite()) return std::nullopt;
  return (said - truth).norm();
}

}  // namespace

std::string RefusalOf(const PolicyAnswer& answer) {
  if (static_cast<int>(answer.waypoints.size()) != kWaypoints)
    return fmt::format("{} waypoints instead of {}", answer.waypoints.size(), kWaypoints);
  for (int k = 0; k < kWaypoints; ++k) {
    const Waypoint& waypoint = answer.waypoints[k];
    if (!waypoint.X_WE.p.allFinite() || !waypoint.X_WE.q.coeffs().allFinite() || !std::isfinite(waypoint.gripper))
      return fmt::format("waypoint {} is not finite", k);
    if (waypoint.X_WE.p.norm() > kMaxReach)
      return fmt::format("waypoint {} is {:.1f} m away", k, waypoint.X_WE.p.norm());
    if (std::abs(waypoint.X_WE.q.norm() - 1) > 1e-3)
      return fmt::format("waypoint {} has a quaternion of norm {:.3f}", k, waypoint.X_WE.q.norm());
  }
  return {};
}

void Tracker::Follow(std::vector<Waypoint> waypoints) {
  waypoints_ = std::move(waypoints);
  step_ = 0;
}

Command Tracker::Next() {
  const Waypoint now = Interpolate(waypoints_, step_);
  const Waypoint next = Interpolate(waypoints_, step_ + 1);
  ++step_;
  const double dt = 1 / kControlRate;
  Command command;
  command.V_WE.head<3>() = Limited((next.X_WE.p - now.X_WE.p) / dt, kMaxLinear);
  command.V_WE.tail<3>() = Limited(RotationVector(next.X_WE.q * now.X_WE.q.conjugate()) / dt, kMaxAngular);
  const Eigen::Vector3d turn = Limited(RotationVector(now.X_WE.q * reference_.q.conjugate()), kMaxAngular * dt);
  reference_.p += Limited(now.X_WE.p - reference_.p, kMaxLinear * dt);
  if (turn.norm() > 0)
    reference_.q = (Eigen::Quaterniond(Eigen::AngleAxisd(turn.norm(), turn.normalized())) * reference_.q).normalized();
  closed_ = closed_ ? now.gripper > kOpenBelow : now.gripper > kCloseAbove;
  command.target = {reference_, closed_ ? 1.0 : 0.0};
  return command;
}

Rollout::Rollout(Session* session, collide::Checker* checker, const RolloutSpec& spec, std::string instruction)
    : session_(session), checker_(checker), spec_(spec), instruction_(std::move(instruction)) {
  session_->episode().stage_names = {"policy"};
}

Result<Verdict> Rollout::Run(const PolicyFunction& policy) {
  Tracker tracker(session_->world().X_WE(), false);
  for (int step = 0;; ++step) {
    if (step % spec_.replan_steps == 0 && step < spec_.max_steps && success_step_ < 0) {
      ETUDE_ASSIGN_OR_RETURN(PolicyAnswer answer, Ask(policy));
      const std::string refusal = RefusalOf(answer);
      if (!refusal.empty())
        return Verdict{AttemptOutcome::kPolicyError, fmt::format("step {}: the policy answered {}", step, refusal)};
      RecordDecision(answer);
      tracker.Follow(std::move(answer.waypoints));
    }
    if (!session_->Step(tracker.Next())) {
      if (success_step_ >= 0) return Verdict{};
      return Verdict{session_->failure(), fmt::format("step {}: {}, progress {:.3f} m", session_->steps(),
                                                      session_->failure_reason(), session_->criterion().progress())};
    }
    if (session_->success() && success_step_ < 0) success_step_ = session_->steps();
    if (success_step_ >= 0 && session_->steps() >= success_step_ + kStepsAfterSuccess) return Verdict{};
  }
}

Result<PolicyAnswer> Rollout::Ask(const PolicyFunction& policy) {
  const sim::World& world = session_->world();
  const Eigen::VectorXf arm = world.q().cast<float>();
  const Eigen::VectorXf gripper = world.gripper_q().cast<float>();
  const Camera& camera = world.scene().camera();
  PolicyQuestion question;
  question.instruction = instruction_;
  question.joints.assign(arm.begin(), arm.end());
  question.joints.insert(question.joints.end(), gripper.begin(), gripper.end());
  question.width = camera.width;
  question.height = camera.height;
  question.rgb = session_->Picture();
  return policy(question);
}

void Rollout::RecordDecision(const PolicyAnswer& answer) {
  ObserveDistance();
  const sim::World& world = session_->world();
  const Eigen::Vector3d p_WE = world.X_WE().p;
  const Eigen::Vector3d p_WO = world.ObjectPose(session_->config().target).p;
  OrderedJson decision{{"step", session_->steps()}, {"checkpoint_step", answer.checkpoint_step}, {"touched", touched_}};
  const auto add = [&](const char* module, const char* key, const Eigen::Vector3d& truth) {
    if (const auto error = ErrorOf(answer.modules, module, key, truth)) decision[module] = *error;
  };
  add("TAR3D", "position", p_WO);
  add("EE3D", "position", p_WE);
  add("DISP", "displacement", p_WO - p_WE);
  decisions_.push_back(std::move(decision));
}

void Rollout::ObserveDistance() {
  const sim::World& world = session_->world();
  const std::string& target = session_->config().target;
  const auto& arm = world.scene().arm().bodies;
  for (const auto& body : world.ContactsOf(target))
    touched_ = touched_ || std::find(arm.begin(), arm.end(), body) != arm.end();
  const Stopwatch watch(session_->times().plan);
  for (const auto& object : world.scene().objects()) checker_->SetObject(object.name, world.ObjectPose(object.name));
  checker_->Allow({target});
  const collide::Collision nearest = checker_->Nearest(world.q());
  if (nearest.distance >= nearest_) return;
  nearest_ = nearest.distance;
  nearest_pair_ = nearest.body_a + "-" + nearest.body_b;
}

OrderedJson Rollout::Details(const Verdict& verdict) const {
  OrderedJson details{{"outcome", ToString(verdict.outcome)},
                      {"reason", verdict.reason},
                      {"steps", session_->steps()},
                      {"success_step", success_step_},
                      {"progress_m", session_->criterion().progress()},
                      {"disturbed_objects", session_->disturbed()}};
  if (!nearest_pair_.empty()) {
    details["nearest_m"] = nearest_;
    details["nearest_pair"] = nearest_pair_;
  }
  details["decisions"] = decisions_;
  return details;
}

}  // namespace etude::task
