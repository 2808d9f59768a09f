// SPDX-License-Identifier: Apache-2.0
// `etude dataset filter|split|merge|link|delete|export|import`.
#include "services/cli/dataset_edit.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <chrono>
#include <optional>
#include <set>
#include <string>

#include "services/campaign/history.h"
#include "services/cli/campaign_control.h"
#include "services/core/identity.h"
#include "services/core/output_folder.h"
#include "services/core/progress.h"
#include "services/export/lerobot.h"
#include "services/export/modattn.h"
#include "services/store/edit.h"
#include "services/store/filter_keys.h"
#include "services/store/plain_file.h"

namespace etude::cli {
namespace {

using namespace std::chrono_literals;

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
    app.add_option("--index", indices, "only these: 7 4-9, or 7,4-9")->delimiter(',');
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
    for (const auto& text : indices)
      if (const Status added = store::AddIndices(text, chosen.indices); !added)
        return Fail(added.error().Wrap("--index"));
    ETUDE_ASSIGN_OR_RETURN(auto found, store::Select(dataset, chosen));
    if (found.empty())
      return Fail(Code::kNotFound, fmt::format("no episode of '{}' fits what is asked for", dataset.string()));
    return found;
  }
};

struct EditArguments {
  std::string dataset, out, key, remove_key, by, format = "lerobot", version = "3.0";
  std::vector<std::string> datasets, parts;
  SelectionArguments choice;
  exports::ModattnOptions modattn;
  BusArguments bus;  // filter --as, of a dataset that is being collected
  bool restart = false, yes = false;
  bool version_given = false;

  Leftover leftover() const { return restart ? Leftover::kRemove : Leftover::kRefuse; }
};

// A line that counts episodes.
auto Counter(ProgressDisplay& display, const char* verb) {
  return [&display, verb](std::uint64_t done, std::uint64_t total) {
    if (display.due() || done == total) display.Show(fmt::format("{} {} of {} episodes", verb, done, total));
  };
}

// A made dataset knows the hosts and files of those that it is made of as soon as it is there.
store::EditFinish CarryHostsOf(std::vector<Path> datasets) {
  return [datasets = std::move(datasets)](const Path& folder) { return campaign::CarryHosts(datasets, folder); };
}

// The collector that writes this dataset, as it is known on the bus.
Result<std::optional<bus::Presence>> CollectorOf(const Path& dataset, const bus::Participant& participant) {
  ETUDE_ASSIGN_OR_RETURN(const auto reader, store::DatasetReader::Open(dataset));
  ETUDE_ASSIGN_OR_RETURN(const Identity identity, ReadIdentity(dataset));
  ETUDE_ASSIGN_OR_RETURN(auto directory, bus::Directory::Open(participant));
  ETUDE_ASSIGN_OR_RETURN(const auto found, directory.FindCampaign({reader.spec().name, identity.id}, 2s));
  return found.empty() ? std::nullopt : std::optional(found.front());
}

// Where a collector holds the dataset's lock, it writes the key itself. No episode: the key goes.
Status WriteKey(const EditArguments& arguments, const std::string& key, const std::set<std::uint64_t>& indices) {
  const Status written = store::WriteFilterKey(arguments.dataset, key, indices);
  if (written || written.error().code != Code::kUnavailable) return written;
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open({security::Role::kGateway}));
  const auto collector = CollectorOf(arguments.dataset, participant);
  if (!collector || !*collector)
    return Fail(
        Code::kUnavailable,
        fmt::format("{}; were it a collector on domain {}, that would write the key (--domain){}",
                    written.error().message, participant.domain(), collector ? "" : ": " + collector.error().message));
  const auto told = TellCollector(
      participant, **collector, "give a filter key to",
      {.action = bus::ControlAction::kFilterKey, .filter_key = key, .episodes = store::IndicesText(indices)}, 60s);
  if (!told) return Fail(told.error());
  return {};
}

Status RemoveKey(const EditArguments& arguments) {
  if (!arguments.out.empty() || !arguments.choice.empty())
    return Fail(Code::kInvalidArgument, "--remove-key removes a key alone: it takes no OUT and chooses no episodes");
  ETUDE_ASSIGN_OR_RETURN(const auto keys, store::ReadFilterKeys(arguments.dataset));
  const auto key = keys.find(arguments.remove_key);
  if (key == keys.end())
    return Fail(Code::kNotFound,
                fmt::format("dataset '{}' has no filter key '{}'", arguments.dataset, arguments.remove_key));
  ETUDE_RETURN_IF_ERROR(WriteKey(arguments, arguments.remove_key, {}));
  fmt::print("filter key '{}' is removed; its {} episodes stay\n", arguments.remove_key, key->second.size());
  return {};
}

Status GiveKey(const EditArguments& arguments, const std::vector<std::uint64_t>& indices) {
  const std::set<std::uint64_t> chosen(indices.begin(), indices.end());
  ETUDE_ASSIGN_OR_RETURN(const auto before, store::ReadFilterKeys(arguments.dataset));
  ETUDE_RETURN_IF_ERROR(WriteKey(arguments, arguments.key, chosen));
  const auto had = before.find(arguments.key);
  const bool replaces = had != before.end() && had->second != chosen;
  fmt::print(
      "filter key '{}': {} episodes (in dataset.hdf5: /mask/{}){}\n", arguments.key, chosen.size(), arguments.key,
      replaces
          ? fmt::format("; in place of the {} that it had: {}", had->second.size(), store::IndicesText(had->second))
          : "");
  return {};
}

Status Filter(const EditArguments& arguments) {
  if (!arguments.remove_key.empty()) return RemoveKey(arguments);
  if (arguments.out.empty() == arguments.key.empty())
    return Fail(Code::kInvalidArgument,
                fmt::format("say one of: OUT, a new dataset of what is chosen; --as NAME, a filter key{}",
                            arguments.out.empty() && !arguments.choice.empty()
                                ? "; folders stand before options, which take all that follows: etude dataset filter "
                                  "DATASET OUT --task pick"
                                : ""));
  ETUDE_ASSIGN_OR_RETURN(const auto indices, arguments.choice.Choose(arguments.dataset));
  if (!arguments.key.empty()) return GiveKey(arguments, indices);
  {
    ProgressDisplay display;
    ETUDE_RETURN_IF_ERROR(store::CopyEpisodes(arguments.dataset, indices, arguments.out, arguments.leftover(),
                                              Counter(display, "copied"), CarryHostsOf({arguments.dataset})));
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
  for (const auto& [name, indices] : groups)
    if (indices.empty())
      return Fail(Code::kInvalidArgument,
                  fmt::format("--parts: '{}' would have no episode of '{}', which has too few for such a share", name,
                              arguments.dataset));
  ETUDE_ASSIGN_OR_RETURN(auto folder, OutputFolder::Create(arguments.out, arguments.leftover()));
  {
    ProgressDisplay display;
    for (const auto& [name, indices] : groups) {
      ETUDE_RETURN_IF_ERROR(store::CopyEpisodes(arguments.dataset, indices, folder.path() / name, Leftover::kRefuse,
                                                Counter(display, name.c_str()), CarryHostsOf({arguments.dataset})));
    }
  }
  ETUDE_RETURN_IF_ERROR(folder.Commit());
  for (const auto& [name, indices] : groups)
    fmt::print("{}: {} episodes\n", (Path(arguments.out) / name).string(), indices.size());
  return {};
}

// Shards of one campaign made on hosts, or with files of robots and objects, that differ are not one dataset.
Status CheckHosts(const std::vector<Path>& datasets) {
  std::set<std::string> determinisms;
  for (const Path& dataset : datasets) {
    ETUDE_ASSIGN_OR_RETURN(const auto reader, store::DatasetReader::Open(dataset));
    determinisms.insert(reader.spec().determinism);
  }
  for (const std::string& determinism : determinisms)
    ETUDE_RETURN_IF_ERROR(campaign::CheckHostsAgree(datasets, determinism));
  return {};
}

// Datasets of different specs may be of different hosts: they are numbered anew, and nobody collects there again.
Result<bool> AreOneSpec(const std::vector<Path>& datasets) {
  std::set<std::string> hashes;
  for (const Path& dataset : datasets) {
    ETUDE_ASSIGN_OR_RETURN(const auto reader, store::DatasetReader::Open(dataset));
    hashes.insert(reader.spec_sha256());
  }
  return hashes.size() == 1;
}

Status Merge(const EditArguments& arguments) {
  const std::vector<Path> datasets(arguments.datasets.begin(), arguments.datasets.end());
  ETUDE_ASSIGN_OR_RETURN(const bool one_spec, AreOneSpec(datasets));
  if (one_spec) ETUDE_RETURN_IF_ERROR(CheckHosts(datasets));
  store::MergeReport report;
  {
    ProgressDisplay display;
    ETUDE_ASSIGN_OR_RETURN(report, store::MergeDatasets(datasets, arguments.out, arguments.leftover(),
                                                        Counter(display, "merged"), CarryHostsOf(datasets)));
  }
  fmt::print("{}: {} episodes{}\n", arguments.out, report.episodes,
             report.renumbered ? ", numbered anew: the datasets are of different specs" : "");
  return {};
}

Status Link(const EditArguments& arguments) {
  const std::vector<Path> datasets(arguments.datasets.begin(), arguments.datasets.end());
  ETUDE_RETURN_IF_ERROR(CheckHosts(datasets));
  store::LinkReport report;
  {
    ProgressDisplay display;
    ETUDE_ASSIGN_OR_RETURN(report, store::LinkDatasets(datasets, arguments.out, arguments.leftover(),
                                                       Counter(display, "linked"), CarryHostsOf(datasets)));
  }
  fmt::print("{}: {} of {} episodes\n", arguments.out, report.episodes, report.planned);
  return {};
}

Status Delete(const EditArguments& arguments) {
  if (arguments.choice.empty())
    return Fail(Code::kInvalidArgument, "say which episodes: --index, --key, --task, ... (--help)");
  ETUDE_ASSIGN_OR_RETURN(const auto indices, arguments.choice.Choose(arguments.dataset));
  // of imports, of what was merged and numbered anew, and of what another version made, nothing can be made again
  const char* again =
      store::CanBeMadeAgain(arguments.dataset) ? " (`etude collect` in this folder makes them again)" : "";
  if (!arguments.yes)
    return Fail(Code::kInvalidArgument,
                fmt::format("this would delete {} episodes for good: {}{}{}; --yes does", indices.size(),
                            fmt::join(indices.begin(),
                                      indices.begin() + std::min<std::ptrdiff_t>(10, std::ssize(indices)), ", "),
                            indices.size() > 10 ? ", ..." : "", again));
  ETUDE_RETURN_IF_ERROR(store::DeleteEpisodes(arguments.dataset, indices));
  fmt::print("deleted {} episodes{}\n", indices.size(), again);
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
  if (arguments.format == "robomimic" && arguments.version_given)
    return Fail(Code::kInvalidArgument, "--version is of LeRobot's format: robomimic's has none");
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
      ->each([exported](const std::string&) { exported->version_given = true; })
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

// A command of `etude dataset`, and what it was told.
struct EditCommand {
  CLI::App* command;
  std::shared_ptr<EditArguments> arguments;
};

EditCommand Add(CLI::App& command, Body& body, const char* name, const char* description,
                Status (*run)(const EditArguments&)) {
  auto arguments = std::make_shared<EditArguments>();
  auto* sub = command.add_subcommand(name, description);
  sub->callback([=, &body] { body = [=] { return run(*arguments); }; });
  return {sub, std::move(arguments)};
}

CLI::Option* AddRestart(const EditCommand& edit) {
  return edit.command->add_flag("--restart", edit.arguments->restart,
                                "remove what an interrupted command left, and begin anew");
}

void AddFilter(const EditCommand& filter) {
  filter.command->add_option("dataset", filter.arguments->dataset, "dataset folder")->required();
  filter.command->add_option("out", filter.arguments->out, "the new dataset's folder");
  filter.command->add_option("--as", filter.arguments->key, "give them a filter key of this name instead of copying")
      ->excludes(AddRestart(filter));
  filter.command->add_option("--remove-key", filter.arguments->remove_key, "remove this filter key; episodes stay")
      ->excludes("--as");
  filter.arguments->choice.Add(*filter.command);
  filter.arguments->bus.Add(*filter.command);
}

void AddSplit(const EditCommand& split) {
  AddRestart(split);
  split.command->add_option("dataset", split.arguments->dataset, "dataset folder")->required();
  split.command->add_option("out", split.arguments->out, "folder for them")->required();
  auto* by =
      split.command->add_option("--by", split.arguments->by, "one for each robot | task | target | split | outcome")
          ->check(CLI::IsMember({"robot", "task", "target", "split", "outcome"}));
  by->excludes(split.command->add_option("--parts", split.arguments->parts,
                                         "NAME=SHARE of each, dealt at random: train=0.8 valid=0.2"));
}

// One of several.
void AddJoining(const EditCommand& joining) {
  AddRestart(joining);
  joining.command->add_option("datasets", joining.arguments->datasets, "dataset folders")->required();
  joining.command->add_option("--out", joining.arguments->out, "the new dataset's folder")->required();
}

void AddDelete(const EditCommand& remove) {
  remove.command->add_option("dataset", remove.arguments->dataset, "dataset folder")->required();
  remove.command->add_flag("--yes", remove.arguments->yes, "do it; without, it only says what it would do");
  remove.arguments->choice.Add(*remove.command);
}

}  // namespace

void AddDatasetEdit(CLI::App& command, Body& body) {
  AddFilter(Add(command, body, "filter", "a new dataset, or a filter key, of some episodes", &Filter));
  AddSplit(Add(command, body, "split", "several datasets of one: OUT/<value> or OUT/<part>", &Split));
  AddJoining(Add(command, body, "merge",
                 "one dataset of several; where their specs differ, episodes are numbered anew, and which are for "
                 "training follows the new numbers",
                 &Merge));
  AddJoining(Add(command, body, "link",
                 "one dataset of the shards of one campaign on one filesystem, without copying: the same files, by "
                 "hard links",
                 &Link));
  AddDelete(Add(command, body, "delete", "remove episodes for good", &Delete));
  const EditCommand exporting = Add(command, body, "export", "for LeRobot (a folder) or robomimic (one file)", &Export);
  AddRestart(exporting);
  AddExportOptions(*exporting.command, exporting.arguments);
  AddImport(command, body, std::make_shared<EditArguments>());
}

}  // namespace etude::cli
