// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/what_if.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "services/episode/bounded_json.h"
#include "trainer/policy/names.h"

namespace etude::policy {
namespace {

constexpr std::size_t kMostText = 64 << 10;  // bytes
constexpr std::size_t kMostHidden = 256;     // rectangles
constexpr int kGrey = 128;
constexpr double kFarthest = 1e6;  // px or m
constexpr float kCertain = 20;     // logit of the name that is said, others 0

tl::unexpected<Error> Refuse(const std::string& why) { return Fail(Code::kInvalidArgument, "what if: " + why); }

const ModuleConfig* FindModule(const PolicyConfig& config, const std::string& name) {
  const auto found = std::ranges::find(config.modules, name, &ModuleConfig::name);
  return found == config.modules.end() ? nullptr : &*found;
}

bool AllNumbers(const OrderedJson& list) {
  return list.is_array() && std::ranges::all_of(list, [](const OrderedJson& x) {
           return x.is_number() && std::isfinite(x.get<double>());
         });
}

Status ReadHide(const OrderedJson& list, WhatIf& what_if) {
  if (!list.is_array() || list.size() > kMostHidden)
    return Refuse(fmt::format("hide: must be a list of at most {} rectangles", kMostHidden));
  for (const auto& item : list) {
    if (!AllNumbers(item) || item.size() != 4) return Refuse("hide: a rectangle is [u0, v0, width, height], px");
    std::array<int, 4> rectangle{};
    for (std::size_t i = 0; i < 4; ++i) {
      const double value = item[i].get<double>();
      if (std::abs(value) > kFarthest) return Refuse("hide: a rectangle lies in no picture");
      rectangle[i] = static_cast<int>(value);
    }
    what_if.hide.push_back(rectangle);
  }
  return {};
}

// numbers that a quantity says; 0: none that can be replaced
std::size_t SizeOf(const std::string& quantity) {
  if (quantity == "pixel") return 2;
  return quantity == "position" || quantity == "displacement" ? 3 : 0;
}

Status CheckSaid(const PolicyConfig& config, const std::string& module, const std::string& quantity,
                 const OrderedJson& value) {
  const std::string at = fmt::format("say.{}.{}", module, quantity);
  const ModuleConfig* known = FindModule(config, module);
  if (!known) {
    std::vector<std::string> names;
    for (const auto& item : config.modules) names.push_back(item.name);
    return Refuse(fmt::format("say: no module '{}'{}", module, Suggestion(module, names)));
  }
  if (known->decoder.quantity != quantity) return Refuse(fmt::format("{}: it says '{}'", at, known->decoder.quantity));
  if (quantity == "class" || quantity == "task") {
    const auto& names = ClassesOf(config, quantity);
    if (!value.is_string()) return Refuse(at + ": must be a name");
    if (std::ranges::find(names, value.get<std::string>()) == names.end())
      return Refuse(
          fmt::format("{}: unknown '{}'{}", at, value.get<std::string>(), Suggestion(value.get<std::string>(), names)));
    return {};
  }
  const std::size_t size = SizeOf(quantity);
  if (size == 0) return Refuse(at + ": cannot be replaced");
  if (!AllNumbers(value) || value.size() != size) return Refuse(fmt::format("{}: must be {} numbers", at, size));
  // a float32 has to hold it
  if (std::ranges::any_of(value, [](const OrderedJson& x) { return std::abs(x.get<double>()) > kFarthest; }))
    return Refuse(fmt::format("{}: lies nowhere near", at));
  return {};
}

Status ReadSay(const OrderedJson& map, const PolicyConfig& config, WhatIf& what_if) {
  if (!map.is_object()) return Refuse("say: must be a map of modules");
  for (const auto& [module, said] : map.items()) {
    if (!said.is_object()) return Refuse(fmt::format("say.{}: must be a map of what it decodes", module));
    for (const auto& [quantity, value] : said.items()) {
      ETUDE_RETURN_IF_ERROR(CheckSaid(config, module, quantity, value));
      what_if.say[module][quantity] = value;
    }
  }
  return {};
}

}  // namespace

Result<WhatIf> ParseWhatIf(const std::string& text, const PolicyConfig& config) {
  WhatIf what_if;
  if (text.empty()) return what_if;
  const auto json = text.size() <= kMostText ? ParseBoundedJson(text) : std::nullopt;
  if (!json || !json->is_object()) return Refuse(fmt::format("must be a JSON map of at most {} bytes", kMostText));
  for (const auto& [key, value] : json->items()) {
    if (key == "sentence") {
      if (!value.is_string()) return Refuse("sentence: must be a text");
      what_if.sentence = value.get<std::string>();
    } else if (key == "hide") {
      ETUDE_RETURN_IF_ERROR(ReadHide(value, what_if));
    } else if (key == "say") {
      ETUDE_RETURN_IF_ERROR(ReadSay(value, config, what_if));
    } else if (key == "worth") {
      if (!value.is_boolean()) return Refuse("worth: must be true or false");
      what_if.worth = value.get<bool>();
    } else {
      return Refuse(fmt::format("unknown key '{}'{}", key, Suggestion(key, {"sentence", "hide", "say", "worth"})));
    }
  }
  return what_if;
}

void Hide(const WhatIf& what_if, torch::Tensor images, const torch::Tensor& crop_origin) {
  const auto u0 = crop_origin[0][0].item<double>(), v0 = crop_origin[0][1].item<double>();
  const auto rows = images.size(2), columns = images.size(3);
  for (const auto& [u, v, width, height] : what_if.hide) {
    const auto left = std::clamp<std::int64_t>(std::lround(u - u0), 0, columns);
    const auto right = std::clamp<std::int64_t>(std::lround(u + width - u0), left, columns);
    const auto top = std::clamp<std::int64_t>(std::lround(v - v0), 0, rows);
    const auto bottom = std::clamp<std::int64_t>(std::lround(v + height - v0), top, rows);
    images.narrow(2, top, bottom - top).narrow(3, left, right - left).fill_(kGrey);
  }
}

Intervention SayInstead(const WhatIf& what_if, const PolicyConfig& config) {
  if (what_if.say.empty()) return {};
  return [say = what_if.say, config](const std::string& module, ModuleOutput& output) {
    const auto said = say.find(module);
    if (said == say.end()) return;
    for (const auto& [quantity, value] : said->second) {
      torch::Tensor& decoded = output.decoded.at(quantity);
      if (value.is_string()) {
        const auto& names = ClassesOf(config, quantity);
        const auto index = std::ranges::find(names, value.get<std::string>()) - names.begin();
        decoded = torch::zeros_like(decoded);
        decoded.select(-1, index).fill_(kCertain);
        continue;
      }
      const auto numbers = value.get<std::vector<float>>();
      decoded = torch::tensor(numbers, decoded.options()).expand_as(decoded).contiguous();
    }
  };
}

}  // namespace etude::policy
