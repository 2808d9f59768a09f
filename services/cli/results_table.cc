// SPDX-License-Identifier: Apache-2.0
#include "services/cli/results_table.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>
#include <optional>
#include <set>

#include "services/cli/results_comparison.h"
#include "services/cli/results_report.h"
#include "services/core/statistics.h"

namespace etude::cli {
namespace {

// What a figure of the paper does not share with the one beside it.
constexpr char kBesideThePaper[] =
    "\nBeside the paper's figures only `latched` may stand, which is its criterion; strict is held for 0.4 s without a "
    "violation. There: the network of its Table 4, 48 h on a GPU, 80 rollouts of each of several trainings, scenes and "
    "seeds not published. Here: the network that the row names (`compact` is small and reads places by soft-argmax), "
    "every module supervised by the simulator's state in each frame, scenes of the named seed that collection never "
    "draws, drawn anew until the expert can do the task (the share that was not is beside them), one training for each "
    "seed.\n";

// what is the goal but for its last binary digits has reached it
constexpr double kRounding = 1e-9;

/// Successes of several evaluations.
struct Count {
  std::uint64_t successes = 0, trials = 0;
  std::vector<double> shares;  ///< of each evaluation

  void Add(const OrderedJson& entry, const char* criterion) {
    const auto* judged = FindPart(entry, criterion);
    const auto n = CountAt(entry, "n");
    const auto good = judged ? CountAt(*judged, "successes") : std::nullopt;
    if (!n || !good || *n == 0 || *good > *n) return;
    successes += *good;
    trials += *n;
    shares.push_back(static_cast<double>(*good) / static_cast<double>(*n));
  }
  // of all rollouts: with seeds of unequally many, the mean of their shares may lie outside the rollouts' interval
  double percent() const {
    return trials == 0 ? 0 : 100 * static_cast<double>(successes) / static_cast<double>(trials);
  }
  bool reaches(double goal) const { return percent() >= goal - kRounding; }
  std::string text() const {
    if (trials == 0) return "-";
    const auto interval = WilsonInterval(successes, trials);
    return fmt::format("{:.1f} [{:.1f}, {:.1f}]", percent(), 100 * interval.low, 100 * interval.high);
  }
};

Count CountOf(const ResultLine& line, const char* criterion) {
  Count count;
  for (const auto& measured : line.reports)
    if (const auto* overall = FindPart(measured.report, "overall")) count.Add(*overall, criterion);
  return count;
}

std::string SeedsText(const Count& strict) {
  std::vector<std::string> shares;
  for (const double share : strict.shares) shares.push_back(fmt::format("{:.1f}", 100 * share));
  return fmt::format("{}", fmt::join(shares, ", "));
}

// What trained where that is known, else what was collected.
std::string DemonstrationsText(const ResultLine& line) {
  const ResultData& data = line.row->data;
  if (data.campaign.empty()) return "-";  // of the row whose runs these are
  std::set<std::string> counts;
  for (const auto& measured : line.reports)
    if (measured.train > 0)
      counts.insert(measured.valid > 0 ? fmt::format("{} + {} validation", measured.train, measured.valid)
                                       : std::to_string(measured.train));
  if (!counts.empty()) return fmt::format("{}", fmt::join(counts, "; "));
  return data.episodes > 0 ? std::to_string(data.episodes) : "the campaign's";
}

// The limit, and what each seed's training took where that is known.
std::string TrainingText(const ResultLine& line) {
  const ResultTraining& train = line.row->train;
  if (!train.runs_of.empty()) return "-";
  std::string text = train.steps > 0 ? fmt::format("{} steps", train.steps) : fmt::format("{:g} min", train.minutes);
  std::vector<std::string> took;
  for (const auto& measured : line.reports)
    if (measured.training_s > 0) took.push_back(fmt::format("{:.1f}", measured.training_s / 60));
  return took.empty() ? text : fmt::format("{} (took {} min)", text, fmt::join(took, ", "));
}

std::string BeginsText(const ResultTraining& train) {
  if (!train.runs_of.empty()) return fmt::format("runs of {}", train.runs_of);
  if (train.init.empty()) return "scratch";
  std::string text = train.init;
  if (!train.add.empty()) text += fmt::format(" + {}", fmt::join(train.add, " + "));
  if (!train.fresh.empty()) text += fmt::format(", anew: {}", fmt::join(train.fresh, ", "));
  if (!train.like.empty()) text += fmt::format(", like: {}", fmt::join(train.like, ", "));
  if (!train.freeze.empty()) text += fmt::format(", frozen: {}", fmt::join(train.freeze, ", "));
  return text;
}

// Of a definition: without the keys that have their default.
ResultTraining TrainingOf(const OrderedJson& definition) {
  const auto* train = FindPart(definition, "train");
  const auto read = train ? FromJson<ResultTraining>(*train, "train") : Result<ResultTraining>(ResultTraining());
  return read ? *read : ResultTraining();
}

// The policy that was trained (what begins with another row's has its network), and what else the training was told.
std::string NetworkText(const ResultRow& row) {
  constexpr std::string_view kPolicy = "policy=";
  const bool trains = row.train.runs_of.empty();
  if ((!trains || !row.train.init.empty()) && row.begins_with.is_null()) return "-";
  const OrderedJson* first = &row.begins_with;
  while (const auto* before = FindPart(*first, "begins_with")) first = before;
  const ResultTraining graph = first->is_null() ? row.train : TrainingOf(*first);
  std::string text = graph.config;
  for (const auto& set : graph.set)
    if (set.starts_with(kPolicy)) text = set.substr(kPolicy.size());
  const ResultTraining told = trains ? row.train : TrainingOf(row.begins_with);
  for (const auto& set : told.set)
    if (!set.starts_with(kPolicy)) text += ", " + set;
  return text;
}

// With the share of scenes that were taken as they were drawn first.
std::string ScenesText(const ResultLine& line) {
  const ResultEvaluation& eval = line.row->eval;
  std::string text = eval.scenes.empty() ? "nominal" : eval.scenes;
  std::vector<double> first;
  for (const auto& measured : line.reports) {
    const auto* share = FindPart(measured.report, "scenes", "first_draw");
    if (share && share->is_number()) first.push_back(100 * share->get<double>());
  }
  text += fmt::format(", seed {}", eval.seed);
  if (!first.empty()) text += fmt::format(", {:.0f} % first draws", Mean(first));
  return text;
}

std::string MadeText(const ResultLine& line) {
  std::set<std::string> made;
  for (const auto& measured : line.reports) made.insert(measured.made);
  return fmt::format("{}", fmt::join(made, "; "));
}

std::string RowText(const ResultLine& line) {
  const ResultRow& row = *line.row;
  const Count strict = CountOf(line, "success"), latched = CountOf(line, "success_latched");
  const std::string goal =
      row.goal > 0 ? fmt::format("{:g}{}", row.goal, strict.reaches(row.goal) ? "" : " (missed)") : "";
  // with its name, by which other rows, --row and the texts call it
  return fmt::format("| {} `{}` | {} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {} |\n", row.title, row.name,
                     DemonstrationsText(line), TrainingText(line), BeginsText(row.train), strict.text(),
                     SeedsText(strict), latched.text(), row.paper.empty() ? "-" : row.paper, goal, NetworkText(row),
                     ScenesText(line), MadeText(line));
}

// Of each module in the order in which they were measured: means over rollouts of their decisions' means, cm.
struct ModuleErrors {
  std::vector<std::string> order;
  std::map<std::string, std::vector<double>> all, before_contact;  ///< of each seed

  static std::string Text(const std::vector<double>& values) {
    return values.empty() ? "-" : fmt::format("{:.2f}", Mean(values));
  }
};

ModuleErrors ModuleErrorsOf(const ResultLine& line) {
  ModuleErrors result;
  for (const auto& measured : line.reports) {
    const auto* errors = FindPart(measured.report, "overall", "error_cm");
    if (!errors || !errors->is_object()) continue;
    for (const auto& [module, error] : errors->items()) {
      if (!error.is_number()) continue;
      if (!result.all.contains(module)) result.order.push_back(module);
      result.all[module].push_back(error.get<double>());
      const auto* number = FindPart(measured.report, "overall", "error_before_contact_cm", module.c_str());
      if (number && number->is_number()) result.before_contact[module].push_back(number->get<double>());
    }
  }
  return result;
}

std::string ErrorsText(const ResultLine& line) {
  ModuleErrors errors = ModuleErrorsOf(line);
  std::string lines;
  for (const auto& module : errors.order)
    lines += fmt::format("| {} | {} | {} | {} |\n", line.row->title, module, ModuleErrors::Text(errors.all[module]),
                         ModuleErrors::Text(errors.before_contact[module]));
  return lines;
}

std::string TasksText(const ResultLine& line) {
  std::vector<std::string> order;
  std::map<std::string, Count> strict, latched;
  for (const auto& measured : line.reports) {
    const auto* tasks = FindPart(measured.report, "per_task");
    if (!tasks || !tasks->is_array()) continue;
    for (const auto& entry : *tasks) {
      const auto* name = FindPart(entry, "task");
      const std::string task = name && name->is_string() ? name->get<std::string>() : "?";
      if (!strict.contains(task)) order.push_back(task);
      strict[task].Add(entry, "success");
      latched[task].Add(entry, "success_latched");
    }
  }
  std::string text;
  for (const auto& task : order)
    text += fmt::format("| {} | {} | {} | {} |\n", line.row->title, task, strict[task].text(), latched[task].text());
  return text;
}

// Of each seed: who succeeded where the other did not, and whether that may be chance; then of all of them.
std::string ComparisonsText(const ResultLine& line) {
  std::string text;
  const auto add = [&](const std::string& seed, const std::string& what) {
    text += fmt::format("| {} | {} | {} | {} |\n", line.row->title, line.row->compare, seed, what);
  };
  for (const auto& measured : line.reports) {
    const auto paired = PairedRollouts::From(measured.report);
    if (paired) add(std::to_string(measured.seed), paired->text());
    if (!MissingComparison(measured.report).empty()) add(std::to_string(measured.seed), "missing | | | |");
  }
  if (const PairedRollouts all = PairedRollouts::Of(line); all.seeds > 1) add("all", all.text());
  return text;
}

// What was measured of something that is wanted.
struct GoalCheck {
  std::string wanted, measured = "-";
  std::optional<bool> reached;
};

GoalCheck CheckLatched(const ResultLine& line, double goal) {
  GoalCheck check{fmt::format("latched at least {:g} %", goal)};
  const Count latched = CountOf(line, "success_latched");
  if (latched.trials == 0) return check;
  check.measured = latched.text();
  check.reached = latched.reaches(goal);
  return check;
}

GoalCheck CheckDrop(const ResultLine& line, double goal) {
  GoalCheck check{fmt::format("at most {:g} points below {}", goal, line.row->compare)};
  const PairedRollouts paired = PairedRollouts::Of(line);
  if (paired.n == 0) return check;
  // the other way round than in the comparisons; 0 is no -0
  const Interval interval = paired.interval();
  check.measured = fmt::format("{:.1f}", 0 - paired.difference());
  if (paired.seeds == 1) check.measured += fmt::format(" [{:.1f}, {:.1f}]", 0 - interval.high, 0 - interval.low);
  check.reached = -paired.difference() <= goal + kRounding;
  return check;
}

// Several seeds' rollouts of a scene are no independent cases: of one seed alone.
GoalCheck CheckBetter(const ResultLine& line, double goal) {
  GoalCheck check{fmt::format("better than {}, p below {:g}", line.row->compare, goal)};
  const PairedRollouts paired = PairedRollouts::Of(line);
  if (paired.seeds != 1) return check;
  const double p = McNemarExactP(paired.only_first, paired.only_second);
  check.measured = fmt::format("{:+.1f} points, p = {:.2g}", paired.difference(), p);
  check.reached = paired.only_first > paired.only_second && p < goal;
  return check;
}

// each of the trainings
GoalCheck CheckMinutes(const ResultLine& line, double goal) {
  GoalCheck check{fmt::format("training at most {:g} min", goal)};
  double longest = 0;
  for (const auto& measured : line.reports) {
    if (measured.training_s == 0) return check;
    longest = std::max(longest, measured.training_s / 60);
  }
  if (longest == 0) return check;
  check.measured = fmt::format("{:.1f}", longest);
  check.reached = longest <= goal + kRounding;
  return check;
}

GoalCheck CheckError(const ResultLine& line, const std::string& module, double goal) {
  GoalCheck check{fmt::format("{} at most {:g} cm", module, goal)};
  ModuleErrors errors = ModuleErrorsOf(line);
  if (errors.all[module].empty()) return check;
  check.measured = fmt::format("{} (before contact {})", ModuleErrors::Text(errors.all[module]),
                               ModuleErrors::Text(errors.before_contact[module]));
  check.reached = Mean(errors.all[module]) <= goal + kRounding;
  return check;
}

// What is wanted beside strict success, which has a column.
std::string GoalsText(const ResultLine& line) {
  std::string text;
  for (const auto& [key, goal] : line.row->goals) {
    const GoalCheck check = key == kGoalLatched   ? CheckLatched(line, goal)
                            : key == kGoalDrop    ? CheckDrop(line, goal)
                            : key == kGoalBetter  ? CheckBetter(line, goal)
                            : key == kGoalMinutes ? CheckMinutes(line, goal)
                                                  : CheckError(line, key, goal);
    text += fmt::format("| {} | {} | {} | {} |\n", line.row->title, check.wanted, check.measured,
                        !check.reached   ? "not measured"
                        : *check.reached ? "yes"
                                         : "missed");
  }
  return text;
}

}  // namespace

std::string ResultsTable(const std::vector<ResultLine>& lines) {
  std::string rows, goals, tasks, errors, comparisons;
  for (const auto& line : WithComparisonsThatHold(lines)) {
    if (line.reports.empty()) continue;
    rows += RowText(line);
    goals += GoalsText(line);
    tasks += TasksText(line);
    errors += ErrorsText(line);
    comparisons += ComparisonsText(line);
  }
  return "| what | demonstrations | training | begins with | strict success % [95 % of these runs' rollouts] | each "
         "seed | latched % [95 %] | paper % | goal % | network | scenes | made |\n"
         "|---|---|---|---|---|---|---|---|---|---|---|---|\n" +
         rows + kBesideThePaper +
         (goals.empty() ? "" : "\n| what | goal | measured | reached |\n|---|---|---|---|\n" + goals) +
         "\n| what | task | strict % [95 %] | latched % [95 %] |\n|---|---|---|---|\n" + tasks +
         "\n| what | module | error cm | before contact |\n|---|---|---|---|\n" + errors +
         (comparisons.empty()
              ? ""
              : "\n| what | against row | seed | same scenes | success only here | only there | "
                "difference, points [95 %] | p (McNemar, exact) |\n|---|---|---|---|---|---|---|---|\n" +
                    comparisons);
}

}  // namespace etude::cli
