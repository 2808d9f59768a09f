// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/api/graph.h"

#include <algorithm>
#include <map>
#include <set>

#include "services/episode/bounded_json.h"

namespace etude::api {
namespace {

using sources::PartOf;
using sources::TextOf;

std::vector<std::string> Texts(const OrderedJson& list) {
  std::vector<std::string> texts;
  for (const auto& item : list)
    if (item.is_string()) texts.push_back(item.get<std::string>());
  return texts;
}

// "position:EE3D", "fourier:position:EE3D", "register:TAR2D" -> the module, and whether a decoded value is meant
struct DecoderInput {
  std::string module;
  bool decoded = true;
};
DecoderInput InputOf(const std::string& text) {
  const auto colon = text.rfind(':');
  if (colon == std::string::npos) return {};
  return {text.substr(colon + 1), !text.starts_with("register:") && !text.starts_with("soft_argmax:")};
}

struct Edge {
  std::string from, to, kind;
  auto operator<=>(const Edge&) const = default;
};

std::set<Edge> EdgesOf(const OrderedJson& modules, const std::set<std::string>& names) {
  std::set<Edge> edges;
  for (const auto& module : modules) {
    const std::string to = TextOf(module, "name");
    for (const auto& from : Texts(PartOf(module, "reads"))) edges.insert({from, to, "register"});
    if (const auto query = TextOf(module, "query"); !query.empty()) edges.insert({query, to, "query"});
    const auto& decoder = PartOf(module, "decoder");
    for (const auto& from : Texts(PartOf(decoder, "from"))) edges.insert({from, to, "decoded"});
    for (const auto& text : Texts(PartOf(decoder, "inputs"))) {
      const auto input = InputOf(text);
      if (names.contains(input.module)) edges.insert({input.module, to, input.decoded ? "decoded" : "register"});
    }
  }
  return edges;
}

// Columns by level; inside one, modules stand near the mean place of what they read, so that edges cross little. A
// function of the wiring alone: the drawing never jumps.
std::vector<std::vector<std::string>> ColumnsOf(const OrderedJson& modules, const std::vector<std::string>& inputs,
                                                const std::set<Edge>& edges) {
  std::map<std::uint64_t, std::vector<std::string>> levels;
  for (const auto& module : modules)
    levels[sources::UnsignedOf(module, "level").value_or(1)].push_back(TextOf(module, "name"));
  std::vector<std::vector<std::string>> columns{inputs};
  std::map<std::string, double> place;
  for (std::size_t i = 0; i < inputs.size(); ++i)
    place[inputs[i]] = static_cast<double>(i) / static_cast<double>(inputs.size());
  for (auto& [level, names] : levels) {
    std::map<std::string, double> mean;
    for (const auto& name : names) {
      double sum = 0;
      int n = 0;
      for (const auto& edge : edges)
        if (edge.to == name && place.contains(edge.from)) sum += place[edge.from], ++n;
      mean[name] = n == 0 ? 0.5 : sum / n;
    }
    std::ranges::stable_sort(names, {}, [&](const std::string& name) { return mean[name]; });
    for (std::size_t i = 0; i < names.size(); ++i)
      place[names[i]] = (static_cast<double>(i) + 0.5) / static_cast<double>(names.size());
    columns.push_back(names);
  }
  return columns;
}

bool IsFrozen(const OrderedJson& config, const std::string& name) {
  const auto frozen = Texts(PartOf(PartOf(config, "init"), "freeze"));
  return std::ranges::find(frozen, name) != frozen.end();
}

OrderedJson NodeJson(const OrderedJson& module, const sources::CheckpointHeader* header, const OrderedJson& records,
                     const OrderedJson& config) {
  const std::string name = TextOf(module, "name");
  const auto& decoder = PartOf(module, "decoder");
  const auto& record = PartOf(records, name.c_str());
  const auto trained = sources::UnsignedOf(record, "trained_steps");
  const auto parameters =
      header && header->parameters.contains(name) ? OrderedJson(header->parameters.at(name)) : OrderedJson();
  const auto level = sources::UnsignedOf(module, "level").value_or(1);
  std::vector<std::string> between;
  if (TextOf(decoder, "readout") == "difference") between = Texts(PartOf(decoder, "from"));
  std::string relative_to;
  if (const auto from = Texts(PartOf(decoder, "from")); TextOf(decoder, "readout") == "relative" && !from.empty())
    relative_to = from.front();
  return {{"name", name},
          {"level", level},
          {"entity", TextOf(decoder, "entity")},
          {"quantity", TextOf(decoder, "quantity")},
          {"reads", Texts(PartOf(module, "reads"))},
          {"query", TextOf(module, "query")},
          {"attend", Texts(PartOf(module, "attend"))},
          {"inputs", Texts(PartOf(decoder, "inputs"))},
          {"from", Texts(PartOf(decoder, "from"))},
          {"between", between},
          {"relative_to", relative_to},
          {"detach", sources::FlagOf(module, "detach")},
          {"parameters", parameters},
          {"error", sources::Maybe(sources::NumberOf(record, "error"))},
          {"trained_steps", sources::Maybe(trained)},
          {"stage", level},
          {"trained", trained.value_or(0) > 0},
          {"frozen", IsFrozen(config, name)}};
}

}  // namespace

Result<OrderedJson> GraphJson(const sources::RunView& view) {
  const auto& modules = PartOf(PartOf(view.config, "policy"), "modules");
  if (!modules.is_array() || modules.empty() || modules.size() > 200)
    return Fail(Code::kNotFound, "the run has no config.yaml with its policy's modules yet");
  const sources::CheckpointHeader* header = nullptr;
  for (const auto& candidate : view.checkpoints)
    if (!header && candidate.error.empty()) header = &candidate;
  OrderedJson records = OrderedJson::object();
  std::string architecture;
  if (header) {
    if (const auto text = header->metadata.find("modules"); text != header->metadata.end())
      if (auto json = ParseBoundedJson(text->second); json && json->is_object()) records = std::move(*json);
    if (const auto text = header->metadata.find("architecture"); text != header->metadata.end())
      architecture = text->second;
  }
  std::set<std::string> names;
  for (const auto& module : modules) names.insert(TextOf(module, "name"));
  const auto edges = EdgesOf(modules, names);
  std::vector<std::string> inputs;
  for (const char* input : {"image", "language", "joints"}) inputs.emplace_back(input);
  for (const auto& edge : edges)
    if (!names.contains(edge.from) && std::ranges::find(inputs, edge.from) == inputs.end()) inputs.push_back(edge.from);
  OrderedJson nodes = OrderedJson::array(), arrows = OrderedJson::array();
  for (const auto& module : modules) nodes.push_back(NodeJson(module, header, records, view.config));
  for (const auto& edge : edges) arrows.push_back({{"from", edge.from}, {"to", edge.to}, {"kind", edge.kind}});
  return OrderedJson{{"checkpoint", header ? OrderedJson(header->file) : OrderedJson()},
                     {"architecture", sources::TextOrNull(architecture)},
                     {"inputs", inputs},
                     {"nodes", nodes},
                     {"edges", arrows},
                     {"columns", ColumnsOf(modules, inputs, edges)}};
}

}  // namespace etude::api
