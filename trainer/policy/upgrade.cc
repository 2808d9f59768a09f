// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/upgrade.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "trainer/policy/names.h"

namespace etude::policy {
namespace {

using torch::Tensor;
using Tensors = std::map<std::string, Tensor>;

std::string TextOf(const OrderedJson& map, const char* key) {
  const auto it = map.find(key);
  return it != map.end() && it->is_string() ? it->get<std::string>() : "";
}

bool HasItems(const OrderedJson& map, const char* key) {
  const auto it = map.find(key);
  return it != map.end() && it->is_array() && !it->empty();
}

void Replace(OrderedJson& texts, const std::string& from, const std::string& to) {
  if (!texts.is_array()) return;
  for (auto& text : texts) {
    if (!text.is_string()) continue;
    const auto old = text.get<std::string>();
    if (old.starts_with(from)) text = to + old.substr(from.size());
  }
}

bool ReadsImage(const OrderedJson& module) {
  const auto reads = module.find("reads");
  if (reads == module.end() || !reads->is_array()) return true;  // the default: all
  return std::any_of(reads->begin(), reads->end(),
                     [](const OrderedJson& key) { return key == "image" || key == "all"; });
}

// "target_position" -> target, position
std::pair<std::string, std::string> EntityAndQuantity(const std::string& label) {
  if (label == "displacement") return {"target", "displacement"};
  if (label == "trajectory") return {"ee", "trajectory"};
  const auto underscore = label.find('_');
  if (underscore == std::string::npos) return {"", label};
  return {label.substr(0, underscore), label.substr(underscore + 1)};
}

void UpgradeDecoder(OrderedJson& decoder, bool reads_image) {
  if (!decoder.is_object() || !decoder.contains("target")) return;
  const auto [entity, quantity] = EntityAndQuantity(TextOf(decoder, "target"));
  const std::string relative_to = TextOf(decoder, "relative_to");
  std::string readout = HasItems(decoder, "hidden") ? "mlp" : "linear";
  auto from = OrderedJson::array();
  if (quantity == "pixel" && reads_image) readout = "soft_argmax";
  if (HasItems(decoder, "between")) {
    readout = "difference";
    from = decoder["between"];
  }
  if (!relative_to.empty()) {
    readout = "relative";
    from.push_back(relative_to);
  }
  for (const char* key : {"target", "relative_to", "between"}) decoder.erase(key);
  decoder["entity"] = entity;
  decoder["quantity"] = quantity;
  decoder["readout"] = readout;
  decoder["from"] = from;
  decoder["rotation"] = quantity == "pose" || quantity == "trajectory" ? "euler_sincos" : "6d";
  if (decoder.contains("inputs")) Replace(decoder["inputs"], "waves:", "fourier:");
}

// Columns [0, w0), [w0, w0 + w1), ... of a matrix (or rows, `axis` 0), each under a name of its own.
void Split(Tensors& tensors, const std::string& name, int axis,
           const std::vector<std::pair<std::string, std::int64_t>>& parts) {
  const auto found = tensors.find(name);
  if (found == tensors.end() || found->second.dim() != 2) return;
  std::int64_t total = 0;
  for (const auto& [part, size] : parts) total += size;
  if (found->second.size(axis) != total) return;
  const Tensor whole = found->second;
  tensors.erase(found);
  std::int64_t at = 0;
  for (const auto& [part, size] : parts) {
    const Tensor piece = whole.narrow(axis, at, size).contiguous();
    tensors[part] = axis == 0 ? piece.squeeze(0).clone() : piece.clone();
    at += size;
  }
}

void Rename(Tensors& tensors, const std::string& from, const std::string& to) {
  auto node = tensors.extract(from);
  if (node.empty()) return;
  node.key() = to;
  tensors.insert(std::move(node));
}

void UpgradeModule(const PolicyConfig& config, const ModuleConfig& module, int joints, Tensors& tensors) {
  const std::string prefix = "modules." + module.name + ".";
  std::vector<std::pair<std::string, std::int64_t>> segments, inputs;
  for (const std::string& key : ResolveReads(config, module))
    if (key != "image") segments.emplace_back(prefix + "segments." + key, 1);
  Split(tensors, prefix + "segments", 0, segments);
  for (const std::string& text : module.decoder.inputs)
    inputs.emplace_back(prefix + "decoder.from." + text, FeatureWidth(config, ParseDecoderInput(text), joints));
  Split(tensors, prefix + "decoder.layer0.weight", 1, inputs);
  Rename(tensors, prefix + "decoder.layer0.bias", prefix + "decoder.bias");
}

}  // namespace

OrderedJson UpgradePolicyJson(OrderedJson json) {
  if (!json.is_object()) return json;
  if (json.contains("attention_loss")) {
    const OrderedJson losses{{"attention", {{"kind", TextOf(json, "attention_loss")}}}};
    json.erase("attention_loss");
    // what is no map is left for FromJson to refuse
    if (!json.contains("losses") || json["losses"].is_object()) json["losses"].merge_patch(losses);
  }
  if (!json.contains("modules") || !json["modules"].is_array()) return json;
  for (auto& module : json["modules"]) {
    if (!module.is_object()) continue;
    if (module.contains("attend") && module["attend"].is_array())
      for (auto& item : module["attend"])
        for (const char* entity : {"target", "ee"})
          if (item == std::string("image@") + entity + "_pixel") item = std::string("image@") + entity;
    if (module.contains("decoder")) UpgradeDecoder(module["decoder"], ReadsImage(module));
  }
  return json;
}

void UpgradeStateNames(const PolicyConfig& config, Tensors& tensors) {
  const auto mean = tensors.find("normalization_joint_mean");
  const int joints = mean == tensors.end() ? 0 : static_cast<int>(mean->second.numel());
  std::vector<std::pair<std::string, std::int64_t>> shared{
      {"segments.image", 1}, {"segments.joints", 1}, {"segments.language", 1}};
  for (const ModuleConfig* module : EvaluationOrder(config)) {
    UpgradeModule(config, *module, joints, tensors);
    if (module->query.empty()) shared.emplace_back("segments." + module->name, 1);
  }
  Split(tensors, "segments", 0, shared);
}

}  // namespace etude::policy
