// SPDX-License-Identifier: Apache-2.0
// `etude checkpoint show|diff|watch`.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <numeric>

#include "services/bus/blob_transfer.h"
#include "services/bus/directory.h"
#include "services/cli/command_line.h"
#include "services/cli/file_names.h"
#include "services/core/config.h"
#include "services/core/hash.h"
#include "services/core/log.h"
#include "services/core/stop.h"
#include "services/episode/bounded_json.h"
#include "services/store/safetensors.h"

namespace etude::cli {
namespace {

std::uint64_t Count(const store::Tensor& tensor) {
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
  return refused->second.empty() ? "yes" : "NO, the policy server refuses it: " + refused->second;
}

Status Show(const std::string& file, bool as_json) {
  ETUDE_ASSIGN_OR_RETURN(const auto bytes, ReadBinaryFile(file));
  auto content = store::DecodeSafetensors(bytes);
  if (!content) return Fail(content.error().Wrap("read the checkpoint '" + file + "'"));
  const OrderedJson metadata = MetadataJson(content->metadata);
  if (as_json) {
    OrderedJson tensors = OrderedJson::object();
    for (const auto& [name, tensor] : content->tensors)
      tensors[name] = {{"dtype", store::ToString(tensor.dtype)}, {"shape", tensor.shape}};
    fmt::print("{}\n", OrderedJson{{"sha256", Sha256Hex(bytes)}, {"metadata", metadata}, {"tensors", tensors}}.dump(1));
    return {};
  }
  fmt::print("file: {}\nbytes: {}\nsha256: {}\n", file, bytes.size(), Sha256Hex(bytes));
  fmt::print("metadata:\n{}", ToYaml(metadata));
  fmt::print("may drive a robot: {}\n", DrivesText(content->metadata));
  std::uint64_t numbers = 0;
  fmt::print("tensors:\n");
  for (const auto& [name, tensor] : content->tensors) {
    fmt::print("  {:<48} {:<5} [{}]\n", name, store::ToString(tensor.dtype), fmt::join(tensor.shape, ", "));
    numbers += Count(tensor);
  }
  fmt::print("{} tensors, {} numbers\n", content->tensors.size(), numbers);
  return {};
}

struct WatchArguments {
  std::string run, channel, out;
  bool once = false;
  BusArguments bus;
};

// An object that arrived is verified by its hash already; here that it is a checkpoint.
Status Keep(const bus::PublishedBlob& object, const Path& out) {
  const auto content = store::DecodeSafetensors(object.bytes);
  if (!content) {
    Log().warn("refused channel={} version={}: {}", object.channel, object.version, content.error().message);
    return {};
  }
  const auto name = CheckpointFileName(object.channel, object.version);
  if (!name) {
    Log().warn("refused a checkpoint: {}", name.error().message);
    return {};
  }
  const Path path = out / *name;
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(path, object.bytes));
  fmt::print("{} {} {}\n", path.string(), object.bytes.size(), object.sha256);
  std::fflush(stdout);
  return {};
}

// The id of the run that is meant; "" on a stop request.
Result<std::string> WaitForRun(const bus::Participant& participant, const Selector& run) {
  if (IsId(run.id)) return run.id;
  ETUDE_ASSIGN_OR_RETURN(auto directory, bus::Directory::Open(participant));
  while (!StopRequested()) {
    ETUDE_ASSIGN_OR_RETURN(const auto found, directory.Find(bus::PresenceKind::kRun, run, std::chrono::seconds(1)));
    if (found) return found->id;
  }
  return std::string();
}

Status Watch(const WatchArguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const Selector run, ParseSelector(arguments.run, "--run"));
  ETUDE_RETURN_IF_ERROR(MakeFolders(arguments.out));
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open());
  Log().info("waiting for checkpoints of run={}", run.text());
  ETUDE_ASSIGN_OR_RETURN(const std::string id, WaitForRun(participant, run));
  if (id.empty()) return {};
  ETUDE_ASSIGN_OR_RETURN(auto subscriber, bus::BlobSubscriber::Open(participant, {run.name, id}, arguments.channel));
  while (!StopRequested()) {
    const auto object = subscriber.Wait(std::chrono::seconds(1));
    if (!object) continue;
    ETUDE_RETURN_IF_ERROR(Keep(*object, arguments.out));
    if (arguments.once) break;
  }
  return {};
}

}  // namespace

void AddCheckpoint(CLI::App& app, Body& body) {
  auto* command = app.add_subcommand("checkpoint", "look at a checkpoint, or keep those that a run publishes");
  command->require_subcommand(1);
  auto file = std::make_shared<std::string>();
  auto as_json = std::make_shared<bool>(false);
  auto* show = command->add_subcommand("show", "metadata, tensors and hash of a .safetensors file");
  show->add_option("file", *file, "checkpoint file")->required();
  show->add_flag("--json", *as_json, "as JSON");
  show->callback([=, &body] { body = [=] { return Show(*file, *as_json); }; });

  auto second = std::make_shared<std::string>();
  auto* difference = command->add_subcommand("diff", "which parts changed from one to another, and by how much");
  difference->add_option("first", *file, "checkpoint file")->required();
  difference->add_option("second", *second, "checkpoint file")->required();
  difference->callback([=, &body] { body = [=] { return ExecSibling("etude-policy", {"diff", *file, *second}); }; });

  auto watching = std::make_shared<WatchArguments>();
  auto* watch = command->add_subcommand("watch", "subscribe to a run; write each verified checkpoint");
  watch->add_option("--run", watching->run, "the run: NAME or NAME@ID")->required();
  watch->add_option("--out", watching->out, "folder for <channel>-<step>.safetensors")->required();
  watch->add_option("--channel", watching->channel, "latest | best (default: both)")
      ->check(CLI::IsMember({"latest", "best"}));
  watch->add_flag("--once", watching->once, "one checkpoint, then end");
  watching->bus.Add(*watch);
  watch->callback([=, &body] { body = [=] { return Watch(*watching); }; });
}

}  // namespace etude::cli
