// SPDX-License-Identifier: Apache-2.0
// `etude checkpoint show|diff|export|promote|watch|relay`.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cstdio>
#include <numeric>

#include "services/bus/blob_transfer.h"
#include "services/bus/directory.h"
#include "services/bus/process_reporter.h"
#include "services/cli/command_line.h"
#include "services/cli/file_names.h"
#include "services/core/config.h"
#include "services/core/hash.h"
#include "services/core/link.h"
#include "services/core/log.h"
#include "services/core/printable.h"
#include "services/core/run_name.h"
#include "services/core/service_manager.h"
#include "services/core/stop.h"
#include "services/episode/bounded_json.h"
#include "services/relay/relay.h"
#include "services/security/checkpoint_signature.h"
#include "services/store/safetensors.h"

namespace etude::cli {
namespace {

std::uint64_t ElementCount(const store::Tensor& tensor) {
  return std::accumulate(
      tensor.shape.begin(), tensor.shape.end(), std::uint64_t{1},
      [](std::uint64_t product, std::int64_t size) { return product * static_cast<std::uint64_t>(size); });
}

// metadata values are JSON where they are structured
OrderedJson MetadataJson(const std::map<std::string, std::string>& metadata) {
  OrderedJson json = OrderedJson::object();
  for (const auto& [key, value] : metadata) {
    auto parsed = ParseBoundedJson(value);
    json[key] = parsed && parsed->is_structured() ? std::move(*parsed) : OrderedJson(value);
  }
  return json;
}

// The trainer's own word on whether every module on the control path was trained and measured.
std::string DrivesText(const std::map<std::string, std::string>& metadata) {
  const auto refused = metadata.find("refused");
  if (refused == metadata.end()) return "not said by this older checkpoint; the policy server decides";
  return refused->second.empty() ? "yes" : "NO, the policy server refuses it: " + Printable(refused->second);
}

// "60.0 degrees, camera at (0.00, 1.50, 1.00) m"; of one that differs from episode to episode, that it does
std::string CameraText(const OrderedJson& embodiment, double fovy) {
  constexpr double kDegrees = 57.29577951308232;
  const std::string view = fovy > 0 ? fmt::format("{:.1f} degrees", fovy * kDegrees) : "any field of view";
  const auto pose = embodiment.find("camera_pose");
  if (pose == embodiment.end() || !pose->is_array() || pose->size() < 3) return view + ", any place of the camera";
  std::vector<std::string> place;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const OrderedJson& value = (*pose)[axis];
    place.push_back(value.is_number() ? fmt::format("{:.2f}", value.get<double>()) : "?");
  }
  return fmt::format("{}, camera at ({}) m", view, fmt::join(place, ", "));
}

// "ur5, 7 joints, pictures of 224x224 px, 60.0 degrees, camera at (0.00, 1.50, 1.00) m"
std::string EmbodimentText(const OrderedJson& embodiment) {
  if (!embodiment.is_object()) return "not said";
  const auto number = [&](const char* key) {
    return embodiment.contains(key) && embodiment[key].is_number() ? embodiment[key].get<double>() : 0.0;
  };
  const std::string robot = embodiment.contains("robot") && embodiment["robot"].is_string()
                                ? Printable(embodiment["robot"].get<std::string>())
                                : "?";
  return fmt::format("{}, {} joints, pictures of {}x{} px, {}", robot, number("joints"), number("width"),
                     number("height"), CameraText(embodiment, number("fovy")));
}

// steps and last error, by module
std::string ModulesText(const OrderedJson& modules) {
  if (!modules.is_object()) return "  not said\n";
  std::string text;
  for (const auto& [name, record] : modules.items()) {
    const auto field = [&, &record = record](const char* key) {
      return record.is_object() && record.contains(key) && record[key].is_number() ? record[key].dump() : "-";
    };
    text += fmt::format("  {:<12} {:>8} steps   error {}\n", Printable(name), field("trained_steps"), field("error"));
  }
  return text;
}

void PrintSummary(const std::map<std::string, std::string>& text, const OrderedJson& metadata) {
  const auto word = [&](const char* key) {
    const auto found = text.find(key);
    return found == text.end() ? std::string("?") : Printable(found->second);
  };
  const auto part = [&](const char* key) { return metadata.contains(key) ? metadata[key] : OrderedJson(); };
  fmt::print("run: {}, step {}, stage {} of {} ({})\n", word("run"), word("step"), word("stage"), word("stages"),
             word("stage_name"));
  fmt::print("trained for: {}\n", EmbodimentText(part("embodiment")));
  fmt::print("data: {} demonstrations, fingerprint {:.12}\n", word("train_episodes"), word("dataset"));
  fmt::print("may drive a robot: {}\n", DrivesText(text));
  fmt::print("modules (errors: 1 - accuracy, px or m):\n{}", ModulesText(part("modules")));
  fmt::print("last validation:\n{}", PrintableLines(ToYaml(part("metrics"))));
}

struct ShowArguments {
  std::string file;
  bool as_json = false, all = false;
};

Status ShowCheckpoint(const ShowArguments& arguments) {
  const std::string& file = arguments.file;
  ETUDE_ASSIGN_OR_RETURN(const auto bytes, ReadBinaryFile(file));
  auto content = store::DecodeSafetensors(bytes);
  if (!content) return Fail(content.error().Wrap("read the checkpoint '" + file + "'"));
  const OrderedJson metadata = MetadataJson(content->metadata);
  if (arguments.as_json) {
    OrderedJson tensors = OrderedJson::object();
    for (const auto& [name, tensor] : content->tensors)
      tensors[name] = {{"dtype", store::ToString(tensor.dtype)}, {"shape", tensor.shape}};
    fmt::print("{}\n", OrderedJson{{"sha256", Sha256Hex(bytes)}, {"metadata", metadata}, {"tensors", tensors}}.dump(1));
    return {};
  }
  fmt::print("file: {}\nbytes: {}\nsha256: {}\n", file, bytes.size(), Sha256Hex(bytes));
  PrintSummary(content->metadata, metadata);
  std::uint64_t numbers = 0;
  for (const auto& [name, tensor] : content->tensors) numbers += ElementCount(tensor);
  if (arguments.all) {
    fmt::print("metadata:\n{}tensors:\n", PrintableLines(ToYaml(metadata)));
    for (const auto& [name, tensor] : content->tensors)
      fmt::print("  {:<48} {:<5} [{}]\n", Printable(name), store::ToString(tensor.dtype),
                 fmt::join(tensor.shape, ", "));
  }
  fmt::print("{} tensors, {} numbers (--all: each, and every setting; etude policy graph FILE: who reads what)\n",
             content->tensors.size(), numbers);
  return {};
}

struct PromoteArguments {
  std::string run, checkpoint;
};

// "1500", "00001500.safetensors", a path to it or the link "latest" -> the file's name in `folder`, RUN/checkpoints.
Result<std::string> NameOfCheckpoint(const std::string& text, const Path& folder) {
  const bool step = !text.empty() && text.size() <= 18 && text.find_first_not_of("0123456789") == std::string::npos;
  if (step) return fmt::format("{:08}.safetensors", std::stoull(text));
  const Path path(text);
  const std::string name = path.filename().string() + (path.has_extension() ? "" : ".safetensors");
  std::error_code error;
  if (!path.has_parent_path() || std::filesystem::equivalent(path, folder / name, error)) {
    const Path target = std::filesystem::read_symlink(folder / name, error);
    return error ? name : target.filename().string();
  }
  return Fail(
      Code::kInvalidArgument,
      fmt::format("promote '{}': it is not in '{}'; a run's best is one of its own checkpoints: name its run, or "
                  "a STEP of this one",
                  text, folder.string()));
}

// The link is what a run's `best` is: a trainer at work publishes it with its next checkpoint, one that is resumed at
// once, and what it names is never cleared away.
Status Promote(const PromoteArguments& arguments) {
  const Path folder = Path(arguments.run) / "checkpoints";
  ETUDE_ASSIGN_OR_RETURN(const std::string name, NameOfCheckpoint(arguments.checkpoint, folder));
  std::error_code error;
  const bool there = std::filesystem::is_regular_file(std::filesystem::symlink_status(folder / name, error));
  if (!there || !name.ends_with(".safetensors"))
    return Fail(Code::kNotFound,
                fmt::format("promote '{}': '{}' has no checkpoint of that name; `ls {}` shows those that are kept",
                            arguments.checkpoint, folder.string(), folder.string()));
  ETUDE_ASSIGN_OR_RETURN(const auto bytes, ReadBinaryFile(folder / name));
  const auto content = store::DecodeSafetensors(bytes);
  if (!content) return Fail(content.error().Wrap("promote '" + (folder / name).string() + "'"));
  const Path link = folder / "best.safetensors";
  const Path before = std::filesystem::read_symlink(link, error);
  ETUDE_RETURN_IF_ERROR(PointLink(link, name));
  fmt::print("best: {}{}\nmay drive a robot: {}\n", name, before.empty() ? "" : " (was " + before.string() + ")",
             DrivesText(content->metadata));
  fmt::print(
      "subscribers of channel best get it from the run's trainer: with its next checkpoint, or once it is "
      "resumed\nserve it now: etude policy --checkpoint {}\n",
      link.string());
  return {};
}

struct WatchArguments {
  std::string run, channel, out;
  bool once = false;
  security::VerifyArguments verify;
  BusArguments bus;
};

// An object that arrived is verified by its hash already; here that it is a checkpoint. False: it was refused.
Result<bool> Keep(const bus::PublishedBlob& object, const Path& out) {
  const auto content = store::DecodeSafetensors(object.bytes);
  if (!content) {
    Log().warn("refused channel={} version={}: {}", object.channel, object.version, content.error().message);
    return false;
  }
  const auto name = CheckpointFileName(object.channel, object.version);
  if (!name) {
    Log().warn("refused a checkpoint: {}", name.error().message);
    return false;
  }
  const Path path = out / *name;
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(path, object.bytes));
  fmt::print("{} {} {}\n", path.string(), object.bytes.size(), object.sha256);
  std::fflush(stdout);
  return true;
}

// The id of the run that is meant; "" on a stop request.
Result<std::string> WaitForRun(const bus::Participant& participant, const Selector& run) {
  if (IsId(run.id)) return run.id;
  ETUDE_ASSIGN_OR_RETURN(auto directory, bus::Directory::Open(participant));
  while (!StopRequested()) {
    ETUDE_ASSIGN_OR_RETURN(const auto found, directory.FindPublisher(run, std::chrono::seconds(1)));
    if (found) return found->id;
  }
  return std::string();
}

Status Watch(const WatchArguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const Selector run, ParseSelector(arguments.run, "--run"));
  ETUDE_RETURN_IF_ERROR(MakeFolders(arguments.out));
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open({security::Role::kSubscriber}));
  ETUDE_ASSIGN_OR_RETURN(const auto verifier, arguments.verify.Open());
  Log().info("waiting for checkpoints of run={}", run.text());
  ETUDE_ASSIGN_OR_RETURN(const std::string id, WaitForRun(participant, run));
  if (id.empty()) return {};
  ETUDE_ASSIGN_OR_RETURN(auto subscriber, bus::BlobSubscriber::Open(participant, {run.name, id}, arguments.channel,
                                                                    {.accept = bus::AcceptSigned(verifier)}));
  while (!StopRequested() && std::ferror(stdout) == 0) {  // an error of stdout: nobody reads on
    const auto object = subscriber.Wait(std::chrono::seconds(1));
    if (!object) continue;
    ETUDE_ASSIGN_OR_RETURN(const bool kept, Keep(*object, arguments.out));
    if (kept && arguments.once) break;
  }
  return {};
}

struct RelayArguments {
  std::string run, folder;
  security::VerifyArguments verify;
  BusArguments bus;
};

Status Relay(const RelayArguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const Selector run, ParseSelector(arguments.run, "--run"));
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open({security::Role::kRelay}));
  ETUDE_ASSIGN_OR_RETURN(const auto reporter,
                         bus::ProcessReporter::Start(participant, {.role = "relay", .folder = arguments.folder}));
  ETUDE_ASSIGN_OR_RETURN(auto verifier, arguments.verify.Open());
  ServiceManager::Get().Ready(fmt::format("run {}", run.text()));
  const relay::RelayOptions options{.folder = arguments.folder, .accept = bus::AcceptSigned(std::move(verifier))};
  WatchedLoop watched;
  return relay::RelayRuns(participant, run, options, [&watched] {
    watched.Moved();
    return StopRequested();
  });
}

void AddExport(CLI::App& command, Body& body) {
  auto file = std::make_shared<std::string>(), out = std::make_shared<std::string>(),
       format = std::make_shared<std::string>();
  auto* exporting = command.add_subcommand("export", "for programs without Etude: TorchScript, opens with libtorch");
  exporting->add_option("file", *file, "checkpoint file")->required();
  exporting->add_option("out", *out, "the file to write, .pt")->required();
  exporting->add_option("--format", *format, "torchscript")->required()->check(CLI::IsMember({"torchscript"}));
  exporting->callback([=, &body] {
    body = [=] { return ExecSibling("etude-policy", {*format, *file, *out}); };  // names all that options write to
  });
}

void AddWatch(CLI::App& command, Body& body) {
  auto watching = std::make_shared<WatchArguments>();
  auto* watch = command.add_subcommand("watch", "subscribe to a run; write each verified checkpoint");
  watch->add_option("--run", watching->run, "the run: NAME or NAME@ID")->required();
  watch->add_option("--out", watching->out, "folder for <channel>-<version>.safetensors")->required();
  watch->add_option("--channel", watching->channel, "latest | best (default: both)")
      ->check(CLI::IsMember({"latest", "best"}));
  bus::AddVerify(*watch, watching->verify);
  watch->add_flag("--once", watching->once, "one checkpoint, then end");
  watching->bus.Add(*watch);
  watch->callback([=, &body] { body = [=] { return Watch(*watching); }; });
}

void AddRelay(CLI::App& command, Body& body) {
  auto relaying = std::make_shared<RelayArguments>();
  auto* relay = command.add_subcommand(
      "relay", "keep a run's newest checkpoints, and publish them to whoever subscribes when the run has ended");
  relay->add_option("--run", relaying->run, "the run: NAME or NAME@ID")->required();
  relay->add_option("--dir", relaying->folder, "folder to keep them in, of this relay alone")->required();
  bus::AddVerify(*relay, relaying->verify);
  relaying->bus.Add(*relay);
  relay->callback([=, &body] { body = [=] { return Relay(*relaying); }; });
}

}  // namespace

void AddCheckpoint(CLI::App& app, Body& body) {
  auto* command =
      AddGroup(app, "checkpoint",
               "look at a checkpoint, export it, make it a run's best, keep or pass on those that a run publishes");
  auto file = std::make_shared<std::string>();
  auto showing = std::make_shared<ShowArguments>();
  auto* show = command->add_subcommand("show", "robot, camera, stage, modules and their errors, data, hash");
  show->add_option("file", showing->file, "checkpoint file, or a run's folder: its newest")
      ->required()
      ->transform(CheckpointFile);
  show->add_flag("--all", showing->all, "every setting and tensor too");
  show->add_flag("--json", showing->as_json, "as JSON");
  show->callback([=, &body] { body = [=] { return ShowCheckpoint(*showing); }; });

  auto second = std::make_shared<std::string>();
  auto* difference = command->add_subcommand("diff", "which parts changed from one to another, and by how much");
  difference->add_option("first", *file, "checkpoint file")->required();
  difference->add_option("second", *second, "checkpoint file")->required();
  difference->add_flag("--json", showing->as_json, "as JSON");
  difference->callback([=, &body] {
    body = [=] {
      std::vector<std::string> arguments{"diff", *file, *second};
      if (showing->as_json) arguments.push_back("--json");
      return ExecSibling("etude-policy", arguments);
    };
  });

  auto promoting = std::make_shared<PromoteArguments>();
  auto* promote = command->add_subcommand("promote", "make a checkpoint its run's best, in place of the one that was");
  promote->add_option("run", promoting->run, "folder of the run")->required();
  promote->add_option("checkpoint", promoting->checkpoint, "STEP, latest, or FILE in RUN/checkpoints")->required();
  promote->callback([=, &body] { body = [=] { return Promote(*promoting); }; });
  AddExport(*command, body);
  AddWatch(*command, body);
  AddRelay(*command, body);
}

}  // namespace etude::cli
