// SPDX-License-Identifier: Apache-2.0
// etude-plan: measures the planners.
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>

#include "services/core/command.h"
#include "services/core/command_table.h"
#include "services/core/file.h"
#include "worker/plan/bench/measure.h"

namespace etude {
namespace {

struct Arguments {
  plan::BenchOptions bench;
  std::string json;
};

void AddBench(CLI::App& app, Arguments& arguments) {
  auto* bench = app.add_subcommand("bench", "planners over seeded scenes: time, success, length, clearance");
  plan::BenchOptions& options = arguments.bench;
  bench->add_option("--robots", options.robots, "arms, by name")->delimiter(',')->capture_default_str();
  bench
      ->add_option("--planners", options.planners,
                   "etude: the straight line, else RRT-Connect; rrtconnect: OMPL's with FCL, simplified; field: the "
                   "potential field")
      ->delimiter(',')
      ->capture_default_str();
  bench->add_option("--difficulties", options.difficulties, "open | cluttered | narrow")
      ->delimiter(',')
      ->capture_default_str();
  bench->add_option("--scenes", options.scenes, "of each difficulty")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  bench->add_option("--seed", options.seed, "of the scenes")->capture_default_str();
  bench->add_option("--deadline", options.deadline_s, "s; later is not solved")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  bench->add_option("--json", arguments.json, "also write the table to this file");
  bench->footer(
      "Times are medians over the scenes that a planner solved, p95 that of the whole. Solved: within the deadline, "
      "and\n"
      "free of contact when its motion is looked at again, four times as closely as planners look.");
}

Status Bench(const Arguments& arguments) {
  const bool terminal = ::isatty(STDERR_FILENO) == 1;
  int shown = -1;
  const auto progress = [&](int done, int all) {
    const int percent = 100 * done / all;
    if (percent == shown || (!terminal && percent % 10 != 0)) return;
    shown = percent;
    fmt::print(stderr, "{}{} of {} scenes{}", terminal ? "\r" : "", done, all, terminal && done < all ? "" : "\n");
  };
  ETUDE_ASSIGN_OR_RETURN(const auto rows, plan::RunBench(arguments.bench, progress));
  fmt::print("{}", plan::BenchTable(rows));
  if (arguments.json.empty()) return {};
  OrderedJson json = OrderedJson::array();
  for (const plan::BenchRow& row : rows) json.push_back(row.Json());
  return WriteFileAtomically(arguments.json, json.dump(1) + "\n");
}

}  // namespace
}  // namespace etude

int main(int argc, char** argv) {
  etude::Arguments arguments;
  CLI::App app("Plans motions apart from any campaign, to measure the planners.", "etude plan");
  app.require_subcommand(1);
  etude::AddBench(app, arguments);
  if (const auto ended = etude::ParseCommandLine(app, argc, argv)) return *ended;
  return etude::RunMain("etude-plan", [&] { return etude::Bench(arguments); });
}
