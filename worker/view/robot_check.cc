// SPDX-License-Identifier: Apache-2.0
#include "worker/view/robot_check.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "services/spec/robot_names.h"
#include "services/spec/task_name.h"
#include "worker/collide/checker.h"
#include "worker/sim/robot_file.h"
#include "worker/task/attempt.h"

namespace etude {
namespace {

constexpr double kHomeMargin = 0.003;    // m kept free at home
constexpr double kReachNeeded = 0.8;     // of the places of objects
constexpr double kGripperNeeded = 0.85;  // of the stroke, when driven for kDrive control steps
constexpr int kDrive = 150;
constexpr int kDemonstrations = 5, kDemonstrationsNeeded = 3;  // of each task
constexpr double kDegree = std::numbers::pi / 180;

/// Rounded, and never "-0".
double Whole(double value) { return std::round(value) + 0.0; }

/// The lines so far.
class Report {
 public:
  void Line(bool good, const std::string& what, const std::string& detail) {
    fmt::print("{:<8} {:<10} {}\n", good ? "ok" : "MISSING", what, detail);
    if (!good) missing_.push_back(what);
  }
  void Note(const std::string& text) { fmt::print("{:<8} {:<10} {}\n", "note", "", text); }
  const std::vector<std::string>& missing() const { return missing_; }

 private:
  std::vector<std::string> missing_;
};

void CheckJoints(const sim::ArmInfo& arm, Report& report) {
  std::vector<std::string> joints;
  for (std::size_t i = 0; i < arm.joints.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    joints.push_back(fmt::format("{} {:.0f}..{:.0f} deg, {:g} N m, {:.2g} rad/s", arm.joints[i], arm.q_min[k] / kDegree,
                                 arm.q_max[k] / kDegree, arm.torque_limit[k], arm.joint_speed[k]));
  }
  report.Line(arm.joints.size() >= 6, "joints", fmt::format("{}: {}", joints.size(), fmt::join(joints, "; ")));
}

void CheckMasses(const sim::Scene& scene, Report& report) {
  const sim::MassReport masses = sim::WeighRobot(scene);
  const bool good = masses.implausible.empty();
  report.Line(good, "masses",
              good ? fmt::format("{:.2f} kg in all, inertias plausible", masses.total)
                   : fmt::format("{}", fmt::join(masses.implausible, "; ")));
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
  report.Line(true, "home",
              fmt::format("tool at ({:.3f}, {:.3f}, {:.3f}) m, pointing {:.0f} deg below the horizontal, free",
                          X_WE.p.x(), X_WE.p.y(), X_WE.p.z(), Whole(-std::asin(points.z()) / kDegree)));
}

void CheckGripper(const std::shared_ptr<const sim::Scene>& scene, Report& report) {
  const sim::ArmInfo& arm = scene->arm();
  sim::World world(scene);
  const Pose home = world.X_WE();
  const auto drive = [&](double gripper) {
    for (int i = 0; i < kDrive; ++i) world.Step({home, gripper}, Eigen::Matrix<double, 6, 1>::Zero());
    return (world.gripper_q()[0] - arm.gripper_open) / (arm.gripper_closed - arm.gripper_open);
  };
  const double closed = drive(1), opened = drive(0);
  const bool good = world.healthy() && closed > kGripperNeeded && opened < 1 - kGripperNeeded;
  report.Line(good, "gripper",
              fmt::format("driven for {:.1f} s it closes to {:.0f} % and opens to {:.0f} %", kDrive * 0.008,
                          Whole(100 * closed), Whole(100 * opened)));
  const double error = (world.X_WE().p - home.p).norm();
  report.Line(error < 2e-3, "control", fmt::format("the arm holds its home within {:.2f} mm meanwhile", 1e3 * error));
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

Status CheckTask(const std::string& robot, const TaskName& task, const sim::RendererConfig& renderer, Report& report) {
  CampaignSpec spec;
  spec.robots = {robot};
  spec.tasks = {task.base};
  spec.objects = {"cube"};
  ETUDE_ASSIGN_OR_RETURN(auto runner, task::AttemptRunner::Open(spec, renderer));
  int succeeded = 0;
  std::string trouble;
  for (int index = 0; index < kDemonstrations; ++index) {
    const auto attempt = runner.Demonstrate(static_cast<std::uint64_t>(index), 0);
    if (attempt.outcome == task::AttemptOutcome::kSuccess)
      ++succeeded;
    else
      trouble = fmt::format("; {}: {}", task::ToString(attempt.outcome), attempt.reason);
  }
  const bool turns = task.spec->Has(TurnSpec::kName);
  if (succeeded < kDemonstrationsNeeded && turns && sim::IsRobotFile(robot))
    trouble += "; the other sign of `turn` in its file may suit the wrist";
  report.Line(succeeded >= kDemonstrationsNeeded, task.base,
              fmt::format("{} of {} demonstrations with the cube succeed{}", succeeded, kDemonstrations, trouble));
  return {};
}

}  // namespace

Status CheckRobot(const std::string& robot, const sim::RendererConfig& renderer) {
  Report report;
  SceneSpec spec;
  spec.robot = robot;
  spec.objects = {"cube"};
  ETUDE_ASSIGN_OR_RETURN(const Path yaml, FindRobot(robot));
  ETUDE_ASSIGN_OR_RETURN(const sim::LoadedRobot loaded, sim::LoadRobot(yaml));
  for (const std::string& note : loaded.notes) report.Note(note);
  ETUDE_ASSIGN_OR_RETURN(const auto scene, sim::Scene::Build(spec));
  report.Line(true, "compiles", fmt::format("{} bodies", scene->arm().bodies.size()));
  CheckJoints(scene->arm(), report);
  CheckMasses(*scene, report);
  CheckHome(scene, report);
  CheckGripper(scene, report);
  CheckReach(scene, report);
  // without hand and reach no task can be tried, and every one would fail for their reason
  if (report.missing().empty())
    for (const std::string& name : BaseTasks()) {
      ETUDE_ASSIGN_OR_RETURN(const TaskName task, ParseTask(name));
      if (!task.relation()) ETUDE_RETURN_IF_ERROR(CheckTask(robot, task, renderer, report));
    }
  if (report.missing().empty()) return {};
  return Fail(Code::kInvalidArgument,
              fmt::format("'{}' cannot collect yet: {}", robot, fmt::join(report.missing(), ", ")));
}

}  // namespace etude
