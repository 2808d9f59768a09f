// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/architecture.h"

#include "services/core/hash.h"

namespace etude::policy {
namespace {

OrderedJson Without(const OrderedJson& value, const OrderedJson& defaults);

// each element of a list without what a new element is anyway
OrderedJson ListWithout(const OrderedJson& list, const OrderedJson& element) {
  OrderedJson result = OrderedJson::array();
  for (const auto& item : list) result.push_back(Without(item, element));
  return result;
}

OrderedJson Without(const OrderedJson& value, const OrderedJson& defaults) {
  static const OrderedJson kLayer = ToJson(ImageLayer{});
  static const OrderedJson kModule = ToJson(ModuleConfig{});
  if (!value.is_object() || !defaults.is_object()) return value;
  OrderedJson result = OrderedJson::object();
  for (const auto& [key, item] : value.items()) {
    const auto usual = defaults.find(key);
    if (usual != defaults.end() && *usual == item) continue;
    if (key == "layers")
      result[key] = ListWithout(item, kLayer);
    else if (key == "modules")
      result[key] = ListWithout(item, kModule);
    else
      result[key] = usual == defaults.end() ? item : Without(item, *usual);
  }
  return result;
}

void Erase(OrderedJson& json, std::initializer_list<const char*> keys) {
  if (!json.is_object()) return;
  for (const char* key : keys) json.erase(key);
}

}  // namespace

OrderedJson SaidOf(const PolicyConfig& config) { return Without(ToJson(config), ToJson(PolicyConfig{})); }

OrderedJson LanguageThatWeightsFit(OrderedJson language) {
  if (!language.is_object() || !language.contains("encoder") || !language["encoder"].is_string()) return language;
  LanguageConfig config;
  config.encoder = language["encoder"].get<std::string>();
  if (config.clip_folder().empty()) return language;
  language["encoder"] = "clip";
  Erase(language, {"buckets", "width", "hidden", "senses"});
  return language;
}

std::string ArchitectureHash(const OrderedJson& said) {
  OrderedJson json = said;
  if (json.is_object() && json.contains("language")) json["language"] = LanguageThatWeightsFit(json["language"]);
  Erase(json, {"name", "attention_loss", "losses", "precision", "robot_specific"});
  if (json.contains("modules") && json["modules"].is_array()) {
    for (auto& module : json["modules"]) {
      Erase(module, {"attend", "attend_weight", "detach", "losses"});
      if (module.is_object() && module.contains("decoder")) Erase(module["decoder"], {"weight", "detach"});
      // a decoder that says nothing else is the default's
      if (module.is_object() && module.contains("decoder") && module["decoder"].empty()) module.erase("decoder");
    }
  }
  // keys by name, not in the order in which they were said
  return Sha256Hex(Json(json).dump(-1, ' ', false, Json::error_handler_t::replace));
}

std::string ArchitectureHash(const PolicyConfig& config) { return ArchitectureHash(SaidOf(config)); }

}  // namespace etude::policy
