// SPDX-License-Identifier: Apache-2.0
// `etude results`: makes the rows of a table of results from nothing, and the table.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <filesystem>
#include <optional>
#include <set>

#include "services/campaign/eval_comparison.h"
#include "services/campaign/eval_report.h"
#include "services/campaign/process.h"
#include "services/campaign/spec_file.h"
#include "services/cli/command_line.h"
#include "services/cli/evaluation.h"
#include "services/cli/results_folder.h"
#include "services/cli/results_record.h"
#include "services/cli/results_report.h"
#include "services/cli/results_table.h"
#include "services/cli/sentence_suite.h"
#include "services/cli/sibling_text.h"
#include "services/core/clock.h"
#include "services/core/command.h"
#include "services/core/log.h"
#include "services/core/share.h"
#include "services/core/stop.h"

namespace etude::cli {
namespace {

namespace fs = std::filesystem;

struct ResultsArguments {
  std::string file = "deploy/docs/results.yaml", out = "out/results", write;
  std::vector<std::string> only;
  std::vector<std::uint64_t> seeds;
  std::uint32_t domain = 0;
};

using Words = std::vector<std::string>;
constexpr const char* kWhole = "whole";  // in a run's folder: it has come to its end
constexpr const char* kMade = "made";    // in an evaluation's folder: when and where it was made

/// Runs commands of `etude` one after another, each with a log of its own.
class Maker {
 public:
  /// @param config  that is valid; both have to outlive it
  Maker(const ResultsArguments& arguments, const ResultsConfig& config)
      : arguments_(arguments), config_(config), out_(arguments.out) {}

  /// Makes what is not there already of one training seed of `row`. @returns what the table keeps of it; where the row
  /// is compared with another one that cannot be, report["comparison"] says why ("missing")
  Result<ResultReport> Make(const ResultRow& row, std::uint64_t seed) {
    ETUDE_ASSIGN_OR_RETURN(OrderedJson report, MakeReport(row, seed));
    if (!row.compare.empty()) report["comparison"] = ComparisonOf(row, seed);
    ResultReport made{.seed = seed, .made = MadeOf(row, seed) + VersionsText(report), .report = BriefReport(report)};
    if (!row.train.runs_of.empty()) return made;
    made.training_s = TrainingSeconds(RunOf(row.name, seed)).value_or(0);
    if (const auto count = CountDemonstrations(DataOf(row))) {
      made.train = count->train;
      made.valid = count->valid;
    }
    return made;
  }

 private:
  Result<OrderedJson> MakeReport(const ResultRow& row, std::uint64_t seed) {
    ETUDE_RETURN_IF_ERROR(CheckDefinition(out_, row));
    if (!row.train.runs_of.empty()) return EvaluateRunOf(row, seed);
    const Path run = RunOf(row.name, seed);
    if (!IsWholeRun(run)) {
      // asked before hours of collecting
      ETUDE_ASSIGN_OR_RETURN(const Words words, TrainingWords(row, seed, run));
      ETUDE_RETURN_IF_ERROR(CheckTraining(words));
      ETUDE_RETURN_IF_ERROR(CheckEvaluation(row));
      // from here on there is something of it
      ETUDE_RETURN_IF_ERROR(KeepDefinition(out_, row));
      ETUDE_RETURN_IF_ERROR(Collect(row));
      ETUDE_RETURN_IF_ERROR(Train(row, seed, run, words));
    }
    return Evaluate(row, seed, run);
  }

  // What `etude eval` would say of it, behind hours of training.
  Status CheckEvaluation(const ResultRow& row) const {
    const Status good = ValidateEvaluation(row.eval);
    if (good) return {};
    return Fail(good.error().Wrap("eval"));
  }

  Status ValidateEvaluation(const ResultEvaluation& eval) const {
    CampaignSpec base;
    if (!eval.scenes.empty()) {
      ETUDE_ASSIGN_OR_RETURN(base, campaign::LoadSpecOrDataset({FileOf(eval.scenes), {}, {}, {}}));
    }
    EvaluationOptions options{.run = "run", .tasks = eval.tasks, .episodes = eval.episodes, .out = out_ / "eval"};
    if (!eval.sentences.empty()) {
      ETUDE_ASSIGN_OR_RETURN(options.sentences, LoadSentences(eval.sentences));
      options.episodes = eval.scenes_each * options.sentences.size();
    }
    if (eval.occlude > 0) options.occlude = eval.occlude;
    if (eval.pushes > 0) options.pushes = static_cast<int>(std::min<std::uint64_t>(eval.pushes, 1'000));
    ETUDE_RETURN_IF_ERROR(campaign::WithOverrides(EvaluationSpec(base, options), eval.set));
    return {};
  }

  // The row's own rollouts are worth a line without it.
  OrderedJson ComparisonOf(const ResultRow& row, std::uint64_t seed) const {
    const ResultRow& other = *std::ranges::find(config_.rows, row.compare, &ResultRow::name);
    const auto compare = [&]() -> Result<OrderedJson> {
      ETUDE_RETURN_IF_ERROR(CheckDefinition(out_, other));
      const std::string& trained = other.train.runs_of.empty() ? other.name : other.train.runs_of;
      ETUDE_RETURN_IF_ERROR(CheckEvaluated(ReportOf(other, seed), CheckpointOf(RunOf(trained, seed))));
      const auto report = ReadReport(other, seed);
      if (!report)
        return Fail(Code::kNotFound,
                    fmt::format("'{}' is no whole evaluation: make that row first", ReportOf(other, seed).string()));
      ETUDE_ASSIGN_OR_RETURN(OrderedJson compared,
                             campaign::CompareEvaluations(ReportOf(row, seed), ReportOf(other, seed)));
      compared["with_sha256"] = RolloutsHash(*report);
      return compared;
    };
    auto compared = compare();
    OrderedJson comparison = OrderedJson::object();
    if (compared)
      comparison = std::move(*compared);
    else
      comparison["missing"] = fmt::format("compare with row '{}': {}", other.name, compared.error().message);
    comparison["with"] = other.name;
    return comparison;
  }

  Path RunOf(const std::string& row, std::uint64_t seed) const {
    return out_ / "runs" / fmt::format("{}-{}", row, seed);
  }
  static Path CheckpointOf(const Path& run) { return run / "checkpoints" / "latest.safetensors"; }
  static bool IsWholeRun(const Path& run) {
    std::error_code ignored;
    return fs::exists(run / kWhole, ignored);
  }
  Path ReportOf(const ResultRow& row, std::uint64_t seed) const {
    return out_ / "eval" / fmt::format("{}-{}", row.name, seed);
  }

  std::optional<OrderedJson> ReadReport(const ResultRow& row, std::uint64_t seed) const {
    auto json = campaign::ReadReport(ReportOf(row, seed));
    // how many sentences there are is the suite's
    const auto wanted = row.eval.sentences.empty() ? row.eval.episodes : CountAt(json, "episodes");
    return wanted && IsWholeReport(json, *wanted) ? std::optional(std::move(json)) : std::nullopt;
  }

  // Of an evaluation that an earlier version made nothing is known but that it is there.
  std::string MadeOf(const ResultRow& row, std::uint64_t seed) const {
    const auto text = ReadTextFile(ReportOf(row, seed) / kMade);
    return text && !text->empty() ? text->substr(0, text->find('\n')) : MadeHere();
  }

  Status Run(const std::string& what, Words words) {
    Words argv{(ProgramFolder() / "etude").string()};
    argv.insert(argv.end(), words.begin(), words.end());
    argv.insert(argv.end(), {"--domain", std::to_string(arguments_.domain)});
    const Path log = out_ / "logs" / (what + ".log");
    ETUDE_RETURN_IF_ERROR(MakeFolders(log.parent_path()));
    fmt::print("{}: etude {}\n", what, fmt::join(words, " "));
    std::fflush(stdout);
    ETUDE_ASSIGN_OR_RETURN(auto process, campaign::Process::Start({.argv = argv, .log = log}));
    const Stopwatch watch;
    while (process.running() && !StopRequested()) (void)process.Wait(std::chrono::milliseconds(500));
    // Ctrl-C reaches both: one that ended well because it was told to is not at its end
    if (StopRequested()) {
      process.Stop(std::chrono::seconds(60));
      return Fail(Code::kExhausted, fmt::format("stopped in {}; begin again to go on", what));
    }
    if (const int code = process.Poll().value_or(1); code != 0)
      return Fail(CodeForExit(code), fmt::format("{} ended with {}: see {}", what, code, log.string()));
    fmt::print("{}: {}\n", what, FormatDuration(watch.Seconds()));
    return {};
  }

  static Words Sets(const std::vector<std::string>& set) {
    Words words;
    for (const auto& text : set) words.insert(words.end(), {"--set", text});
    return words;
  }

  static std::string FileOf(const std::string& campaign) {
    if (campaign.ends_with(".yaml")) return campaign;
    const auto folder = FindShared("campaigns");  // those that come with the programs, wherever one stands
    return (folder.value_or("deploy/campaigns") / (campaign + ".yaml")).string();
  }

  Path DataOf(const ResultRow& row) const { return out_ / "data" / DatasetName(row); }

  // a collection that is whole already is over at once; one that fails is tried again by what needs it next
  Status Collect(const ResultRow& row) {
    const std::string name = DatasetName(row);
    const Path data = DataOf(row);
    if (collected_.contains(name)) return {};
    Words words{"collect", FileOf(row.data.campaign), "--out", data.string()};
    if (row.data.episodes > 0) words.insert(words.end(), {"--episodes", std::to_string(row.data.episodes)});
    const Words set = Sets(row.data.set);
    words.insert(words.end(), set.begin(), set.end());
    ETUDE_RETURN_IF_ERROR(Run("data-" + name, words));
    ETUDE_RETURN_IF_ERROR(CheckWholeDataset(data, row.data.episodes));
    collected_.insert(name);
    return {};
  }

  // the run of the same seed; where the row is not trained with that one, of the first one that is there. Of a run that
  // was stopped, the latest checkpoint is not what the row's training makes
  Result<Path> InitOf(const ResultRow& row, std::uint64_t seed) const {
    const ResultRow& init = *std::ranges::find(config_.rows, row.train.init, &ResultRow::name);
    ETUDE_RETURN_IF_ERROR(CheckRuns(out_, init));
    const auto& seeds = init.train.seeds;
    const bool has_seed = std::ranges::find(seeds, seed) != seeds.end();
    const std::vector<std::uint64_t> candidates = has_seed ? std::vector{seed} : seeds;
    std::error_code ignored;
    for (const std::uint64_t candidate : candidates) {
      const Path run = RunOf(init.name, candidate);
      Path file = CheckpointOf(run);
      if (IsWholeRun(run) && fs::exists(file, ignored)) return file;
    }
    return Fail(Code::kNotFound,
                fmt::format("row '{}' begins with '{}', of which no run of seed {} in '{}' has come to "
                            "its end: leave out --row, or name both",
                            row.name, init.name, fmt::join(candidates, ", "), (out_ / "runs").string()));
  }

  // how the run begins; one that was stopped goes on as what it is
  Result<Words> BeginningOf(const ResultRow& row, std::uint64_t seed, const Path& run) const {
    std::error_code ignored;
    const ResultTraining& train = row.train;
    if (fs::exists(run / "training_state.safetensors", ignored)) return Words{"--resume"};
    if (train.init.empty()) return Words{"--config", train.config};
    ETUDE_ASSIGN_OR_RETURN(const Path init, InitOf(row, seed));
    Words words{"--init", init.string()};
    for (const auto& [option, names] : {std::pair{"--add", &train.add},
                                        {"--fresh", &train.fresh},
                                        {"--freeze", &train.freeze},
                                        {"--like", &train.like}})
      if (!names->empty()) words.insert(words.end(), {option, fmt::format("{}", fmt::join(*names, ","))});
    return words;
  }

  // what the trainer is told, but for the bus
  Result<Words> TrainingWords(const ResultRow& row, std::uint64_t seed, const Path& run) const {
    const ResultTraining& train = row.train;
    Words words{"--data", DataOf(row).string(), "--out", run.string(), "--seed", std::to_string(seed), "--offline"};
    if (train.steps > 0) words.insert(words.end(), {"--steps", std::to_string(train.steps)});
    if (train.minutes > 0) words.insert(words.end(), {"--minutes", fmt::format("{}", train.minutes)});
    ETUDE_ASSIGN_OR_RETURN(const Words beginning, BeginningOf(row, seed, run));
    words.insert(words.end(), beginning.begin(), beginning.end());
    const Words set = Sets(train.set);
    words.insert(words.end(), set.begin(), set.end());
    return words;
  }

  static Status CheckTraining(Words words) {
    words.emplace_back("--check");
    const Status good = CheckBySibling("etude-trainer", std::move(words));
    if (good) return {};
    return Fail(good.error().Wrap("train"));
  }

  Status Train(const ResultRow& row, std::uint64_t seed, const Path& run, Words words) {
    words.insert(words.begin(), "train");
    ETUDE_RETURN_IF_ERROR(Run(fmt::format("train-{}-{}", row.name, seed), std::move(words)));
    ETUDE_RETURN_IF_ERROR(CheckFinished(run));
    return WriteFileAtomically(run / kWhole, "\n");
  }

  Result<OrderedJson> EvaluateRunOf(const ResultRow& row, std::uint64_t seed) {
    const std::string& trained = row.train.runs_of;
    ETUDE_RETURN_IF_ERROR(CheckRuns(out_, *std::ranges::find(config_.rows, trained, &ResultRow::name)));
    const Path run = RunOf(trained, seed);
    if (!IsWholeRun(run))
      return Fail(
          Code::kNotFound,
          fmt::format("row '{}' evaluates the runs of '{}', and '{}' has not come to its end: make that row first",
                      row.name, trained, run.string()));
    return Evaluate(row, seed, run);
  }

  Words EvaluationOf(const ResultEvaluation& eval) const {
    Words words{"--seed", std::to_string(eval.seed)};
    const auto add = [&](bool wanted, const char* option, std::string value) {
      if (wanted) words.insert(words.end(), {option, std::move(value)});
    };
    add(eval.sentences.empty(), "--episodes", std::to_string(eval.episodes));
    add(!eval.sentences.empty(), "--sentences", eval.sentences);
    add(!eval.sentences.empty(), "--scenes-each", std::to_string(eval.scenes_each));
    add(!eval.scenes.empty(), "--scenes", FileOf(eval.scenes));
    add(!eval.tasks.empty(), "--tasks", fmt::format("{}", fmt::join(eval.tasks, ",")));
    add(eval.occlude > 0, "--occlude", fmt::format("{:g}", eval.occlude));
    add(eval.pushes > 0, "--pushes", std::to_string(eval.pushes));
    if (eval.any_camera) words.emplace_back("--any-camera");
    const Words set = Sets(eval.set);
    words.insert(words.end(), set.begin(), set.end());
    return words;
  }

  Result<OrderedJson> Evaluate(const ResultRow& row, std::uint64_t seed, const Path& run) {
    ETUDE_RETURN_IF_ERROR(CheckEvaluated(ReportOf(row, seed), CheckpointOf(run)));
    ETUDE_RETURN_IF_ERROR(KeepDefinition(out_, row));
    if (auto report = ReadReport(row, seed)) return std::move(*report);
    Words words{"eval", "--checkpoint", CheckpointOf(run).string(), "--out", ReportOf(row, seed).string()};
    const Words evaluation = EvaluationOf(row.eval);
    words.insert(words.end(), evaluation.begin(), evaluation.end());
    ETUDE_RETURN_IF_ERROR(Run(fmt::format("eval-{}-{}", row.name, seed), words));
    auto report = ReadReport(row, seed);
    if (!report)
      return Fail(Code::kInternal, fmt::format("eval-{}-{} left no whole report: see {}/rollouts/attempts.jsonl",
                                               row.name, seed, ReportOf(row, seed).string()));
    ETUDE_RETURN_IF_ERROR(WriteFileAtomically(ReportOf(row, seed) / kMade, std::string_view(MadeHere() + "\n")));
    return std::move(*report);
  }

  const ResultsArguments& arguments_;
  const ResultsConfig& config_;
  const Path out_;
  std::set<std::string> collected_;  // datasets that are whole
};

template <class Item>
bool Wanted(const std::vector<Item>& list, const Item& item) {
  return list.empty() || std::ranges::find(list, item) != list.end();
}

// The table of what was measured, whoever measured it, and its records beside it.
struct Table {
  Path file;
  ResultRecords records;

  Path record_file() const { return Path(file).replace_extension(".json"); }
  /// @param only  names of rows, which are shown beside those that they are compared with; none: all
  std::string Text(const ResultsConfig& config, const std::vector<std::string>& only = {}) const {
    std::set<std::string> shown;
    // from the last one on: what a row is compared with stands before it, and may be compared itself
    for (auto row = config.rows.rbegin(); row != config.rows.rend(); ++row)
      if (Wanted(only, row->name) || shown.contains(row->name)) shown.insert({row->name, row->compare});
    std::vector<ResultLine> lines;
    for (const auto& row : config.rows)
      if (shown.contains(row.name)) lines.push_back({&row, records.Find(row)});
    return ResultsTable(lines);
  }
  // After every seed: a long table is worth something before its end. What others have kept meanwhile stays.
  Status Keep(const ResultsConfig& config, const ResultRow& row, ResultReport report) {
    ETUDE_ASSIGN_OR_RETURN(records, ResultRecords::Load(record_file()));
    records.Keep(row, std::move(report));
    return Save(config);
  }
  Status Save(const ResultsConfig& config) const {
    ETUDE_RETURN_IF_ERROR(records.Save(record_file()));
    return WriteFileAtomically(file, Text(config));
  }
};

Status CheckRows(const ResultsArguments& arguments, const ResultsConfig& config) {
  for (const auto& name : arguments.only)
    if (std::ranges::find(config.rows, name, &ResultRow::name) == config.rows.end())
      return Fail(Code::kInvalidArgument, fmt::format("--row '{}': no such row in {}", name, arguments.file));
  for (const auto seed : arguments.seeds)
    if (std::ranges::none_of(config.rows, [&](const ResultRow& row) {
          return Wanted(arguments.only, row.name) && std::ranges::find(row.train.seeds, seed) != row.train.seeds.end();
        }))
      return Fail(
          Code::kInvalidArgument,
          fmt::format("--seeds {}: {} is trained with it", seed,
                      arguments.only.empty() ? "no row of " + arguments.file
                                             : fmt::format("none of --row {}", fmt::join(arguments.only, ", "))));
  // all of them before hours of work on the first
  for (const auto& row : config.rows) {
    if (!Wanted(arguments.only, row.name)) continue;
    ETUDE_RETURN_IF_ERROR(CheckDefinition(arguments.out, row));
  }
  return {};
}

// Those that come with the programs, wherever one stands.
Path RowsOf(const ResultsArguments& arguments) {
  std::error_code ignored;
  if (arguments.file != ResultsArguments().file || fs::exists(arguments.file, ignored)) return arguments.file;
  const auto docs = FindShared("docs");
  return docs ? *docs / "results.yaml" : Path(arguments.file);
}

Status Results(const ResultsArguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const auto config, LoadResults(RowsOf(arguments)));
  ETUDE_RETURN_IF_ERROR(CheckRows(arguments, config));
  Table table{arguments.write.empty() ? Path(arguments.out) / "results.md" : Path(arguments.write), {}};
  if (table.record_file() == table.file)
    return Fail(Code::kInvalidArgument,
                fmt::format("--write '{}': its name is that of the records, which are kept beside "
                            "the table as .json; give the table's, say {}",
                            arguments.write, Path(table.file).replace_extension(".md").string()));
  std::error_code none;
  if (fs::exists(table.file, none) && fs::file_size(table.file, none) > 0 && !fs::exists(table.record_file(), none))
    return Fail(Code::kInvalidArgument,
                fmt::format("write '{}': it is there, and its records '{}' are not: the table of what is measured now "
                            "would take its place; give another --write, or move it away",
                            table.file.string(), table.record_file().string()));
  ETUDE_RETURN_IF_ERROR(MakeFolders(arguments.out));
  ETUDE_ASSIGN_OR_RETURN(table.records, ResultRecords::Load(table.record_file()));
  ETUDE_RETURN_IF_ERROR(table.Save(config));  // what cannot be written is said before hours of work
  Maker maker(arguments, config);
  std::optional<Error> failed;  // the first one; what does not need it is made all the same
  const auto say = [&](const ResultRow& row, std::uint64_t seed, Error error) {
    fmt::print(stderr, "{}, seed {}: {}\n", row.name, seed, error.message);
    if (!failed) failed = std::move(error);
  };
  for (const auto& row : config.rows) {
    for (const auto seed : row.train.seeds) {
      if (!Wanted(arguments.only, row.name) || !Wanted(arguments.seeds, seed)) continue;
      auto made = maker.Make(row, seed);
      if (!made && StopRequested()) return Fail(made.error());
      if (!made) {
        say(row, seed, made.error());
        continue;
      }
      if (const std::string missing = MissingComparison(made->report); !missing.empty())
        say(row, seed, {Code::kNotFound, missing});
      ETUDE_RETURN_IF_ERROR(table.Keep(config, row, std::move(*made)));
    }
  }
  ETUDE_ASSIGN_OR_RETURN(table.records, ResultRecords::Load(table.record_file()));
  ETUDE_RETURN_IF_ERROR(table.Save(config));
  fmt::print("{}", table.Text(config, arguments.only));
  if (failed) return Fail(*failed);
  return {};
}

}  // namespace

void AddResults(CLI::App& app, Body& body) {
  auto arguments = std::make_shared<ResultsArguments>();
  auto* command = app.add_subcommand("results", "make a table of results: collect, train and roll out, row by row");
  command->add_option("file", arguments->file, "what the rows are")->capture_default_str();
  command->add_option("--out", arguments->out, "folder for data, runs, evaluations and logs; begun again, it goes on")
      ->capture_default_str();
  command->add_option("--row", arguments->only, "only this row; may be repeated")->allow_extra_args(false);
  command->add_option("--seeds", arguments->seeds, "only these training seeds of a row")
      ->delimiter(',')
      ->allow_extra_args(false);  // the file may follow
  command->add_option("--write", arguments->write,
                      "where the table goes (default: OUT/results.md); what was measured is kept beside it as .json, "
                      "so that rows made elsewhere or earlier stay in the table");
  command->add_option("--domain", arguments->domain, "DDS domain, 0..230")->check(CLI::Range(0, 230));
  command->callback([=, &body] { body = [=] { return Results(*arguments); }; });
}

}  // namespace etude::cli
