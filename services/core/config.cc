// SPDX-License-Identifier: Apache-2.0
#include "services/core/config.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <numeric>
#include <optional>
#include <sstream>

namespace etude {
namespace {

// nesting deeper than this is an attack or a mistake, not a config
constexpr int kMaxDepth = 64;
// what a text may come to with its aliases written out, in bytes: so many times its own, and some more
constexpr std::size_t kMostExpansion = 8, kFreeExpansion = 1u << 16;

template <class Number>
std::optional<Number> ParseNumber(const std::string& text) {
  const char* first = text.data() + (text.starts_with('+') ? 1 : 0);
  Number value{};
  const auto [end, error] = std::from_chars(first, text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

OrderedJson ScalarToJson(const YAML::Node& node) {
  const std::string& text = node.Scalar();
  if (node.Tag() == "!") return text;  // quoted
  if (text == "~" || text == "null" || text.empty()) return nullptr;
  if (text == "true" || text == "True") return true;
  if (text == "false" || text == "False") return false;
  if (const auto integer = ParseNumber<std::int64_t>(text))
    return *integer >= 0 ? OrderedJson(static_cast<std::uint64_t>(*integer)) : OrderedJson(*integer);
  if (const auto large = ParseNumber<std::uint64_t>(text)) return *large;
  if (const auto number = ParseNumber<double>(text); number && std::isfinite(*number)) return *number;
  return text;
}

// @param room  bytes that the rest may come to: an alias (*name) becomes a copy, so that lists of aliases of lists of
// aliases would grow without bounds
Result<OrderedJson> NodeToJson(const YAML::Node& node, const std::string& origin, int depth, std::size_t& room) {
  const auto where = [&] { return fmt::format("{}:{}:{}", origin, node.Mark().line + 1, node.Mark().column + 1); };
  if (depth > kMaxDepth) return Fail(Code::kInvalidArgument, where() + ": nested too deeply");
  const std::size_t size = node.IsScalar() ? node.Scalar().size() + 1 : 1;
  if (size > room)
    return Fail(Code::kInvalidArgument,
                fmt::format("{}: its aliases (*name) come to more than {} times the text", where(), kMostExpansion));
  room -= size;
  switch (node.Type()) {
    case YAML::NodeType::Undefined:
    case YAML::NodeType::Null:
      return OrderedJson(nullptr);
    case YAML::NodeType::Scalar:
      return ScalarToJson(node);
    case YAML::NodeType::Sequence: {
      auto list = OrderedJson::array();
      for (const auto& item : node) {
        ETUDE_ASSIGN_OR_RETURN(auto value, NodeToJson(item, origin, depth + 1, room));
        list.push_back(std::move(value));
      }
      return list;
    }
    case YAML::NodeType::Map: {
      auto map = OrderedJson::object();
      for (const auto& pair : node) {
        const YAML::Node& key = pair.first;
        if (!key.IsScalar()) return Fail(Code::kInvalidArgument, where() + ": a key must be text");
        if (map.contains(key.Scalar()))
          return Fail(Code::kInvalidArgument, fmt::format("{}: key '{}' stands twice", where(), key.Scalar()));
        room -= std::min(room, key.Scalar().size());
        ETUDE_ASSIGN_OR_RETURN(map[key.Scalar()], NodeToJson(pair.second, origin, depth + 1, room));
      }
      return map;
    }
  }
  return Fail(Code::kInternal, where() + ": unknown YAML node");
}

int EditDistance(const std::string& a, const std::string& b) {
  std::vector<int> row(b.size() + 1);
  std::iota(row.begin(), row.end(), 0);
  for (std::size_t i = 1; i <= a.size(); ++i) {
    int diagonal = row[0];
    row[0] = static_cast<int>(i);
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const int substitution = diagonal + (a[i - 1] != b[j - 1]);
      diagonal = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, substitution});
    }
  }
  return row[b.size()];
}

// Quoted where it would read back as something else.
void EmitText(const std::string& text, YAML::Emitter& out) {
  const YAML::Node probe(text);
  const bool has_control = std::any_of(text.begin(), text.end(), [](unsigned char c) { return c < ' '; });
  if (has_control || !ScalarToJson(probe).is_string()) out << YAML::DoubleQuoted;
  out << text;
}

void EmitYaml(const OrderedJson& json, YAML::Emitter& out) {
  if (json.is_object()) {
    if (json.empty()) out << YAML::Flow;  // {}: the block style of no keys is nothing at all
    out << YAML::BeginMap;
    for (const auto& [key, value] : json.items()) {
      out << YAML::Key;
      EmitText(key, out);
      out << YAML::Value;
      EmitYaml(value, out);
    }
    out << YAML::EndMap;
  } else if (json.is_array()) {
    const bool flat = std::none_of(json.begin(), json.end(), [](const auto& item) { return item.is_structured(); });
    if (flat) out << YAML::Flow;
    out << YAML::BeginSeq;
    for (const auto& item : json) EmitYaml(item, out);
    out << YAML::EndSeq;
  } else if (json.is_string()) {
    EmitText(json.get_ref<const std::string&>(), out);
  } else if (json.is_null()) {
    out << YAML::Null;
  } else {
    out << json.dump();
  }
}

}  // namespace

// nlohmann's serializer is the one that must accept the text later, so it is the judge here
bool IsUtf8(const std::string& text) {
  try {
    (void)OrderedJson(text).dump();
    return true;
  } catch (const OrderedJson::exception&) {
    return false;
  }
}

std::string JsonText(const OrderedJson& json, int indent) {
  return json.dump(indent, ' ', false, OrderedJson::error_handler_t::replace);
}

namespace {

// "---" in the first column is a marker wherever it stands. (yaml-cpp's LoadAll, which would say so, never ends with
// some malformed texts.)
bool HasSecondDocument(const std::string& text) {
  bool begun = false;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    const bool is_marker =
        line.starts_with("---") && (line.size() == 3 || std::isspace(static_cast<unsigned char>(line[3])));
    if (is_marker && begun) return true;
    const auto first = line.find_first_not_of(" \t\r");
    begun = begun || is_marker || (first != std::string::npos && line[first] != '#' && line[0] != '%');
  }
  return false;
}

}  // namespace

Result<OrderedJson> ParseYaml(const std::string& text, const std::string& origin) {
  if (!IsUtf8(text)) return Fail(Code::kInvalidArgument, origin + ": not UTF-8 text");
  try {
    std::size_t room = kMostExpansion * text.size() + kFreeExpansion;
    if (HasSecondDocument(text))
      return Fail(Code::kInvalidArgument, origin + ": several YAML documents ('---' between them), one is expected");
    return NodeToJson(YAML::Load(text), origin, 0, room);
  } catch (const YAML::Exception& error) {
    return Fail(Code::kInvalidArgument,
                fmt::format("{}:{}:{}: {}", origin, error.mark.line + 1, error.mark.column + 1, error.msg));
  }
}

std::string ToYaml(const OrderedJson& json) {
  YAML::Emitter out;
  EmitYaml(json, out);
  return std::string(out.c_str()) + "\n";
}

Status ApplyOverride(OrderedJson& json, const std::string& override_text) {
  const auto equals = override_text.find('=');
  if (equals == std::string::npos || equals == 0)
    return Fail(Code::kInvalidArgument,
                fmt::format("--set '{}': expected KEY=VALUE, e.g. --set camera.width=84", override_text));
  ETUDE_ASSIGN_OR_RETURN(auto value, ParseYaml(override_text.substr(equals + 1), "--set " + override_text));
  OrderedJson* node = &json;
  std::string rest = override_text.substr(0, equals);
  while (true) {
    if (node->is_null()) *node = OrderedJson::object();
    if (!node->is_object())
      return Fail(Code::kInvalidArgument,
                  fmt::format("--set '{}': '{}' lies below a value that is not a map", override_text, rest));
    const auto dot = rest.find('.');
    node = &(*node)[rest.substr(0, dot)];
    if (dot == std::string::npos) break;
    rest = rest.substr(dot + 1);
  }
  *node = std::move(value);
  return {};
}

std::string NearestMatch(const std::string& word, const std::vector<std::string>& candidates) {
  std::string best;
  int best_distance = std::max<int>(2, static_cast<int>(word.size()) / 2) + 1;
  for (const auto& candidate : candidates) {
    const int distance = EditDistance(word, candidate);
    if (distance < best_distance) {
      best_distance = distance;
      best = candidate;
    }
  }
  return best;
}

std::string Suggestion(const std::string& word, const std::vector<std::string>& candidates) {
  const std::string nearest = NearestMatch(word, candidates);
  return nearest.empty() ? "" : fmt::format(", did you mean '{}'?", nearest);
}

std::string NotKnown(const std::string& word, const std::vector<std::string>& known) {
  return fmt::format("'{}' is not known{}; known: {}", word, Suggestion(word, known), fmt::join(known, ", "));
}

namespace internal {

void ConfigReader::Finish() {
  for (const auto& [key, value] : json_.items()) {
    if (std::find(known_.begin(), known_.end(), key) != known_.end()) continue;
    const std::string nearest = NearestMatch(key, known_);
    errors_.push_back(nearest.empty() ? fmt::format("unknown key '{}' (known: {})", Join(key), fmt::join(known_, ", "))
                                      : fmt::format("unknown key '{}': did you mean '{}'?", Join(key), nearest));
  }
}

std::string TypeError(const std::string& path, const char* expected, const OrderedJson& found) {
  return fmt::format("{}: expected {}, found {}", path.empty() ? "the file" : "'" + path + "'", expected,
                     JsonText(found));
}

Error ConfigError(const std::string& origin, const std::vector<std::string>& errors) {
  return {Code::kInvalidArgument, fmt::format("{}: {}", origin, fmt::join(errors, "; "))};
}

}  // namespace internal
}  // namespace etude
