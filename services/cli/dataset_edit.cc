// SPDX-License-Identifier: Apache-2.0
// `etude dataset filter|split|merge|delete|export|import`.
#include "services/cli/dataset_edit.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <charconv>

#include "services/cli/progress.h"
#include "services/core/output_folder.h"
#include "services/export/lerobot.h"
#include "services/export/modattn.h"
#include "services/store/edit.h"
#include "services/store/filter_keys.h"
#include "services/store/plain_file.h"

namespace etude::cli {
namespace {

constexpr std::uint64_t kMostIndices = 10'000'000;

bool ParseNumber(std::string_view text, std::uint64_t& number) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  return error == std::errc() && end == text.data() + text.size() && !text.empty();
}

// "7" or "4-9"
Status AddIndices(const std::string& text, std::set<std::uint64_t>& indices) {
  const auto dash = text.find('-');
  std::uint64_t first = 0, last = 0;
  const bool good = ParseNumber(std::string_view(text).substr(0, dash), first) &&
                    ParseNumber(std::string_view(text).substr(dash == std::string::npos ? 0 : dash + 1), last);
  if (!good || last < first || last - first >= kMostIndices - indices.size())
    return Fail(Code::kInvalidArgument,
                fmt::format("--index '{}': give numbers of episodes, 7 or 4-9, at most {} in all", text, kMostIndices));
  // counted from the first: the last may be the largest number that there is
  for (std::uint64_t n = 0; n <= last - first; ++n) indices.insert(first + n);
  return {};
}

// Options that choose episodes.
struct SelectionArguments {
  store::Selection selection;
  std::vector<std::string> indices;

  void Add(CLI::App& app) {
    app.add_option("--task", selection.tasks, "only episodes of these tasks");
    app.add_option("--target", selection.targets, "only those about these objects");
    app.add_option("--robot", selection.robots, "only those of these robots");
    app.add_option("--outcome", selection.outcomes, "only those that ended so: success, ...");
    app.add_option("--split", selection.splits, "only those of train, valid or test");
    app.add_option("--key", selection.keys, "only those of these filter keys (dataset filter --as)");
    app.add_option("--index", indices, "only these: 7, 4-9");
    app.add_option("--min-steps", selection.min_steps, "only those of at least so many control steps");
    app.add_option("--max-steps", selection.max_steps, "only those of at most so many");
  }

  bool empty() const {
    return selection.tasks.empty() && selection.targets.empty() && selection.robots.empty() &&
           selection.outcomes.empty() && selection.splits.empty() && selection.keys.empty() && indices.empty() &&
           !selection.min_steps && !selection.max_steps;
  }

  /// @error as store::Select; kNotFound when nothing fits
  Result<std::vector<std::uint64_t>> Choose(const Path& dataset) const {
    store::Selection chosen = selection;
    for (const auto& text : indices) ETUDE_RETURN_IF_ERROR(AddIndices(text, chosen.indices));
    ETUDE_ASSIGN_OR_RETURN(auto found, store::Select(dataset, chosen));
    if (found.empty())
      return Fail(Code::kNotFound, fmt::format("no episode of '{}' fits what is asked for", dataset.string()));
    return found;
  }
};

struct EditArguments {
  std::string dataset, out, key, by, format = "lerobot", version = "3.0";
  std::vector<std::string> datasets, parts;
  SelectionArguments choice;
  exports::ModattnOptions modattn;
  bool restart = false, yes = false;

  Leftover leftover() const { return restart ? Leftover::kRemove : Leftover::kRefuse; }
};

// A line that counts episodes.
auto Counter(ProgressDisplay& display, const char* verb) {
  return [&display, verb](std::uint64_t done, std::uint64_t total) {
    if (display.due() || done == total) display.Show(fmt::format("{} {} of {} episodes", verb, done, total));
  };
}

Status Filter(const EditArguments& arguments) {
  if (arguments.out.empty() == arguments.key.empty())
    return Fail(Code::kInvalidArgument, "say one of: OUT, a new dataset of what is chosen; --as NAME, a filter key");
  ETUDE_ASSIGN_OR_RETURN(const auto indices, arguments.choice.Choose(arguments.dataset));
  if (!arguments.key.empty()) {
    ETUDE_RETURN_IF_ERROR(store::WriteFilterKey(arguments.dataset, arguments.key, {indices.begin(), indices.end()}));
    fmt::print("filter key '{}': {} episodes (in dataset.hdf5: /mask/{})\n", arguments.key, indices.size(),
               arguments.key);
    return {};
  }
  {
    ProgressDisplay display;
    ETUDE_RETURN_IF_ERROR(store::CopyEpisodes(arguments.dataset, indices, arguments.out, arguments.leftover(),
                                              Counter(display, "copied")));
  }
  fmt::print("{}: {} episodes\n", arguments.out, indices.size());
  return {};
}

// "train=0.8"
Result<std::vector<store::PartShare>> ParseParts(const std::vector<std::string>& texts) {
  std::vector<store::PartShare> parts;
  for (const auto& text : texts) {
    const auto equal = text.find('=');
    store::PartShare part{text.substr(0, equal), 0};
    const char* begin = equal == std::string::npos ? "" : text.c_str() + equal + 1;
    char* end = nullptr;
    part.share = std::strtod(begin, &end);
    if (end == begin || *end != '\0')
      return Fail(Code::kInvalidArgument, fmt::format("--parts '{}': say NAME=SHARE, e.g. train=0.8", text));
    parts.push_back(std::move(part));
  }
  return parts;
}

Status Split(const EditArguments& arguments) {
  store::Groups groups;
  if (arguments.parts.empty()) {
    ETUDE_ASSIGN_OR_RETURN(groups, store::GroupEpisodes(arguments.dataset, arguments.by));
  } else {
    ETUDE_ASSIGN_OR_RETURN(const auto parts, ParseParts(arguments.parts));
    ETUDE_ASSIGN_OR_RETURN(groups, store::DealEpisodes(arguments.dataset, parts));
  }
  ETUDE_ASSIGN_OR_RETURN(auto folder, OutputFolder::Create(arguments.out, arguments.leftover()));
  {
    ProgressDisplay display;
    for (const auto& [name, indices] : groups)
      if (!indices.empty())
        ETUDE_RETURN_IF_ERROR(store::CopyEpisodes(arguments.dataset, indices, folder.path() / name, Leftover::kRefuse,
                                                  Counter(display, name.c_str())));
  }
  ETUDE_RETURN_IF_ERROR(folder.Commit());
  for (const auto& [name, indices] : groups)
    fmt::print("{}: {} episodes\n", (Path(arguments.out) / name).string(), indices.size());
  return {};
}

Status Merge(const EditArguments& arguments) {
  store::MergeReport report;
  {
    ProgressDisplay display;
    const std::vector<Path> datasets(arguments.datasets.begin(), arguments.datasets.end());
    ETUDE_ASSIGN_OR_RETURN(
        report, store::MergeDatasets(datasets, arguments.out, arguments.leftover(), Counter(display, "merged")));
  }
  fmt::print("{}: {} episodes{}\n", arguments.out, report.episodes,
             report.renumbered ? ", numbered anew: the datasets are of different specs" : "");
  return {};
}

Status Delete(const EditArguments& arguments) {
  if (arguments.choice.empty())
    return Fail(Code::kInvalidArgument, "say which episodes: --index, --key, --task, ... (--help)");
  ETUDE_ASSIGN_OR_RETURN(const auto indices, arguments.choice.Choose(arguments.dataset));
  if (!arguments.yes)
    return Fail(Code::kInvalidArgument,
                fmt::format("this would delete {} episodes for good: {}{}; --yes does", indices.size(),
                            fmt::join(indices.begin(),
                                      indices.begin() + std::min<std::ptrdiff_t>(10, std::ssize(indices)), ", "),
                            indices.size() > 10 ? ", ..." : ""));
  ETUDE_RETURN_IF_ERROR(store::DeleteEpisodes(arguments.dataset, indices));
  fmt::print("deleted {} episodes (`etude collect` in this folder makes them again)\n", indices.size());
  return {};
}

Status ExportRobomimic(const EditArguments& arguments, store::PlainFileOptions options) {
  store::PlainFileReport report;
  {
    ProgressDisplay display;
    options.progress = Counter(display, "exported");
    ETUDE_ASSIGN_OR_RETURN(report, store::WritePlainFile(arguments.dataset, arguments.out, options));
  }
  fmt::print("{}: {} episodes, {} samples, {} sentences\n{}: for robomimic's train.data, an entry a sentence\n",
             arguments.out, report.episodes, report.samples, report.sentences, report.train_data.string());
  return {};
}

Status Export(const EditArguments& arguments) {
  std::vector<std::uint64_t> indices;
  if (!arguments.choice.empty()) {
    ETUDE_ASSIGN_OR_RETURN(indices, arguments.choice.Choose(arguments.dataset));
  }
  if (arguments.format == "robomimic")
    return ExportRobomimic(arguments, {.indices = indices, .leftover = arguments.leftover(), .progress = {}});
  exports::LeRobotReport report;
  {
    ProgressDisplay display;
    exports::LeRobotOptions options;
    options.version = arguments.version == "2.1" ? exports::LeRobotVersion::k21 : exports::LeRobotVersion::k30;
    options.leftover = arguments.leftover();
    options.indices = indices;
    options.progress = Counter(display, "exported");
    ETUDE_ASSIGN_OR_RETURN(report, exports::ExportLeRobot(arguments.dataset, arguments.out, options));
  }
  fmt::print("{}: {} episodes, {} frames, {} sentences, LeRobot {}\n", arguments.out, report.episodes, report.frames,
             report.tasks, arguments.version);
  return {};
}

Status Import(const EditArguments& arguments) {
  exports::ModattnReport report;
  {
    ProgressDisplay display;
    exports::ModattnOptions options = arguments.modattn;
    options.leftover = arguments.leftover();
    options.progress = Counter(display, "imported");
    ETUDE_ASSIGN_OR_RETURN(report, exports::ImportModattn(arguments.dataset, arguments.out, options));
  }
  for (const auto& skipped : report.skipped) fmt::print("left out  {}\n", skipped);
  fmt::print("{}: {} episodes, {} left out\n", arguments.out, report.episodes, report.skipped.size());
  return {};
}

void AddExportOptions(CLI::App& exporting, const std::shared_ptr<EditArguments>& exported) {
  exporting.add_option("dataset", exported->dataset, "dataset folder")->required();
  exporting.add_option("out", exported->out, "lerobot: a new folder; robomimic: a new .hdf5 file")->required();
  exporting.add_option("--format", exported->format, "lerobot | robomimic")
      ->required()
      ->check(CLI::IsMember({"lerobot", "robomimic"}));
  exporting.add_option("--version", exported->version, "of LeRobot's format: 3.0 | 2.1")
      ->check(CLI::IsMember({"3.0", "2.1"}))
      ->capture_default_str();
  exported->choice.Add(exporting);
}

void AddImport(CLI::App& command, Body& body, const std::shared_ptr<EditArguments>& arguments) {
  auto* importing = command.add_subcommand("import", "a dataset of others' demonstrations");
  importing->add_option("folder", arguments->dataset, "what to read: a folder an episode, each with states.json")
      ->required();
  importing->add_option("out", arguments->out, "the new dataset's folder")->required();
  importing->add_option("--format", arguments->format, "modattn: the published layout of the paper's authors")
      ->required()
      ->check(CLI::IsMember({"modattn"}));
  importing->add_option("--robot", arguments->modattn.robot, "which robot it was")->capture_default_str();
  importing->add_option("--name", arguments->modattn.name, "name of the campaign in the dataset")
      ->capture_default_str();
  importing->add_option("--fovy", arguments->modattn.fovy_deg, "the camera's vertical field of view, degrees")
      ->capture_default_str();
  importing->add_flag("--skip-bad", arguments->modattn.skip_bad, "leave out what cannot be read, instead of ending");
  importing->add_flag("--restart", arguments->restart, "remove what an interrupted command left");
  importing->callback([=, &body] { body = [=] { return Import(*arguments); }; });
}

}  // namespace

void AddDatasetEdit(CLI::App& command, Body& body) {
  const auto add = [&](const char* name, const char* description, Status (*run)(const EditArguments&)) {
    auto arguments = std::make_shared<EditArguments>();
    auto* sub = command.add_subcommand(name, description);
    sub->callback([=, &body] { body = [=] { return run(*arguments); }; });
    return std::pair(sub, arguments);
  };
  const auto add_restart = [](CLI::App& sub, EditArguments& arguments) {
    return sub.add_flag("--restart", arguments.restart, "remove what an interrupted command left, and begin anew");
  };
  const auto [filter, filtered] = add("filter", "a new dataset, or a filter key, of some episodes", &Filter);
  filter->add_option("dataset", filtered->dataset, "dataset folder")->required();
  filter->add_option("out", filtered->out, "the new dataset's folder");
  filter->add_option("--as", filtered->key, "give them a filter key of this name instead of copying")
      ->excludes(add_restart(*filter, *filtered));
  filtered->choice.Add(*filter);

  const auto [split, divided] = add("split", "several datasets of one: OUT/<value> or OUT/<part>", &Split);
  add_restart(*split, *divided);
  split->add_option("dataset", divided->dataset, "dataset folder")->required();
  split->add_option("out", divided->out, "folder for them")->required();
  auto* by = split->add_option("--by", divided->by, "one for each robot | task | target | split | outcome")
                 ->check(CLI::IsMember({"robot", "task", "target", "split", "outcome"}));
  auto* parts =
      split->add_option("--parts", divided->parts, "NAME=SHARE of each, dealt at random: train=0.8 valid=0.2");
  by->excludes(parts);

  const auto [merge, merged] =
      add("merge",
          "one dataset of several; where their specs differ, episodes are numbered anew, and which are for training "
          "follows the new numbers",
          &Merge);
  add_restart(*merge, *merged);
  merge->add_option("datasets", merged->datasets, "dataset folders")->required();
  merge->add_option("--out", merged->out, "the new dataset's folder")->required();

  const auto [remove, removed] = add("delete", "remove episodes for good", &Delete);
  remove->add_option("dataset", removed->dataset, "dataset folder")->required();
  remove->add_flag("--yes", removed->yes, "do it; without, it only says what it would do");
  removed->choice.Add(*remove);

  const auto [exporting, exported] = add("export", "for LeRobot (a folder) or robomimic (one file)", &Export);
  add_restart(*exporting, *exported);
  AddExportOptions(*exporting, exported);

  AddImport(command, body, std::make_shared<EditArguments>());
}

}  // namespace etude::cli
