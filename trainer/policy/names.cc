// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/names.h"

#include <algorithm>

namespace etude::policy {

bool IsReservedName(const std::string& name) {
  return name == "image" || name == "language" || name == "joints" || name == "self" || name == "all";
}

const ModuleConfig* FindModule(const PolicyConfig& config, const std::string& name) {
  const auto found = std::ranges::find(config.modules, name, &ModuleConfig::name);
  return found == config.modules.end() ? nullptr : &*found;
}

std::vector<const ModuleConfig*> EvaluationOrder(const PolicyConfig& config) {
  std::vector<const ModuleConfig*> order;
  for (const ModuleConfig& module : config.modules) order.push_back(&module);
  std::stable_sort(order.begin(), order.end(),
                   [](const ModuleConfig* a, const ModuleConfig* b) { return a->level < b->level; });
  return order;
}

std::vector<std::string> ResolveReads(const PolicyConfig& config, const ModuleConfig& module) {
  if (std::find(module.reads.begin(), module.reads.end(), "all") == module.reads.end()) return module.reads;
  std::vector<std::string> reads{"image", "language", "joints"};
  for (const ModuleConfig* other : EvaluationOrder(config))
    if (other->level < module.level) reads.push_back(other->name);
  // what `all` does not have: "self", or a name that is none, which is to be refused and not passed over
  for (const auto& key : module.reads)
    if (key != "all" && std::find(reads.begin(), reads.end(), key) == reads.end()) reads.push_back(key);
  return reads;
}

const Quantity* QuantityOf(const ModuleConfig& module) { return FindQuantity(module.decoder.quantity); }

const std::vector<std::string>& ClassesOf(const PolicyConfig& config, const std::string& quantity) {
  return quantity == "task" ? config.tasks : config.objects;
}

Head HeadOf(const PolicyConfig& config, const ModuleConfig& module) {
  return {module.decoder.readout, module.decoder.rotation, ClassesOf(config, module.decoder.quantity)};
}

bool Decodes(const ModuleConfig& module, const std::string& quantity) {
  const Quantity* own = QuantityOf(module);
  return own != nullptr && own->Implies(quantity);
}

bool ReadsCamera(const PolicyConfig& config) {
  return std::any_of(config.modules.begin(), config.modules.end(),
                     [](const ModuleConfig& module) { return module.decoder.readout == "ray"; });
}

bool DecodesTask(const PolicyConfig& config) {
  return std::any_of(config.modules.begin(), config.modules.end(),
                     [](const ModuleConfig& module) { return module.decoder.quantity == "task"; });
}

int FeatureWidth(const PolicyConfig& config, const DecoderInput& input, int joints) {
  if (input.kind == "register" || input.kind == "language" || input.kind == "joint_token") return config.width;
  if (input.kind == "soft_argmax") return 2 * config.heads + 2;
  if (input.kind == "joints") return input.fourier ? 2 * joints : joints;
  const Quantity* quantity = FindQuantity(input.kind);
  return quantity == nullptr ? 0 : quantity->feature_width({.classes = ClassesOf(config, input.kind)}, input.fourier);
}

std::string AttendedEntity(const std::string& attend) {
  constexpr std::string_view kImage = "image@";
  return attend.starts_with(kImage) ? attend.substr(kImage.size()) : "";
}

bool IsToldWhereToLook(const ModuleConfig& module) {
  return module.attend_weight > 0 && std::any_of(module.attend.begin(), module.attend.end(),
                                                 [](const auto& item) { return !AttendedEntity(item).empty(); });
}

bool HasLoss(const ModuleConfig& module) { return !module.decoder.quantity.empty() || IsToldWhereToLook(module); }

std::vector<data::LabelColumn> LabelColumnsOf(const PolicyConfig& config) {
  std::vector<data::LabelColumn> columns;
  const auto add = [&](const std::string& entity_text, const std::string& quantity_text) {
    const auto entity = data::ParseEntity(entity_text);
    const Quantity* quantity = FindQuantity(quantity_text);
    if (!entity || !quantity) return;
    const std::string name = entity_text + "." + quantity_text;
    for (const auto& column : columns)
      if (column.name == name) return;
    columns.push_back({name, *entity, quantity});
  };
  for (const ModuleConfig& module : config.modules) {
    add(module.decoder.entity, module.decoder.quantity);
    for (const std::string& item : module.attend) add(AttendedEntity(item), "pixel");
  }
  return columns;
}

DecoderInput ParseDecoderInput(const std::string& text) {
  DecoderInput input;
  std::string rest = text;
  constexpr std::string_view kFourier = "fourier:";
  if (rest.starts_with(kFourier)) {
    input.fourier = true;
    rest = rest.substr(kFourier.size());
  }
  const auto colon = rest.find(':');
  input.kind = rest.substr(0, colon);
  if (colon != std::string::npos) input.module = rest.substr(colon + 1);
  return input;
}

const ModuleConfig* DrivingModule(const PolicyConfig& config) {
  const ModuleConfig* driving = nullptr;
  for (const ModuleConfig* module : EvaluationOrder(config))
    if (module->decoder.quantity == "trajectory") driving = module;
  return driving;
}

}  // namespace etude::policy
