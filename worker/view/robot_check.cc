// SPDX-License-Identifier: Apache-2.0
#include "worker/view/robot_check.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "services/core/config.h"
#include "services/core/stop.h"
#include "services/spec/robot_names.h"
#include "services/spec/task_name.h"
#include "worker/collide/checker.h"
#include "worker/collide/narrowphase.h"
#include "worker/sim/robot_file.h"
#include "worker/task/attempt.h"
#include "worker/task/motion_check.h"
#include "worker/task/scene_sampling.h"

namespace etude {
namespace {

constexpr double kHomeMargin = 0.003;    // m kept free at home
constexpr double kReachNeeded = 0.8;     // of the places of objects
constexpr double kGripperNeeded = 0.85;  // of the stroke, when driven for kDrive control steps
constexpr int kDrive = 150;
constexpr int kDemonstrations = 5, kDemonstrationsNeeded = 3;  // of each task
constexpr double kDegree = std::numbers::pi / 180;
constexpr double kInside = 5e-4;          // m around the tool's origin that no body of the robot may reach into
constexpr double kRestNeeded = 3e-3;      // m off the end of a motion at rest,
constexpr double kRestTurnNeeded = 0.02;  // rad,
constexpr double kLagNeeded = 0.02;   // m behind it on the way: more than feed-forward at the start of a motion costs
constexpr double kVisualShare = 0.1;  // of the robot's mass in geoms that collide with nothing
constexpr double kRareSaturation = 0.01;  // of the control steps
constexpr int kStride = 25;               // control steps between two pictures that nobody looks at

/// Rounded, and never "-0".
double Whole(double value) { return std::round(value) + 0.0; }

/// The lines so far: printed as they come, or kept for an object.
class Report {
 public:
  explicit Report(bool as_json) : as_json_(as_json) {}
  void Line(bool good, const std::string& what, const std::string& detail) {
    if (!as_json_) fmt::print("{:<8} {:<10} {}\n", good ? "ok" : "MISSING", what, detail);
    checks_.push_back({{"what", what}, {"ok", good}, {"text", detail}});
    if (!good && std::ranges::find(missing_, what) == missing_.end()) missing_.push_back(what);
  }
  void Note(const std::string& text) {
    if (!as_json_) fmt::print("{:<8} {:<10} {}\n", "note", "", text);
    notes_.push_back(text);
  }
  void End(const std::string& robot) const {
    if (!as_json_) return;
    const OrderedJson json{{"robot", robot},
                           {"can_collect", missing_.empty()},
                           {"missing", missing_},
                           {"checks", checks_},
                           {"notes", notes_}};
    fmt::print("{}\n", JsonText(json, 1));
  }
  const std::vector<std::string>& missing() const { return missing_; }

 private:
  const bool as_json_;
  std::vector<std::string> missing_, notes_;
  OrderedJson checks_ = OrderedJson::array();
};

void CheckJoints(const sim::ArmInfo& arm, Report& report) {
  std::vector<std::string> joints;
  for (std::size_t i = 0; i < arm.joints.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    joints.push_back(fmt::format("{} {:.0f}..{:.0f} deg, {:g} N m, {:.2g} rad/s", arm.joints[i], arm.q_min[k] / kDegree,
                                 arm.q_max[k] / kDegree, arm.torque_limit[k], arm.joint_speed[k]));
  }
  report.Line(true, "joints", fmt::format("{}: {}", joints.size(), fmt::join(joints, "; ")));
}

void CheckMasses(const sim::Scene& scene, bool trust, Report& report) {
  const sim::MassReport masses = sim::WeighRobot(scene);
  const std::string all = fmt::format("{:.2f} kg in all", masses.total);
  if (masses.implausible.empty()) return report.Line(true, "masses", all + ", inertias plausible");
  const std::string implausible = fmt::format("{}", fmt::join(masses.implausible, "; "));
  if (!trust)
    return report.Line(false, "masses", implausible + ": mend them, or say `masses: trust` if they are meant");
  report.Note("masses are trusted: " + implausible);
  report.Line(true, "masses", all);
}

/// A robot that weighs too much moves, too: this is said, not asked for.
Status NoteVisualMasses(const Path& yaml, double total, Report& report) {
  ETUDE_ASSIGN_OR_RETURN(const auto visuals, sim::WeighVisuals(yaml));
  double mass = 0;
  std::vector<std::string> bodies;
  for (const auto& visual : visuals) {
    mass += visual.mass;
    bodies.push_back(fmt::format("{} {:.2f} kg", visual.body, visual.mass));
  }
  if (mass >= kVisualShare * total)
    report.Note(
        fmt::format("visual geoms, which collide with nothing, carry {:.2f} of {:.2f} kg beside those that "
                    "collide: {}. Where both are the same link it weighs twice: say `masses: {}` to leave them out",
                    mass, total, fmt::join(bodies, ", "), sim::kMassesOfCollision));
  return {};
}

/// What is inside another body cannot be grasped: the tool belongs between the fingertips.
void CheckTool(const std::shared_ptr<const sim::Scene>& scene, Report& report) {
  const sim::ArmInfo& arm = scene->arm();
  sim::Kinematics kinematics(scene);
  const collide::Shape origin({.shape = sim::Geometry::Shape::kSphere, .size = {kInside, 0, 0}}, 0);
  const auto at = [](const Pose& X) { return Eigen::Isometry3d(Eigen::Translation3d(X.p) * X.q); };
  const Pose X_WE = kinematics.X_WE(arm.q_home);
  for (const auto& [gripper, words] : {std::pair{0.0, "open"}, {0.5, "half closed"}}) {
    const auto poses = kinematics.ArmPoses(arm.q_home, gripper);
    for (const sim::Geometry& piece : scene->geometry()) {
      const auto body = std::ranges::find(arm.bodies, piece.body);
      if (body == arm.bodies.end()) continue;
      const Pose X_WG = poses[static_cast<std::size_t>(body - arm.bodies.begin())] * piece.X_BG;
      if (!collide::Touch(origin, at(X_WE), collide::Shape(piece, 0), at(X_WG))) continue;
      return report.Line(false, "tool",
                         fmt::format("its origin is inside {} (geom {}) with the gripper {}: give `tool` a position "
                                     "between the fingertips, where an object's middle will be",
                                     piece.body, piece.name, words));
    }
  }
  report.Line(true, "tool", "between the fingers, inside no body");
}

std::string Words(const task::Effort::Joint& joint, int steps) {
  return fmt::format("{} demands more than {:g} N m in {:.1f} % of the steps (up to {:.0f})", joint.name, joint.limit,
                     100.0 * joint.steps / steps, joint.demand);
}

std::string Words(const std::vector<task::Effort::Joint>& joints, int steps) {
  std::vector<std::string> words;
  for (const auto& joint : joints) words.push_back(Words(joint, steps));
  return fmt::format("{}: raise `torque`, lower `speed`, or give the `armature` and `damping` that the robot has",
                     fmt::join(words, "; "));
}

std::string Words(const std::vector<task::Effort::Touch>& touches, int steps) {
  std::vector<std::string> words;
  for (const auto& [body, other, count] : touches)
    words.push_back(fmt::format("{}{} in {} of {} steps", body,
                                other.empty()      ? " (itself)"
                                : other == "world" ? "-table"
                                                   : "-" + other,
                                count, steps));
  return fmt::format("{}", fmt::join(words, "; "));
}

bool Often(const std::vector<task::Effort::Joint>& saturated, int steps) {
  return !saturated.empty() && saturated.front().steps > kRareSaturation * steps;
}

void CheckControl(const std::shared_ptr<const sim::Scene>& scene, Report& report) {
  const task::MotionCheck check = task::CheckMotion(scene);
  for (const std::string& way : check.skipped) report.Note("not moved from home: " + way);
  const auto saturated = check.effort.Saturated();
  const bool follows = check.motions > 0 && check.healthy && check.lag < kLagNeeded && check.rest < kRestNeeded &&
                       check.rest_angle < kRestTurnNeeded;
  std::string detail = fmt::format(
      "{} motions from home and back: the hand is at most {:.1f} mm and {:.1f} deg behind "
      "({}), {:.1f} mm and {:.1f} deg off when at rest",
      check.motions, 1e3 * check.lag, check.lag_angle / kDegree, check.worst, 1e3 * check.rest,
      check.rest_angle / kDegree);
  if (!check.healthy) detail += "; the simulation is unstable";
  if (!saturated.empty()) detail += "; " + Words(saturated, check.effort.steps());
  const auto touches = check.effort.Touches();
  if (!touches.empty()) detail += "; touches: " + Words(touches, check.effort.steps());
  report.Line(follows && !Often(saturated, check.effort.steps()), "control", detail);
}

void CheckHome(const std::shared_ptr<const sim::Scene>& scene, Report& report) {
  collide::Checker checker(scene);
  sim::Kinematics kinematics(scene);
  const Pose X_WE = kinematics.X_WE(scene->arm().q_home);
  const Eigen::Vector3d points = -(X_WE.q * Eigen::Vector3d::UnitX());
  for (const double gripper : {0.0, 1.0}) {
    checker.SetGripper(gripper);
    if (const auto collision = checker.Check(scene->arm().q_home, kHomeMargin))
      return report.Line(false, "home", fmt::format("{} touches {}", collision->body_a, collision->body_b));
  }
  report.Line(
      true, "home",
      fmt::format("tool at ({:.3f}, {:.3f}, {:.3f}) m, pointing {:.0f} deg below the horizontal, free", X_WE.p.x(),
                  X_WE.p.y(), X_WE.p.z(), Whole(-std::asin(std::clamp(points.z(), -1.0, 1.0)) / kDegree)));
  if (const double dexterity = task::Dexterity(kinematics, scene->arm().q_home); dexterity < task::kStartDexterity)
    report.Note(
        fmt::format("home is near a singularity: in one direction a rad/s of the joints moves the tool by {:.3f} "
                    "m/s; starts are drawn around home where it is {} at least, and there may be few",
                    dexterity, task::kStartDexterity));
}

void CheckGripper(const std::shared_ptr<const sim::Scene>& scene, Report& report) {
  sim::World world(scene);
  task::ParkObjects(*scene, world);  // whatever stands where the hand is at home
  const Pose home = world.X_WE();
  const auto drive = [&](double gripper) {
    for (int i = 0; i < kDrive; ++i) world.Step({home, gripper}, Eigen::Matrix<double, 6, 1>::Zero());
    return world.gripper();
  };
  const double closed = drive(1), opened = drive(0);
  const bool good = world.healthy() && closed > kGripperNeeded && opened < 1 - kGripperNeeded;
  report.Line(good, "gripper",
              fmt::format("driven for {:.1f} s it closes to {:.0f} % and opens to {:.0f} %", kDrive * 0.008,
                          Whole(100 * closed), Whole(100 * opened)));
  const double error = (world.X_WE().p - home.p).norm();
  if (error >= kRestNeeded)
    report.Line(false, "control", fmt::format("the arm leaves its home by {:.1f} mm meanwhile", 1e3 * error));
}

void CheckReach(const std::shared_ptr<const sim::Scene>& scene, Report& report) {
  const sim::ArmInfo& arm = scene->arm();
  sim::Kinematics kinematics(scene);
  collide::Checker checker(scene);
  const Eigen::Quaterniond hand = Eigen::AngleAxisd(-arm.approach_pitch, Eigen::Vector3d::UnitX()) *
                                  FromEuler({std::numbers::pi, 0, std::numbers::pi / 2});
  int places = 0, reached = 0, free = 0;
  for (double x = -0.43; x <= 0.431; x += 0.086)
    for (double y = 0.15; y <= (std::abs(x) > 0.31 ? 0.301 : 0.401); y += 0.05)
      for (const double z : {0.08, 0.16, 0.24}) {
        ++places;
        const auto q = kinematics.Solve({{x, y, z}, hand}, arm.q_home);
        reached += q.has_value();
        free += q && !checker.Check(*q);
      }
  report.Line(
      free >= kReachNeeded * places, "reach",
      fmt::format("{:.0f} % of the places of objects, {:.0f} % without a collision, coming {:.0f} deg below the "
                  "horizontal",
                  100.0 * reached / places, 100.0 * free / places, arm.approach_pitch / kDegree));
}

/// @param effort  gets what its demonstrations cost
Status CheckTask(const std::string& robot, const sim::ArmInfo& arm, const TaskName& task,
                 const sim::RendererConfig& renderer, Report& report, task::Effort& effort) {
  CampaignSpec spec;
  spec.robots = {robot};
  spec.tasks = {task.base};
  spec.objects = {"cube"};
  spec.image_stride = kStride;
  ETUDE_ASSIGN_OR_RETURN(auto runner, task::AttemptRunner::Open(spec, renderer));
  int succeeded = 0;
  std::string trouble;
  for (int index = 0; index < kDemonstrations; ++index) {
    if (StopRequested()) return Fail(Code::kExhausted, fmt::format("robot check: stopped in {}", task.base));
    task::AttemptTrace trace;
    ETUDE_ASSIGN_OR_RETURN(const auto attempt, runner.Demonstrate(static_cast<std::uint64_t>(index), 0, {}, &trace));
    effort.Add(trace.effort);
    if (attempt.outcome == task::AttemptOutcome::kSuccess)
      ++succeeded;
    else
      trouble = fmt::format("; {}: {}", task::ToString(attempt.outcome), attempt.reason);
  }
  const bool has_other_way = task.spec->Has(TurnSpec::kName) && arm.approach_pitch > 0;  // a level hand turns down
  if (succeeded < kDemonstrationsNeeded && has_other_way && sim::IsRobotFile(robot))
    trouble += "; the other sign of `turn` in its file may suit the wrist";
  report.Line(succeeded >= kDemonstrationsNeeded, task.base,
              fmt::format("{} of {} demonstrations with the cube succeed{}", succeeded, kDemonstrations, trouble));
  return {};
}

/// Every task, and then what they cost the arm: why those fail that do.
Status CheckTasks(const std::string& robot, const sim::Scene& scene, const sim::RendererConfig& renderer,
                  Report& report) {
  task::Effort effort;
  if (BaseTasks().empty()) return Fail(Code::kNotFound, "no tasks to try the robot with: see `etude task check pick`");
  for (const std::string& name : BaseTasks()) {
    ETUDE_ASSIGN_OR_RETURN(const TaskName task, ParseTask(name));
    if (task.relation()) continue;
    if (!scene.arm().turns_any_way() && task.spec->Has(TurnSpec::kName)) {
      report.Note(fmt::format("{} is not for {} joints: it turns an object over", name, scene.arm().joints.size()));
      continue;
    }
    ETUDE_RETURN_IF_ERROR(CheckTask(robot, scene.arm(), task, renderer, report, effort));
  }
  const bool failed = !report.missing().empty();
  const auto saturated = effort.Saturated();
  if (Often(saturated, effort.steps()) || (failed && !saturated.empty()))
    report.Line(!failed, "torque", "over all tasks " + Words(saturated, effort.steps()));
  if (const auto touches = effort.Touches(); !touches.empty())
    report.Line(!failed, "contacts", "over all tasks, unwanted: " + Words(touches, effort.steps()));
  return {};
}

}  // namespace

Status CheckRobot(const std::string& robot, const sim::RendererConfig& renderer, const RobotCheckOptions& options) {
  Report report(options.as_json);
  SceneSpec spec;
  spec.robot = robot;
  spec.objects = {"cube"};
  ETUDE_ASSIGN_OR_RETURN(const Path yaml, FindRobot(robot));
  ETUDE_ASSIGN_OR_RETURN(const sim::LoadedRobot loaded, sim::LoadRobot(yaml));
  for (const std::string& note : loaded.notes) report.Note(note);
  ETUDE_ASSIGN_OR_RETURN(const auto scene, sim::Scene::Build(spec));
  report.Line(true, "compiles", fmt::format("{} bodies", scene->arm().bodies.size()));
  CheckJoints(scene->arm(), report);
  CheckMasses(*scene, loaded.trust_masses, report);
  ETUDE_RETURN_IF_ERROR(NoteVisualMasses(yaml, sim::WeighRobot(*scene).total, report));
  CheckHome(scene, report);
  CheckTool(scene, report);
  CheckGripper(scene, report);
  CheckControl(scene, report);
  CheckReach(scene, report);
  // without hand and reach no task can be tried, and every one would fail for their reason
  const auto only_control = [](const std::vector<std::string>& missing) {
    return std::ranges::all_of(missing, [](const std::string& what) { return what == "control"; });
  };
  if (only_control(report.missing())) ETUDE_RETURN_IF_ERROR(CheckTasks(robot, *scene, renderer, report));
  report.End(robot);
  if (report.missing().empty()) return {};
  return Fail(Code::kInvalidArgument,
              fmt::format("'{}' cannot collect yet: {}", robot, fmt::join(report.missing(), ", ")));
}

}  // namespace etude
