// SPDX-License-Identifier: Apache-2.0
// What `etude results` runs: a file such as deploy/docs/results.yaml.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "services/core/config.h"

namespace etude::cli {

/// Demonstrations of a row.
struct ResultData {
  std::string name;      ///< of the dataset's folder, for rows that share one; "": the row's
  std::string campaign;  ///< "quickstart"
  std::uint64_t episodes = 0;
  std::vector<std::string> set;

  void Visit(auto& v) {
    v("name", name, "", "of the dataset, where rows share one; empty: the row's");
    v("campaign", campaign, "", "campaign: a name in deploy/campaigns, or a file");
    v("episodes", episodes, "-", "demonstrations; 0: the campaign's");
    v("set", set, "", "KEY=VALUE over the campaign file's");
  }
};

struct ResultTraining {
  std::string config = "compact";
  double minutes = 0;
  std::uint64_t steps = 0;
  std::vector<std::uint64_t> seeds{1};
  std::string runs_of;  ///< a row: nothing is trained, its runs are evaluated
  std::string init;     ///< a row: its run of the same seed, or of its first
  std::vector<std::string> add, fresh, freeze, like, set;

  void Visit(auto& v) {
    v("config", config, "", "experiment: its name, or a file; not with init, whose checkpoint has the graph");
    v("minutes", minutes, "min", "of training");
    v("steps", steps, "steps", "instead of minutes");
    v("seeds", seeds, "-", "one run each");
    v("runs_of", runs_of, "", "row whose runs of the same seeds are evaluated, without data or training of its own");
    v("init", init, "", "row whose runs these begin with; empty: from scratch");
    v("add", add, "", "modules put on top, with init");
    v("fresh", fresh, "", "parts that begin anew, with init");
    v("freeze", freeze, "", "parts that stay as they are, with init");
    v("like", like, "", "NEW=OLD: parts that begin with another one's weights, with init");
    v("set", set, "", "KEY=VALUE over the experiment's");
  }
};

struct ResultEvaluation {
  std::string scenes;  ///< a campaign; "": the nominal world
  std::vector<std::string> tasks;
  std::uint64_t episodes = 400;
  std::string sentences;
  std::uint64_t scenes_each = 3;
  double occlude = 0;
  std::uint64_t pushes = 0;
  bool any_camera = false;
  std::uint64_t seed = 1;
  std::vector<std::string> set;

  void Visit(auto& v) {
    v("scenes", scenes, "", "campaign whose scenes are used; empty: pick, push and put down in the nominal world");
    v("tasks", tasks, "", "tasks; none: the campaign's");
    v("episodes", episodes, "-", "rollouts of each run");
    v("sentences", sentences, "", "table8, table11 or a file, said instead of `episodes` rollouts");
    v("scenes_each", scenes_each, "-", "scenes in which each of the sentences is said");
    v("occlude", occlude, "-", "share of the target's pixels under grey blocks");
    v("pushes", pushes, "-", "times that the target is slid away before it is touched");
    v("any_camera", any_camera, "", "the scenes' camera is not the one of the training");
    v("seed", seed, "-", "of the scenes");
    v("set", set, "", "KEY=VALUE over the campaign's");
  }
};

/// Keys of ResultRow::goals that are no module's name.
inline constexpr const char *kGoalLatched = "latched", *kGoalDrop = "drop", *kGoalBetter = "p",
                            *kGoalMinutes = "minutes";

struct ResultRow {
  std::string name;   ///< of its folders
  std::string title;  ///< for people
  std::string paper;  ///< what the paper has, as text
  double goal = 0;    ///< %, strict
  /// Beside it: latched, % at least; drop, points below `compare`, at most; p, of being better than `compare` by
  /// chance, below; minutes of training, at most; MODULE, error in cm, at most
  std::map<std::string, double> goals;
  ResultData data;
  ResultTraining train;
  ResultEvaluation eval;
  std::string compare;      ///< a row before it, whose rollouts of the same seed these are paired with; "": none
  OrderedJson begins_with;  ///< DefinitionOf the row that `init` or `runs_of` names; null: none (by LoadResults)

  void Visit(auto& v) {
    v("name", name, "", "plain name, of its folders");
    v("title", title, "", "what is measured");
    v("paper", paper, "", "what the paper has");
    v("goal", goal, "%", "strict success that is wanted; 0: none");
    v("goals", goals, "-",
      "wanted beside it: latched: %, at least; drop: points below the row of `compare`, at most; p: of being better "
      "than "
      "that row by chance, below; minutes: of training, at most; a module's name: its error in cm, at most");
    v("data", data, "", "what it is trained on");
    v("train", train, "", "how it is trained");
    v("eval", eval, "", "the rollouts that its figures come from");
    v("compare", compare, "", "row before it whose rollouts of the same scenes these are paired with");
  }
};

/// Of its folder: rows that name the same one share it.
inline std::string DatasetName(const ResultRow& row) { return row.data.name.empty() ? row.name : row.data.name; }

struct ResultsConfig {
  std::vector<ResultRow> rows;

  void Visit(auto& v) { v("rows", rows, "", "of the table, in the order in which they are made"); }

  /// All problems at once: names, rows that begin with a later one, no limit of training, goals that are none, rows
  /// that share a dataset and ask for different ones.
  Status Validate() const;
};

/// A file of rows, valid, each with the definition of the row that it begins with.
/// @error of LoadConfig and Validate
Result<ResultsConfig> LoadResults(const Path& file);

}  // namespace etude::cli
