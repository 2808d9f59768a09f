// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/what_if.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "services/episode/bounded_json.h"
#include "trainer/policy/names.h"

namespace etude::policy {
namespace {

constexpr std::size_t kMostText = 64 << 10;  // bytes
constexpr std::size_t kMostHidden = 256;     // rectangles
constexpr std::size_t kMostThoughts = 8;     // modules that think otherwise: a forward pass each
constexpr int kGrey = 128;
constexpr double kFarthest = 1e6;  // px or m
constexpr float kCertain = 20;     // logit of the name that is said, others 0

tl::unexpected<Error> Refuse(const std::string& why) { return Fail(Code::kInvalidArgument, "what if: " + why); }

bool AllNumbers(const OrderedJson& list) {
  return list.is_array() && std::ranges::all_of(list, [](const OrderedJson& x) {
           return x.is_number() && std::isfinite(x.get<double>());
         });
}

Status ReadRectangles(const std::string& key, const OrderedJson& list, std::vector<std::array<int, 4>>& rectangles) {
  if (!list.is_array() || list.size() > kMostHidden)
    return Refuse(fmt::format("{}: must be a list of at most {} rectangles", key, kMostHidden));
  for (const auto& item : list) {
    if (!AllNumbers(item) || item.size() != 4)
      return Refuse(fmt::format("{}: a rectangle is [u0, v0, width, height], px", key));
    std::array<int, 4> rectangle{};
    for (std::size_t i = 0; i < 4; ++i) {
      const double value = item[i].get<double>();
      if (std::abs(value) > kFarthest) return Refuse(fmt::format("{}: a rectangle lies in no picture", key));
      rectangle[i] = static_cast<int>(value);
    }
    rectangles.push_back(rectangle);
  }
  return {};
}

// numbers of a quantity that are replaced; 0: none can be. A pose keeps its rotation, which nothing reads of it.
std::size_t SizeOf(const std::string& quantity) {
  if (quantity == "pixel") return 2;
  return quantity == "position" || quantity == "pose" || quantity == "displacement" ? 3 : 0;
}

bool IsName(const std::string& quantity) { return quantity == "class" || quantity == "task"; }

// Whether a decoder takes what `module` decodes, and not only its register or where it looks.
bool IsRead(const PolicyConfig& config, const std::string& module) {
  return std::ranges::any_of(config.modules, [&](const ModuleConfig& reader) {
    const auto takes = [&](const std::string& text) {
      const DecoderInput input = ParseDecoderInput(text);
      return input.module == module && FindQuantity(input.kind) != nullptr;
    };
    const DecoderConfig& decoder = reader.decoder;
    return std::ranges::find(decoder.from, module) != decoder.from.end() || std::ranges::any_of(decoder.inputs, takes);
  });
}

std::vector<std::string> RegisterReaders(const PolicyConfig& config, const std::string& module) {
  std::vector<std::string> readers;
  for (const ModuleConfig& reader : config.modules) {
    const auto reads = ResolveReads(config, reader);
    const bool decodes = std::ranges::find(reader.decoder.inputs, "register:" + module) != reader.decoder.inputs.end();
    if (decodes || reader.query == module || std::ranges::find(reads, module) != reads.end())
      readers.push_back(reader.name);
  }
  return readers;
}

// Registers stay as they are: with a value that no decoder takes the answer would be the same, and look as if the
// module did not matter.
Status CheckRead(const PolicyConfig& config, const std::string& at, const std::string& module) {
  if (IsRead(config, module)) return {};
  const auto readers = RegisterReaders(config, module);
  std::vector<std::string> others;
  for (const ModuleConfig& other : config.modules) {
    const std::string& quantity = other.decoder.quantity;
    if ((SizeOf(quantity) > 0 || IsName(quantity)) && IsRead(config, other.name))
      others.push_back(fmt::format("{}.{}", other.name, quantity));
  }
  const std::string flows = readers.empty() ? ""
                                            : fmt::format(", only its register is read (by {}), which think replaces",
                                                          fmt::join(readers, ", "));
  return Refuse(
      fmt::format("{}: nothing reads what {} says here{}; {}, or hide a part of the picture, or ask another "
                  "sentence",
                  at, module, flows,
                  others.empty() ? "no value that a module says is read in this policy"
                                 : fmt::format("say {} otherwise", fmt::join(others, " or "))));
}

Status CheckName(const std::string& at, const OrderedJson& value, const std::vector<std::string>& names) {
  if (!value.is_string()) return Refuse(at + ": must be a name");
  const auto name = value.get<std::string>();
  if (std::ranges::find(names, name) != names.end()) return {};
  return Refuse(fmt::format("{}: unknown '{}'{}", at, name, Suggestion(name, names)));
}

Status CheckNumbers(const std::string& at, const OrderedJson& value, const std::string& quantity) {
  const std::size_t size = SizeOf(quantity);
  if (!AllNumbers(value) || value.size() != size)
    return Refuse(fmt::format("{}: must be {} numbers{}", at, size, quantity == "pose" ? "; its rotation stays" : ""));
  // a float32 has to hold it
  if (std::ranges::any_of(value, [](const OrderedJson& x) { return std::abs(x.get<double>()) > kFarthest; }))
    return Refuse(fmt::format("{}: lies nowhere near", at));
  return {};
}

Result<const ModuleConfig*> KnownModule(const PolicyConfig& config, const char* key, const std::string& module) {
  if (const ModuleConfig* known = FindModule(config, module)) return known;
  std::vector<std::string> names;
  for (const auto& item : config.modules) names.push_back(item.name);
  return Refuse(fmt::format("{}: no module '{}'{}", key, module, Suggestion(module, names)));
}

Status CheckSaid(const PolicyConfig& config, const std::string& module, const std::string& quantity,
                 const OrderedJson& value) {
  const std::string at = fmt::format("say.{}.{}", module, quantity);
  ETUDE_ASSIGN_OR_RETURN(const ModuleConfig* known, KnownModule(config, "say", module));
  if (known->decoder.quantity != quantity) return Refuse(fmt::format("{}: it says '{}'", at, known->decoder.quantity));
  if (SizeOf(quantity) == 0 && !IsName(quantity)) return Refuse(at + ": cannot be replaced");
  ETUDE_RETURN_IF_ERROR(CheckRead(config, at, module));
  return IsName(quantity) ? CheckName(at, value, ClassesOf(config, quantity)) : CheckNumbers(at, value, quantity);
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

Status ReadThink(const OrderedJson& map, const PolicyConfig& config, WhatIf& what_if) {
  if (!map.is_object() || map.size() > kMostThoughts)
    return Refuse(fmt::format("think: must be a map of at most {} modules", kMostThoughts));
  for (const auto& [module, thought] : map.items()) {
    const std::string at = "think." + module;
    ETUDE_RETURN_IF_ERROR(KnownModule(config, "think", module));
    const std::string sentence = thought.is_string() ? thought.get<std::string>() : "";
    if (sentence.empty()) return Refuse(fmt::format("{}: must be a sentence, or '{}'", at, kZeroRegister));
    const bool follows =
        !RegisterReaders(config, module).empty() || (sentence != kZeroRegister && IsRead(config, module));
    if (!follows) return Refuse(fmt::format("{}: no module reads what {} thinks", at, module));
    what_if.think[module] = sentence;
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
      ETUDE_RETURN_IF_ERROR(ReadRectangles(key, value, what_if.hide));
    } else if (key == "look_away") {
      ETUDE_RETURN_IF_ERROR(ReadRectangles(key, value, what_if.look_away));
    } else if (key == "say") {
      ETUDE_RETURN_IF_ERROR(ReadSay(value, config, what_if));
    } else if (key == "think") {
      ETUDE_RETURN_IF_ERROR(ReadThink(value, config, what_if));
    } else if (key == "worth") {
      if (!value.is_boolean()) return Refuse("worth: must be true or false");
      what_if.worth = value.get<bool>();
    } else {
      const std::vector<std::string> known{"sentence", "hide", "look_away", "say", "think", "worth"};
      return Refuse(fmt::format("unknown key '{}'{}", key, Suggestion(key, known)));
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

torch::Tensor Unattended(const WhatIf& what_if, const torch::Tensor& crop_origin) {
  if (what_if.look_away.empty()) return {};
  const auto u0 = crop_origin[0][0].item<float>(), v0 = crop_origin[0][1].item<float>();
  std::vector<torch::Tensor> rectangles;
  for (const auto& [u, v, width, height] : what_if.look_away)
    rectangles.push_back(torch::tensor({static_cast<float>(u) - u0, static_cast<float>(v) - v0,
                                        static_cast<float>(width), static_cast<float>(height)}));
  return torch::stack(rectangles);
}

Thoughts ThoughtsOf(const WhatIf& what_if, Policy& policy, Inputs inputs) {
  Thoughts thoughts;
  for (const auto& [module, sentence] : what_if.think) {
    if (sentence == kZeroRegister || thoughts.contains(sentence)) continue;
    inputs.sentences = {sentence};
    thoughts[sentence] = policy.Forward(inputs);
  }
  return thoughts;
}

Intervention SayInstead(const WhatIf& what_if, const PolicyConfig& config, Thoughts thoughts) {
  if (what_if.say.empty() && what_if.think.empty()) return {};
  return [say = what_if.say, think = what_if.think, thoughts = std::move(thoughts), config](const std::string& module,
                                                                                            ModuleOutput& output) {
    if (const auto thought = think.find(module); thought != think.end()) {
      if (thought->second == kZeroRegister)
        output.register_token = torch::zeros_like(output.register_token);
      else
        output = thoughts.at(thought->second).at(module);
    }
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
      decoded = decoded.clone();
      decoded.narrow(-1, 0, static_cast<std::int64_t>(numbers.size())).copy_(torch::tensor(numbers, decoded.options()));
    }
  };
}

}  // namespace etude::policy
