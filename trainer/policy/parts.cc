// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/parts.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "trainer/policy/names.h"

namespace etude::policy {
namespace {

constexpr std::string_view kEncoders[] = {"image", "language", "joints"};
constexpr std::string_view kModules = "modules.", kSegments = "segments.", kAttention = "attention";

void AddOnce(std::vector<std::string>& names, const std::string& name) {
  if (!name.empty() && std::ranges::find(names, name) == names.end()) names.push_back(name);
}

}  // namespace

bool IsEncoder(std::string_view part) { return std::ranges::find(kEncoders, part) != std::end(kEncoders); }

std::vector<std::string> PartsOf(const PolicyConfig& config) {
  std::vector<std::string> parts(std::begin(kEncoders), std::end(kEncoders));
  for (const ModuleConfig* module : EvaluationOrder(config)) {
    parts.push_back(module->name);
    AddOnce(parts, AttentionPartOf(config, *module));
  }
  return parts;
}

std::string AttentionPartOf(const PolicyConfig& config, const ModuleConfig& module) {
  return config.attention == "shared" ? fmt::format("{}{}", kAttention, module.level) : "";
}

std::string PartOfTensor(std::string_view tensor) {
  const auto word = [](std::string_view text) { return std::string(text.substr(0, text.find('.'))); };
  if (tensor.starts_with(kModules)) return word(tensor.substr(kModules.size()));
  if (tensor.starts_with(kSegments)) return word(tensor.substr(kSegments.size()));
  const std::string first = word(tensor);
  // "image", "image_key_head", "joints_norm"; no module's name is an encoder's
  const std::string encoder = first.substr(0, first.find('_'));
  if (IsEncoder(encoder)) return encoder;
  return first.starts_with(kAttention) ? first : "";
}

bool IsOfOneInput(std::string_view tensor) {
  if (!tensor.starts_with(kModules)) return false;
  const std::string_view rest = tensor.substr(kModules.size());
  const std::string_view own = rest.substr(std::min(rest.find('.'), rest.size()));
  return own.starts_with(".segments.") || own.starts_with(".decoder.from.");
}

std::vector<std::string> ReadParts(const PolicyConfig& config, const ModuleConfig& module) {
  std::vector<std::string> parts;
  const auto add = [&](const std::string& name) {
    if (name != "self" && name != module.name) AddOnce(parts, name);
  };
  for (const std::string& key : ResolveReads(config, module))
    if (key != "image" || !module.own_image) add(key);
  add(module.query);
  for (const std::string& name : module.decoder.from) add(name);
  for (const std::string& text : module.decoder.inputs) {
    const DecoderInput input = ParseDecoderInput(text);
    if (input.kind == "language") add("language");
    if (input.kind == "joint_token") add("joints");
    add(input.module);
  }
  return parts;
}

std::set<std::string> StatisticsOf(const PolicyConfig& config, const std::string& part) {
  if (part == "joints") return {"joint"};
  const ModuleConfig* module = FindModule(config, part);
  if (!module) return {};
  std::set<std::string> known;
  const auto add = [&](const Quantity* quantity) {
    if (quantity == nullptr) return;
    for (auto& name : quantity->statistics(HeadOf(config, *module))) known.insert(std::move(name));
  };
  add(QuantityOf(*module));
  for (const std::string& text : module->decoder.inputs)
    // Fourier features are of metres
    if (const DecoderInput input = ParseDecoderInput(text); !input.fourier) add(FindQuantity(input.kind));
  return known;
}

Status CheckParts(const PolicyConfig& config, const std::string& what, const std::vector<std::string>& names) {
  const auto parts = PartsOf(config);
  for (const std::string& name : names)
    if (std::ranges::find(parts, name) == parts.end())
      return Fail(Code::kInvalidArgument, fmt::format("{}: the policy has no part '{}'{}; its parts: {}", what, name,
                                                      Suggestion(name, parts), fmt::join(parts, ", ")));
  return {};
}

}  // namespace etude::policy
