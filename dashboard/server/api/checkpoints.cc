// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/api/checkpoints.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <map>
#include <set>

#include "dashboard/server/api/run_figures.h"
#include "services/episode/bounded_json.h"
#include "services/monitor/topics.h"

namespace etude::api {
namespace {

using sources::Maybe;
using sources::PartOf;
using sources::TextOf;
using sources::TextOrNull;

class Metadata {
 public:
  explicit Metadata(const std::map<std::string, std::string>& values) : values_(values) {}
  std::string Text(const char* key) const {
    const auto found = values_.find(key);
    return found == values_.end() ? "" : found->second;
  }
  OrderedJson TextOrNull(const char* key) const { return sources::TextOrNull(Text(key)); }
  OrderedJson Number(const char* key) const {
    const std::string text = Text(key);
    if (text.empty() || !std::ranges::all_of(text, [](char c) { return c >= '0' && c <= '9'; })) return nullptr;
    return std::strtoull(text.c_str(), nullptr, 10);
  }
  OrderedJson Part(const char* key) const {
    auto json = ParseBoundedJson(Text(key));
    return json && json->is_object() ? std::move(*json) : OrderedJson::object();
  }

 private:
  const std::map<std::string, std::string>& values_;
};

OrderedJson ModulesJson(const OrderedJson& modules, const OrderedJson& config) {
  OrderedJson json = OrderedJson::object();
  for (const auto& [name, record] : modules.items())
    json[name] = {{"quantity", TextOrNull(QuantityOf(config, name))},
                  {"trained_steps", Maybe(sources::UnsignedOf(record, "trained_steps"))},
                  {"error", Maybe(sources::NumberOf(record, "error"))}};
  return json;
}

OrderedJson CheckpointJson(const sources::CheckpointHeader& header, const OrderedJson& config,
                           const OrderedJson& served_by) {
  const Metadata metadata(header.metadata);
  const OrderedJson embodiment = metadata.Part("embodiment");
  const OrderedJson said = metadata.Part("metrics");
  OrderedJson metrics = OrderedJson::object();
  for (const auto& [name, value] : said.items())
    if (value.is_number() || value.is_null()) metrics[name] = value;
  const OrderedJson stage = metadata.Number("stage"), stages = metadata.Number("stages");
  const std::string refused = metadata.Text("refused");
  return {{"file", header.file},
          {"step", metadata.Number("step")},
          {"stage", stage},
          {"stages", stages},
          {"stage_name", metadata.TextOrNull("stage_name")},
          {"bytes", header.stamp.size},
          {"modified", sources::Rfc3339(header.stamp.modified_s())},
          {"sha256", TextOrNull(header.sha256)},
          {"channels", header.channels},
          {"metrics", metrics},
          {"modules", ModulesJson(metadata.Part("modules"), config)},
          {"parameters", header.parameters},
          {"dataset", metadata.TextOrNull("dataset")},
          {"architecture", metadata.TextOrNull("architecture")},
          {"robot", TextOrNull(TextOf(embodiment, "robot"))},
          {"joints", Maybe(sources::UnsignedOf(embodiment, "joints"))},
          {"train_episodes", metadata.Number("train_episodes")},
          {"version", metadata.TextOrNull("version")},
          {"run", metadata.TextOrNull("run")},
          {"control_trained", header.error.empty() && refused.empty() && !stage.is_null() && stage == stages},
          {"refused", TextOrNull(refused)},
          {"error", TextOrNull(header.error)},
          {"served_by", served_by}};
}

// By the hash of what a server says that it serves, or by its step until the file is hashed.
OrderedJson ServedBy(const live::LiveView& live, const std::string& run_id, const sources::CheckpointHeader& header) {
  OrderedJson servers = OrderedJson::array();
  const auto step = Metadata(header.metadata).Number("step");
  for (const auto* server : ServersOf(live, run_id)) {
    const auto& status = server->status;
    if (header.sha256.empty() ? step != status.step : header.sha256 != status.sha256) continue;
    servers.push_back({{"host", status.host}, {"since", sources::TimeJson(static_cast<double>(status.since))}});
  }
  return servers;
}

// Who reads what the run publishes, servers and relays among them: by process, as DDS has discovered it.
OrderedJson SubscribersOf(const live::LiveView& live, const std::string& run_id) {
  constexpr std::size_t kMost = 200;
  OrderedJson subscribers = OrderedJson::array();
  if (run_id.empty()) return subscribers;
  const auto names = monitor::PeerNames(live.processes);
  std::set<std::string> seen{live.participant};
  for (const auto& endpoint : *live.endpoints) {
    if (endpoint.is_writer || endpoint.topic != "etude/blob/published_manifest") continue;
    // bus::Owner::partition: NAME/ID
    const bool of_run =
        std::ranges::any_of(endpoint.partitions, [&](const auto& name) { return name.ends_with("/" + run_id); });
    if (!of_run || !seen.insert(endpoint.participant).second || subscribers.size() >= kMost) continue;
    const auto name = names.find(endpoint.participant);
    subscribers.push_back({{"peer", name == names.end() ? OrderedJson() : OrderedJson(name->second)},
                           {"participant", endpoint.participant}});
  }
  return subscribers;
}

}  // namespace

Result<http::Answer> Checkpoints(Context& context, const http::Request& request) {
  const std::string id = request.Parameter("id");
  ETUDE_ASSIGN_OR_RETURN(const OpenedRun opened, OpenRun(context, id));
  context.HashInBackground(opened.source);
  const auto live = context.live();
  OrderedJson rows = OrderedJson::array();
  for (const auto& header : opened.view->checkpoints)
    rows.push_back(CheckpointJson(header, opened.view->config, ServedBy(*live, opened.view->identity, header)));
  const auto state = StateOf(opened.view.get(), LiveOf(*live, *opened.view));
  OrderedJson next;
  const auto every = sources::UnsignedOf(PartOf(opened.view->config, "checkpoint"), "every_steps").value_or(0);
  if (every > 0 && state.state == "running") next = (state.step / every + 1) * every;
  return http::JsonAnswer({{"run", id},
                           {"checkpoints", rows},
                           {"next_step", next},
                           {"subscribers", SubscribersOf(*live, opened.view->identity)}});
}

namespace {

// What whoever saves it may call it: a name from a folder may have quotes and line ends.
std::string Attachment(const std::string& name) {
  std::string plain = name;
  for (char& c : plain)
    if (!std::isalnum(static_cast<unsigned char>(c)) && c != '-' && c != '_' && c != '.') c = '_';
  return fmt::format("attachment; filename=\"{}\"", plain);
}

}  // namespace

Result<http::Answer> CheckpointFile(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const OpenedRun opened, OpenRun(context, request.Parameter("id")));
  const std::string name = request.Parameter("file");
  const auto& headers = opened.view->checkpoints;
  const auto header = std::ranges::find(headers, name, &sources::CheckpointHeader::file);
  if (header == headers.end())
    return Fail(Code::kNotFound, fmt::format("the run has no checkpoint file '{:.100}'", name));
  ETUDE_ASSIGN_OR_RETURN(auto open, sources::OpenBelow(opened.source->found().folder / "checkpoints", header->file));
  http::Answer answer;
  answer.content_type = "application/vnd.safetensors";
  answer.file = http::FileBody{std::make_shared<Descriptor>(std::move(open.file)), open.stamp.size};
  answer.etag = open.stamp.tag();
  answer.headers.emplace_back("Content-Disposition", Attachment(opened.source->found().id + "-" + header->file));
  return answer;
}

}  // namespace etude::api
