// SPDX-License-Identifier: Apache-2.0
#include "services/spec/predicate_spec.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <string_view>

namespace etude {
namespace {

constexpr std::size_t kLongestWord = 64;

struct Unit {
  std::string_view written, si;
  double factor;
};
constexpr std::array<Unit, 9> kUnits{{{"m", "m", 1},
                                      {"cm", "m", 0.01},
                                      {"mm", "m", 0.001},
                                      {"rad", "rad", 1},
                                      {"deg", "rad", std::numbers::pi / 180},
                                      {"m/s", "m/s", 1},
                                      {"cm/s", "m/s", 0.01},
                                      {"s", "s", 1},
                                      {"ms", "s", 0.001}}};

bool IsWord(const std::string& text) {
  if (text.empty() || text.size() > kLongestWord) return false;
  for (const char c : text)
    if (!((c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_' || c == '-' || c == '+')) return false;
  return true;
}

// "3 cm": true when the text begins like a number
bool BeginsWithNumber(const std::string& text) {
  const std::size_t sign = text.starts_with('-') || text.starts_with('+') ? 1 : 0;
  return text.size() > sign && (text[sign] == '.' || (text[sign] >= '0' && text[sign] <= '9'));
}

Result<PredicateValue> ParseQuantity(const std::string& text, const std::string& where) {
  char* end = nullptr;
  const double number = std::strtod(text.c_str(), &end);
  std::string_view unit(end);
  while (unit.starts_with(' ')) unit.remove_prefix(1);
  if (!std::isfinite(number)) return Fail(Code::kInvalidArgument, fmt::format("{}: '{}' is not finite", where, text));
  if (unit.empty()) return PredicateValue{.number = number};
  for (const Unit& known : kUnits)
    if (unit == known.written) return PredicateValue{.number = number * known.factor, .unit = std::string(known.si)};
  return Fail(Code::kInvalidArgument,
              fmt::format("{}: '{}' has no known unit; known: m, cm, mm, rad, deg, m/s, cm/s, s, ms", where, text));
}

Result<PredicateSpec> Read(const OrderedJson& json, const std::string& where, int depth, int& nodes);

Status ReadArguments(const OrderedJson& json, const std::string& where, int depth, int& nodes, PredicateSpec& spec) {
  if (json.is_null()) return {};
  if (json.is_array()) {
    for (std::size_t i = 0; i < json.size(); ++i) {
      ETUDE_ASSIGN_OR_RETURN(auto child, Read(json[i], fmt::format("{}[{}]", where, i), depth + 1, nodes));
      spec.children.push_back(std::move(child));
    }
    return {};
  }
  if (!json.is_object())
    return Fail(Code::kInvalidArgument, where + ": either a map of parameters or a list of predicates");
  for (const auto& [name, value] : json.items()) {
    if (!IsWord(name)) return Fail(Code::kInvalidArgument, where + ": a parameter's name must be a plain word");
    ETUDE_ASSIGN_OR_RETURN(spec.parameters[name], ParsePredicateValue(value, where + "." + name));
  }
  return {};
}

Result<PredicateSpec> Read(const OrderedJson& json, const std::string& where, int depth, int& nodes) {
  if (depth > kPredicateDepth || ++nodes > kPredicateNodes)
    return Fail(Code::kInvalidArgument, fmt::format("{}: more than {} predicates or {} levels of them", where,
                                                    kPredicateNodes, kPredicateDepth));
  PredicateSpec spec;
  if (json.is_string()) {
    spec.kind = json.get<std::string>();
  } else if (json.is_object() && json.size() == 1) {
    spec.kind = json.begin().key();
  } else {
    return Fail(Code::kInvalidArgument, where + ": a predicate is a word or a map with one entry, {kind: parameters}");
  }
  if (!IsWord(spec.kind)) return Fail(Code::kInvalidArgument, where + ": the kind of a predicate must be a plain word");
  if (json.is_object())
    ETUDE_RETURN_IF_ERROR(ReadArguments(json.begin().value(), where + "." + spec.kind, depth, nodes, spec));
  return spec;
}

OrderedJson ToJson(const PredicateValue& value) {
  if (value.is_word()) return value.word;
  if (value.unit.empty()) return value.number;
  return fmt::format("{} {}", value.number, value.unit);
}

}  // namespace

Result<PredicateValue> ParsePredicateValue(const OrderedJson& json, const std::string& where) {
  if (json.is_number()) {
    const auto number = json.get<double>();
    if (!std::isfinite(number)) return Fail(Code::kInvalidArgument, where + ": is not finite");
    return PredicateValue{.number = number};
  }
  if (!json.is_string()) return Fail(Code::kInvalidArgument, where + ": a number, a quantity like '3 cm', or a word");
  const auto text = json.get<std::string>();
  if (text.size() <= kLongestWord && BeginsWithNumber(text)) return ParseQuantity(text, where);
  if (!IsWord(text)) return Fail(Code::kInvalidArgument, where + ": must be a plain word or a quantity like '3 cm'");
  return PredicateValue{.word = text};
}

Result<PredicateSpec> PredicateFromJson(const OrderedJson& json, const std::string& where) {
  int nodes = 0;
  return Read(json, where, 1, nodes);
}

OrderedJson ToJson(const PredicateSpec& spec) {
  OrderedJson arguments;
  if (!spec.children.empty()) {
    arguments = OrderedJson::array();
    for (const auto& child : spec.children) arguments.push_back(ToJson(child));
  } else if (!spec.parameters.empty()) {
    arguments = OrderedJson::object();
    for (const auto& [name, value] : spec.parameters) arguments[name] = ToJson(value);
  } else {
    return spec.kind;
  }
  return {{spec.kind, std::move(arguments)}};
}

}  // namespace etude
