// SPDX-License-Identifier: Apache-2.0
#include "worker/task/rollout.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "services/spec/object_names.h"
#include "worker/plan/timer.h"
#include "worker/sim/controller.h"
#include "worker/task/standstill.h"

namespace etude::task {
namespace {

constexpr double kJointSpeedShare = 0.75;  // of the planned speed of a joint; the hand overshoots the reference's
constexpr double kDamping = 0.02;          // m (and rad): near a singularity no joint has to turn without end
constexpr double kMaxReach = 2.0;          // m from the world's origin: nothing sane is beyond
// The authors' evaluation: the pose of which step of an answer is followed, for how many steps, and how often, by their
// scripts for UR5 and Panda, and for the Jaco. Source: the paper's public code (its loop over t_lim and t_interval).
constexpr char kAsAuthors[] = "authors";
constexpr int kHeldSteps = 45;
constexpr int kFollowed = 15, kFollowedByJaco = 25;
constexpr int kDecisions = 67, kDecisionsOfJaco = 20;

bool IsJaco(const std::string& robot) { return robot == "jaco2"; }

using Vector6d = Eigen::Matrix<double, 6, 1>;

// What a module says about a place: {"entity": "target", "quantity": "position", "value": [x, y, z, ...]}, metres
// first.
std::optional<Eigen::Vector3d> SaidBy(const OrderedJson& output) {
  if (!output.is_object() || !output.contains("value")) return std::nullopt;
  const auto& values = output["value"];
  if (!values.is_array() || values.size() < 3) return std::nullopt;
  Eigen::Vector3d said;
  for (int i = 0; i < 3; ++i) {
    if (!values[i].is_number()) return std::nullopt;
    said[i] = values[i].get<double>();
  }
  if (!said.allFinite()) return std::nullopt;
  return said;
}

std::string TextOr(const OrderedJson& output, const char* key) {
  return output.contains(key) && output[key].is_string() ? output[key].get<std::string>() : "";
}

}  // namespace

std::string RefusalOf(const policy::Answer& answer) {
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

Rollout::Rollout(EpisodeRunner* runner, collide::Checker* checker, std::shared_ptr<const sim::Scene> scene,
                 const RolloutSpec& spec, std::string instruction)
    : runner_(runner),
      checker_(checker),
      kinematics_(scene),
      guard_(std::move(scene), checker),
      spec_(spec),
      instruction_(std::move(instruction)) {
  runner_->episode().stage_names = {"policy"};
  if (spec.pushes.on()) pushes_.emplace(spec.pushes, runner_->plan().seeds.pushes, runner_, checker_);
}

int StepLimitOf(const RolloutSpec& spec, const std::string& robot) {
  if (spec.execution != kAsAuthors) return spec.max_steps;
  return kHeldSteps * (IsJaco(robot) ? kDecisionsOfJaco : kDecisions);
}

int Rollout::LatencySteps(const policy::Answer& answer) {
  if (latency_steps_ >= 0) return latency_steps_;
  const double ms = spec_.latency_ms >= 0 ? spec_.latency_ms : answer.server_p99_ms;
  // a number off the wire may be more than an int holds
  const double asked = std::ceil(ms * 1e-3 * kControlRate - 1e-9);
  const int steps = static_cast<int>(std::min<double>(kHorizonSteps, asked));
  // a server that has not measured itself yet says 0: the next answer settles it
  if (spec_.latency_ms >= 0 || ms > 0) latency_steps_ = steps;
  return steps;
}

Result<tl::expected<policy::Answer, Verdict>> Rollout::Decide(const policy::AskFunction& ask) {
  Result<policy::Answer> asked = Ask(ask);
  // that it has no answer to this question is the rollout's end; that it cannot be asked is nobody's rollout
  const bool answered = asked || asked.error().code == Code::kCorrupt;
  if (!answered) return Fail(std::move(asked).error());
  const std::string refusal = asked ? RefusalOf(*asked) : asked.error().message;
  if (!refusal.empty())
    return tl::make_unexpected(Verdict{AttemptOutcome::kPolicyError,
                                       fmt::format("step {}: the policy answered {}", runner_->steps(), refusal)});
  RecordDecision(*asked);
  return std::move(*asked);
}

Result<Verdict> Rollout::Run(const policy::AskFunction& ask, bool closed) {
  const Pose X_WE = runner_->world().X_WE();
  ETUDE_ASSIGN_OR_RETURN(Verdict verdict,
                         spec_.execution == kAsAuthors ? RunAsAuthors(ask, closed) : RunTracked(ask, closed));
  // What is recorded has a step: where not even the first answer could be followed, one in which the arm stands still.
  if (runner_->steps() == 0) {
    Command still;
    still.target = {X_WE, closed ? 1.0 : 0.0};
    (void)runner_->Step(still);  // the verdict says what happened
  }
  return verdict;
}

Result<Verdict> Rollout::RunTracked(const policy::AskFunction& ask, bool closed) {
  Tracker tracker(
      runner_->world().X_WE(), closed, [this](const Vector6d& V_WE) { return SpeedShareOf(V_WE); },
      runner_->world().scene().control_delay());
  std::vector<Waypoint> answered;  // not in effect yet
  Standstill standstill;
  int question = 0, effect = 0;  // steps of the next question, and from which the last answer counts
  int latency = 0;               // of the last answer, steps
  while (!runner_->judge().done()) {
    const int step = runner_->steps();
    // an answer's first waypoint was for the step after the picture
    const auto follow = [&] {
      if (step == effect && !answered.empty()) tracker.Follow(std::exchange(answered, {}), latency);
    };
    follow();  // before the next question, which may be asked in the same step
    if (step == question && step < spec_.max_steps) {
      ETUDE_ASSIGN_OR_RETURN(auto answer, Decide(ask));
      if (!answer) return answer.error();
      latency = LatencySteps(*answer);
      effect = step + latency;
      // one that goes nowhere from answer to answer follows this one for as long as it spans
      const sim::World& world = runner_->world();
      const bool stands = standstill.At(step, world.X_WE(), world.gripper());
      question = std::max(step + (stands ? kHorizonSteps : spec_.replan_steps), effect);
      answered = std::move(answer->waypoints);
    }
    follow();
    if (pushes_) pushes_->BeforeStep();
    if (!runner_->Step(Guarded(tracker.Next(runner_->world().gripper())))) return Failed();
  }
  return VerdictOnViolations(runner_->judge());
}

// Their loop: a picture, one pose of the answer as the controller's target for kHeldSteps, and the next picture.
Result<Verdict> Rollout::RunAsAuthors(const policy::AskFunction& ask, bool closed) {
  latency_steps_ = 0;
  const int limit = StepLimitOf(spec_, runner_->plan().scene.robot);
  const int followed = IsJaco(runner_->plan().scene.robot) ? kFollowedByJaco : kFollowed;
  Command held;
  held.target = {runner_->world().X_WE(), closed ? 1.0 : 0.0};
  while (!runner_->judge().done()) {
    const int step = runner_->steps();
    if (step % kHeldSteps == 0 && step < limit) {
      ETUDE_ASSIGN_OR_RETURN(auto answer, Decide(ask));
      if (!answer) return answer.error();
      held.target = Interpolate(answer->waypoints, followed);
      closed = ShallClose(held.target.gripper, closed);
      held.target.gripper = closed ? 1 : 0;
    }
    if (pushes_) pushes_->BeforeStep();
    if (!runner_->Step(held)) return Failed();
  }
  return VerdictOnViolations(runner_->judge());
}

Command Rollout::Guarded(const Command& command) {
  const plan::Timer watch(runner_->times().plan);
  return guard_.Guarded(command, runner_->world());
}

Verdict Rollout::Failed() const {
  return {runner_->failure(),
          fmt::format("step {}: {}; {}", runner_->steps(), runner_->failure_reason(), runner_->judge().Words())};
}

double Rollout::SpeedShareOf(const Vector6d& V_WE) {
  const sim::World& world = runner_->world();
  const Eigen::VectorXd v = sim::JointMotion(kinematics_.Jacobian(world.q()), V_WE, kDamping);
  const double most = (v.cwiseAbs().cwiseQuotient(world.scene().arm().planned_speed)).maxCoeff();
  return most > kJointSpeedShare ? kJointSpeedShare / most : 1;
}

Result<policy::Answer> Rollout::Ask(const policy::AskFunction& ask) {
  const sim::World& world = runner_->world();
  const Eigen::VectorXf arm = world.q().cast<float>();
  const Eigen::VectorXf gripper = world.gripper_q().cast<float>();
  const Camera& camera = runner_->episode().cameras.at(0).camera;
  policy::Question question;
  question.instruction = instruction_;
  question.robot = runner_->plan().scene.robot;  // the episode says it at its end
  question.joints.assign(arm.begin(), arm.end());
  question.joints.insert(question.joints.end(), gripper.begin(), gripper.end());
  question.width = camera.width;
  question.height = camera.height;
  question.camera = camera;
  question.rgb = runner_->Picture();
  return ask(question);
}

void Rollout::RecordDecision(const policy::Answer& answer) {
  ObserveDistance();
  OrderedJson errors = OrderedJson::object();
  if (answer.modules.is_object())
    for (const auto& [module, output] : answer.modules.items())
      if (const auto error = ErrorOf(output)) errors[module] = *error;
  OrderedJson decision{
      {"step", runner_->steps()}, {"checkpoint_step", answer.checkpoint_step}, {"touched", runner_->judge().touched()}};
  decision["error_m"] = std::move(errors);
  decisions_.push_back(std::move(decision));
}

std::optional<double> Rollout::ErrorOf(const OrderedJson& output) const {
  const auto said = SaidBy(output);
  if (!said) return std::nullopt;
  const std::string quantity = TextOr(output, "quantity");
  const auto entity = PlaceOf(TextOr(output, "entity"));
  if (!entity) return std::nullopt;
  if (quantity == "position" || quantity == "pose") return (*said - *entity).norm();
  if (quantity == "displacement") return (*said - (*entity - runner_->world().X_WE().p)).norm();
  return std::nullopt;
}

std::optional<Eigen::Vector3d> Rollout::PlaceOf(const std::string& entity) const {
  const sim::World& world = runner_->world();
  if (entity == "ee") return world.X_WE().p;
  std::string name = entity.starts_with("object:") ? entity.substr(7) : entity;
  if (entity == "target") name = runner_->plan().target;
  if (entity == "reference") name = runner_->plan().reference;
  if (entity == "obstacle") name = kObstacleObject;
  for (const auto& object : world.scene().objects())
    if (object.name == name) return world.ObjectPose(name).p;
  for (const auto& object : world.scene().objects())  // of a class: "mug" is mug_01
    if (!name.empty() && ObjectNoun(object.name) == name) return world.ObjectPose(object.name).p;
  return std::nullopt;
}

void Rollout::ObserveDistance() {
  const sim::World& world = runner_->world();
  const std::string& target = runner_->plan().target;
  const plan::Timer watch(runner_->times().plan);
  for (const auto& object : world.scene().objects()) checker_->SetObject(object.name, world.ObjectPose(object.name));
  checker_->Allow({target});
  const collide::WithGripper measured(*checker_, world.gripper());
  const collide::Collision nearest = checker_->Nearest(world.q());
  if (nearest.distance >= nearest_) return;
  nearest_ = nearest.distance;
  nearest_pair_ = nearest.body_a + "-" + nearest.body_b;
}

OrderedJson Rollout::Details(const Verdict& verdict) const {
  OrderedJson details{{"outcome", ToString(verdict.outcome)},
                      {"reason", verdict.reason},
                      {"steps", runner_->steps()},
                      {"latency_steps", std::max(0, latency_steps_)}};
  if (!nearest_pair_.empty()) {
    details["nearest_m"] = nearest_;
    details["nearest_pair"] = nearest_pair_;
  }
  if (pushes_) {
    details["pushes"] = pushes_->Report();
    details["pushes_missed"] = pushes_->missed();
  }
  details["decisions"] = decisions_;
  return details;
}

}  // namespace etude::task
