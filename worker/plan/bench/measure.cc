// SPDX-License-Identifier: Apache-2.0
#include "worker/plan/bench/measure.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>

#include "services/core/statistics.h"
#include "services/core/stop.h"
#include "worker/plan/bench/plain_rrt.h"

namespace etude::plan {
namespace {

// One plan on one scene.
struct Sample {
  OutcomeKind kind = OutcomeKind::kNoPath;
  bool solved = false, in_contact = false;
  Outcome::Times times;
  double joint_rad = 0, tool_m = 0, duration_s = 0, clearance_mm = 0;
};

/// The planners of one arm.
class Contestants {
 public:
  Contestants(const std::shared_ptr<const sim::Scene>& scene, const BenchOptions& options)
      : options_(options),
        scene_(scene),
        checker_(scene),
        kinematics_(scene),
        ours_(scene),
        plain_(scene, options.seed) {}

  std::optional<PlanningScene> Draw(Difficulty difficulty, int index) {
    return DrawPlanningScene(*scene_, difficulty, options_.seed, index, kinematics_, checker_);
  }
  Sample Measure(const std::string& planner, const PlanningScene& planning, int index);

 private:
  void Look(const Motion& motion, const Eigen::VectorXd& q_start, Sample& sample);

  const BenchOptions& options_;
  std::shared_ptr<const sim::Scene> scene_;
  collide::Checker checker_;
  sim::Kinematics kinematics_;
  Planner ours_;
  PlainRrt plain_;
};

// Follows the motion as the arm does, and looks at it four times as closely as planners sample.
void Contestants::Look(const Motion& motion, const Eigen::VectorXd& q_start, Sample& sample) {
  constexpr int kClearanceStride = 4;
  Eigen::VectorXd q = q_start;
  double clearance = 1e9;
  for (int k = 0; k < motion.steps(); ++k) {
    const auto next = kinematics_.Solve(motion.X_WE[k], q);
    if (!next || checker_.CheckSegment(q, *next, PlannerConfig{}.resolution / 4)) {
      sample.in_contact = true;
      return;
    }
    sample.joint_rad += (*next - q).norm();
    if (k > 0) sample.tool_m += (motion.X_WE[k].p - motion.X_WE[k - 1].p).norm();
    q = *next;
    if (k % kClearanceStride == 0) clearance = std::min(clearance, checker_.Nearest(q).distance);
  }
  sample.clearance_mm = 1e3 * clearance;
  sample.duration_s = (motion.steps() - 1) / kControlRate;
}

Sample Contestants::Measure(const std::string& planner, const PlanningScene& planning, int index) {
  Place(*scene_, planning, checker_);
  Request request;
  request.q_start = planning.q_start;
  request.X_WE_goal = planning.X_WE_goal;
  if (planner == "field") request.method = Method::kPotentialField;
  const Outcome outcome = planner == "rrtconnect" ? plain_.Plan(request, checker_, options_.deadline_s)
                                                  : ours_.Plan(request, checker_, static_cast<std::uint64_t>(index));
  Sample sample;
  sample.kind = outcome.kind;
  sample.times = outcome.times;
  if (!outcome.planned()) return sample;
  Look(outcome.motion, planning.q_start, sample);
  const double total = outcome.times.plan + outcome.times.simplify + outcome.times.parameterise;
  sample.solved = !sample.in_contact && total <= options_.deadline_s;
  return sample;
}

template <class Get>
double Of(const std::vector<Sample>& samples, double quantile, Get get) {
  std::vector<double> values;
  for (const Sample& sample : samples)
    if (sample.solved) values.push_back(get(sample));
  return values.empty() ? 0 : Quantile(values, quantile);
}

BenchRow Summarize(const std::vector<Sample>& samples) {
  BenchRow row;
  row.scenes = static_cast<int>(samples.size());
  std::map<std::string, int> kinds;
  for (const Sample& sample : samples) {
    row.solved += sample.solved ? 1 : 0;
    row.in_contact += sample.in_contact ? 1 : 0;
    ++kinds[std::string(ToString(sample.kind))];
  }
  row.kinds.assign(kinds.begin(), kinds.end());
  const auto times = [&](double& median, double& p95, auto get) {
    median = Of(samples, 0.5, get);
    p95 = Of(samples, 0.95, get);
  };
  times(row.plan_ms, row.plan_p95_ms, [](const Sample& s) { return 1e3 * s.times.plan; });
  times(row.simplify_ms, row.simplify_p95_ms, [](const Sample& s) { return 1e3 * s.times.simplify; });
  times(row.parameterise_ms, row.parameterise_p95_ms, [](const Sample& s) { return 1e3 * s.times.parameterise; });
  times(row.total_ms, row.total_p95_ms,
        [](const Sample& s) { return 1e3 * (s.times.plan + s.times.simplify + s.times.parameterise); });
  row.joint_rad = Of(samples, 0.5, [](const Sample& s) { return s.joint_rad; });
  row.tool_m = Of(samples, 0.5, [](const Sample& s) { return s.tool_m; });
  row.duration_s = Of(samples, 0.5, [](const Sample& s) { return s.duration_s; });
  row.clearance_mm = Of(samples, 0.5, [](const Sample& s) { return s.clearance_mm; });
  return row;
}

Status CheckNames(const BenchOptions& options) {
  for (const std::string& planner : options.planners)
    if (std::ranges::count(KnownPlanners(), planner) == 0)
      return Fail(Code::kInvalidArgument, fmt::format("planner '{}': {}", planner, fmt::join(KnownPlanners(), ", ")));
  for (const std::string& difficulty : options.difficulties) ETUDE_RETURN_IF_ERROR(ParseDifficulty(difficulty));
  return {};
}

}  // namespace

const std::vector<std::string>& KnownPlanners() {
  static const std::vector<std::string> names{"etude", "rrtconnect", "field"};
  return names;
}

OrderedJson BenchRow::Json() const {
  OrderedJson outcomes = OrderedJson::object();
  for (const auto& [kind, count] : kinds) outcomes[kind] = count;
  const auto split = [](double plan, double simplify, double parameterise, double total) {
    return OrderedJson{{"plan", plan}, {"simplify", simplify}, {"parameterise", parameterise}, {"total", total}};
  };
  return {{"robot", robot},
          {"difficulty", difficulty},
          {"planner", planner},
          {"scenes", scenes},
          {"solved", solved},
          {"in_contact", in_contact},
          {"median_ms", split(plan_ms, simplify_ms, parameterise_ms, total_ms)},
          {"p95_ms", split(plan_p95_ms, simplify_p95_ms, parameterise_p95_ms, total_p95_ms)},
          {"joint_rad", joint_rad},
          {"tool_m", tool_m},
          {"duration_s", duration_s},
          {"clearance_mm", clearance_mm},
          {"outcomes", outcomes}};
}

Result<std::vector<BenchRow>> RunBench(const BenchOptions& options,
                                       const std::function<void(int done, int all)>& progress) {
  ETUDE_RETURN_IF_ERROR(CheckNames(options));
  const int all = static_cast<int>(options.robots.size() * options.difficulties.size()) * options.scenes;
  int done = 0;
  std::vector<BenchRow> rows;
  for (const std::string& robot : options.robots) {
    SceneSpec spec;
    spec.robot = robot;
    ETUDE_ASSIGN_OR_RETURN(const auto scene, sim::Scene::Build(spec));
    Contestants contestants(scene, options);
    for (const std::string& name : options.difficulties) {
      ETUDE_ASSIGN_OR_RETURN(const Difficulty difficulty, ParseDifficulty(name));
      std::map<std::string, std::vector<Sample>> samples;
      for (int index = 0; index < options.scenes; ++index) {
        if (StopRequested())
          return Fail(Code::kExhausted, fmt::format("plan bench: stopped after {} of {} scenes", done, all));
        if (const auto planning = contestants.Draw(difficulty, index))
          for (const std::string& planner : options.planners)
            samples[planner].push_back(contestants.Measure(planner, *planning, index));
        progress(++done, all);
      }
      for (const std::string& planner : options.planners) {
        BenchRow row = Summarize(samples[planner]);
        row.robot = robot;
        row.difficulty = name;
        row.planner = planner;
        rows.push_back(std::move(row));
      }
    }
  }
  return rows;
}

std::string BenchTable(const std::vector<BenchRow>& rows) {
  std::string text = fmt::format("{:<8}{:<11}{:<12}{:>9}{:>9}{:>9}{:>10}{:>9}{:>9}{:>8}{:>8}{:>8}{:>10}\n", "robot",
                                 "scenes", "planner", "solved", "plan ms", "simplify", "param.", "total", "p95", "rad",
                                 "tool m", "s", "clear mm");
  for (const BenchRow& row : rows)
    text += fmt::format(
        "{:<8}{:<11}{:<12}{:>9}{:>9.2f}{:>9.2f}{:>10.2f}{:>9.2f}{:>9.2f}{:>8.2f}{:>8.3f}{:>8.2f}{:>10.1f}\n", row.robot,
        row.difficulty, row.planner, fmt::format("{}/{}", row.solved, row.scenes), row.plan_ms, row.simplify_ms,
        row.parameterise_ms, row.total_ms, row.total_p95_ms, row.joint_rad, row.tool_m, row.duration_s,
        row.clearance_mm);
  for (const BenchRow& ours : rows) {
    const auto plain = std::ranges::find_if(rows, [&](const BenchRow& row) {
      return row.planner == "rrtconnect" && row.robot == ours.robot && row.difficulty == ours.difficulty;
    });
    if (ours.planner == "rrtconnect" || plain == rows.end() || plain->solved == 0 || ours.solved == 0) continue;
    text +=
        fmt::format("{} {}: {} takes {:.2f} of rrtconnect's time, {:.2f} of its joints' path, {:.2f} of its tool's\n",
                    ours.robot, ours.difficulty, ours.planner, ours.total_ms / plain->total_ms,
                    ours.joint_rad / plain->joint_rad, ours.tool_m / plain->tool_m);
  }
  return text;
}

}  // namespace etude::plan
