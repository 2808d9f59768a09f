// SPDX-License-Identifier: Apache-2.0
// `etude checkpoint show|watch`.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <numeric>

#include "services/bus/object_channel.h"
#include "services/cli/command_line.h"
#include "services/core/config.h"
#include "services/core/hash.h"
#include "services/core/log.h"
#include "services/core/stop.h"
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
    OrderedJson parsed = OrderedJson::parse(value, nullptr, false);
    json[key] = parsed.is_structured() ? std::move(parsed) : OrderedJson(value);
  }
  return json;
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
Status Keep(const bus::PublishedObject& object, const Path& out) {
  const auto content = store::DecodeSafetensors(object.bytes);
  if (!content) {
    Log().warn("refused channel={} version={}: {}", object.channel, object.version, content.error().message);
    return {};
  }
  const Path path = out / fmt::format("{}-{:08}.safetensors", object.channel, object.version);
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(path, object.bytes));
  fmt::print("{} {} {}\n", path.string(), object.bytes.size(), object.sha256);
  std::fflush(stdout);
  return {};
}

Status Watch(const WatchArguments& arguments) {
  if (!IsPlainName(arguments.run))
    return Fail(Code::kInvalidArgument, fmt::format("--run '{}': a name of a-z, 0-9, _ and -", arguments.run));
  ETUDE_RETURN_IF_ERROR(MakeFolders(arguments.out));
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open());
  ETUDE_ASSIGN_OR_RETURN(auto subscriber, bus::ObjectSubscriber::Open(participant, arguments.run, arguments.channel));
  Log().info("waiting for checkpoints of run={}", arguments.run);
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

  auto watching = std::make_shared<WatchArguments>();
  auto* watch = command->add_subcommand("watch", "subscribe to a run; write each verified checkpoint");
  watch->add_option("--run", watching->run, "name of the run")->required();
  watch->add_option("--out", watching->out, "folder for <channel>-<step>.safetensors")->required();
  watch->add_option("--channel", watching->channel, "latest | best (default: both)")
      ->check(CLI::IsMember({"latest", "best"}));
  watch->add_flag("--once", watching->once, "one checkpoint, then end");
  watching->bus.Add(*watch);
  watch->callback([=, &body] { body = [=] { return Watch(*watching); }; });
}

}  // namespace etude::cli
