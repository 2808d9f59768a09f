// SPDX-License-Identifier: Apache-2.0
// Collision checks per second and planning times in the tabletop scene, on one core. Prints one
// JSON line each: {"name", "value", "unit", "baseline", "ratio"}; the baseline of a check is its
// kinematics alone, that of a plan is a straight one, that of "planning" what OMPL and FCL do by themselves.
#include <fmt/format.h>

#include <algorithm>
#include <vector>

#include "services/core/clock.h"
#include "services/core/rng.h"
#include "worker/plan/bench/measure.h"
#include "worker/plan/planner.h"

namespace etude {
namespace {

void Print(const std::string& name, double value, const std::string& unit, double baseline) {
  fmt::print(
      "{{\"name\": \"{}\", \"value\": {:.4g}, \"unit\": \"{}\", \"baseline\": {:.4g}, \"ratio\": "
      "{:.3g}}}\n",
      name, value, unit, baseline, value / baseline);
}

double Quantile(std::vector<double> values, double quantile) {
  std::ranges::sort(values);
  return values[static_cast<std::size_t>(quantile * (values.size() - 1))];
}

void PlaceObjects(const sim::Scene& scene, const Pose& X_WE, collide::Checker& checker) {
  double x = -0.25;
  for (const sim::ObjectInfo& object : scene.objects()) {
    Pose X_WO;
    X_WO.p = {X_WE.p.x() + x, X_WE.p.y() + 0.2, object.rest_height + 0.002};
    checker.SetObject(object.name, X_WO);
    x += 0.1;
  }
}

void MeasureChecks(const std::shared_ptr<const sim::Scene>& scene, collide::Checker& checker) {
  sim::Kinematics kinematics(scene);
  Rng rng(1);
  std::vector<Eigen::VectorXd> configurations;
  for (int i = 0; i < 1000; ++i) {
    configurations.push_back(scene->arm().q_home);
    for (double& value : configurations.back()) value += rng.Uniform(-0.4, 0.4);
  }
  // interleaved, so that both sides see the same machine
  double check_s = 0, kinematics_s = 0;
  int checks = 0, hits = 0;
  for (int round = 0; round < 50; ++round) {
    Stopwatch watch;
    for (const auto& q : configurations) hits += checker.Check(q, 0.002).has_value() ? 1 : 0;
    check_s += watch.Seconds();
    watch.Restart();
    for (const auto& q : configurations) kinematics.ArmPoses(q, 0);
    kinematics_s += watch.Seconds();
    checks += static_cast<int>(configurations.size());
  }
  Print("state_checks", checks / check_s, "1/s", checks / kinematics_s);
  Print("state_checks_after_kinematics", checks / (check_s - kinematics_s), "1/s", 50000);
  Print("state_checks_in_collision", static_cast<double>(hits) / checks, "fraction", 1);
}

void MeasurePlans(const std::shared_ptr<const sim::Scene>& scene, collide::Checker& checker) {
  plan::Planner planner(scene);
  sim::Kinematics kinematics(scene);
  plan::Request request;
  request.q_start = scene->arm().q_home;
  const Pose X_WE = kinematics.X_WE(request.q_start);
  Rng rng(2);
  std::vector<double> straight, sampled, detour;
  int failed = 0;
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    request.X_WE_goal = X_WE;
    request.X_WE_goal.p += Eigen::Vector3d(rng.Uniform(-0.3, 0.3), rng.Uniform(0.05, 0.3), rng.Uniform(0, 0.15));
    Stopwatch watch;
    const plan::Outcome outcome = planner.Plan(request, checker, seed);
    const double ms = 1e3 * watch.Seconds();
    if (outcome.kind == plan::OutcomeKind::kStraight) {
      straight.push_back(ms);
    } else if (outcome.kind == plan::OutcomeKind::kSampled) {
      sampled.push_back(ms);
      detour.push_back(static_cast<double>(outcome.motion.steps()) /
                       plan::StraightMotion(X_WE, request.X_WE_goal, request.limits).steps());
    } else if (outcome.kind != plan::OutcomeKind::kGoalInCollision) {
      ++failed;
    }
  }
  if (straight.empty()) return;
  const double baseline = Quantile(straight, 0.5);
  Print("plan_straight_median", baseline, "ms", baseline);
  Print("plan_straight_p95", Quantile(straight, 0.95), "ms", baseline);
  if (!sampled.empty()) {
    Print("plan_sampled_median", Quantile(sampled, 0.5), "ms", baseline);
    Print("plan_sampled_p95", Quantile(sampled, 0.95), "ms", baseline);
    Print("plan_sampled_duration_median", Quantile(detour, 0.5), "of the blocked line's", 1);
    Print("plan_sampled_duration_p95", Quantile(detour, 0.95), "of the blocked line's", 1);
  }
  Print("plan_failed", failed, "of 300", 300);
}

// Ours against OMPL's RRT-Connect with FCL and its simplification, on the same scenes: medians of plan + simplify +
// time-parameterise, and of the path's length.
int MeasureAgainstPlain() {
  plan::BenchOptions options;
  options.scenes = 40;
  options.planners = {"etude", "rrtconnect"};
  options.difficulties = {"open", "cluttered"};
  const auto rows = plan::RunBench(options, [](int, int) {});
  if (!rows) {
    fmt::print(stderr, "planning_bench: {}\n", rows.error().message);
    return 1;
  }
  const auto all = [&](const std::string& planner, double plan::BenchRow::*member) {
    double sum = 0;
    for (const plan::BenchRow& row : *rows)
      if (row.planner == planner) sum += row.*member / static_cast<double>(options.difficulties.size());
    return sum;
  };
  Print("planning", all("etude", &plan::BenchRow::total_ms), "ms", all("rrtconnect", &plan::BenchRow::total_ms));
  Print("planning_joint_path", all("etude", &plan::BenchRow::joint_rad), "rad",
        all("rrtconnect", &plan::BenchRow::joint_rad));
  Print("planning_tool_path", all("etude", &plan::BenchRow::tool_m), "m", all("rrtconnect", &plan::BenchRow::tool_m));
  int solved = 0, scenes = 0;
  for (const plan::BenchRow& row : *rows) {
    solved += row.planner == "etude" ? row.solved : 0;
    scenes += row.planner == "etude" ? row.scenes : 0;
  }
  Print("planning_solved", solved, "of all", scenes);
  return 0;
}

}  // namespace
}  // namespace etude

int main() {
  auto scene = etude::sim::Scene::Build(etude::SceneSpec{});
  if (!scene) {
    fmt::print(stderr, "planning_bench: {}\n", scene.error().message);
    return 1;
  }
  etude::collide::Checker checker(*scene);
  etude::sim::Kinematics kinematics(*scene);
  etude::PlaceObjects(**scene, kinematics.X_WE((*scene)->arm().q_home), checker);
  etude::MeasureChecks(*scene, checker);
  etude::MeasurePlans(*scene, checker);
  return etude::MeasureAgainstPlain();
}
