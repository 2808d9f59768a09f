// SPDX-License-Identifier: Apache-2.0
// Typed configuration. A config is a plain struct with defaults in the class and one Visit function:
//
//   struct RenderConfig {
//     int width = 224;  // > 0
//     bool shadows = false;
//     void Visit(auto& v) {
//       v("width", width, "px", "width of the picture");
//       v("shadows", shadows, "", "whether lights cast shadows");
//     }
//   };
//
//   ETUDE_ASSIGN_OR_RETURN(auto config, LoadConfig<RenderConfig>("render.yaml", {"width=84"}));
//   nlohmann::json resolved = ToJson(config);
//
// From that come reading YAML and JSON, `--set a.b=c`, refusing unknown keys by name with the nearest
// match, and writing the resolved config. Types: bool, integers, double, float, string, enums are
// strings by choice, std::vector<T>, std::map<string, T>, nested configs.
// Unit and meaning are for people: services/core/config_reference.h prints them. The unit of a number without one
// is "-", that of text, switches and nested configs "".
#pragma once

#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "services/core/file.h"
#include "services/core/result.h"

namespace etude {

using Json = nlohmann::json;
/// JSON that keeps keys in the order of Visit; used for files that people read.
using OrderedJson = nlohmann::ordered_json;

/// The text of `json`, on one line unless `indent` >= 0. Bytes that are not UTF-8 (nlohmann's dump would throw) become
/// the replacement character.
std::string JsonText(const OrderedJson& json, int indent = -1);

/// Whether JSON can hold it.
bool IsUtf8(const std::string& text);

/// Parses YAML text into JSON (scalars become bool, integer, number or string as in YAML 1.2 core).
/// @error kInvalidArgument with `origin`, line and column.
Result<OrderedJson> ParseYaml(const std::string& text, const std::string& origin);
/// JSON as YAML text, block style; small numeric lists stay on one line.
std::string ToYaml(const OrderedJson& json);

/// Applies "a.b=value" (value in YAML) to `json`; makes missing maps on the way.
/// @error kInvalidArgument when the text has no '=' or a path element is not a map.
Status ApplyOverride(OrderedJson& json, const std::string& override_text);

/// The candidate nearest to `word` by edit distance, or "" when none is near.
std::string NearestMatch(const std::string& word, const std::vector<std::string>& candidates);
/// ", did you mean 'pick'?", or "" when none is near: behind the word in a message.
std::string Suggestion(const std::string& word, const std::vector<std::string>& candidates);
/// "'pik' is not known, did you mean 'pick'?; known: pick, push"
std::string NotKnown(const std::string& word, const std::vector<std::string>& known);

namespace internal {

template <class T>
struct IsVector : std::false_type {};
template <class T>
struct IsVector<std::vector<T>> : std::true_type {};
template <class T>
struct IsMap : std::false_type {};
template <class T>
struct IsMap<std::map<std::string, T>> : std::true_type {};

class ConfigReader;

/// Reads one value of any supported type from `json` into `value`; problems go to `errors`.
template <class T>
void ReadValue(const OrderedJson& json, const std::string& path, T& value, std::vector<std::string>& errors);

/// The visitor that reads a struct's keys from a JSON map.
class ConfigReader {
 public:
  ConfigReader(const OrderedJson& json, std::string path, std::vector<std::string>& errors)
      : json_(json), path_(std::move(path)), errors_(errors) {}

  template <class T>
  void operator()(const char* key, T& value, const char* = "", const char* = "") {
    known_.push_back(key);
    const auto it = json_.find(key);
    if (it != json_.end()) ReadValue(*it, Join(key), value, errors_);
  }

  /// Reports keys of the map that Visit did not name.
  void Finish();

 private:
  std::string Join(const std::string& key) const { return path_.empty() ? key : path_ + "." + key; }

  const OrderedJson& json_;
  std::string path_;
  std::vector<std::string>& errors_;
  std::vector<std::string> known_;
};

std::string TypeError(const std::string& path, const char* expected, const OrderedJson& found);

template <class T>
OrderedJson WriteValue(const T& value);

/// The visitor that writes a struct into a JSON map.
class ConfigWriter {
 public:
  template <class T>
  void operator()(const char* key, T& value, const char* = "", const char* = "") {
    json[key] = WriteValue(value);
  }
  OrderedJson json = OrderedJson::object();
};

template <class T>
void ReadInteger(const OrderedJson& json, const std::string& path, T& value, std::vector<std::string>& errors) {
  if (!json.is_number_integer()) return errors.push_back(TypeError(path, "an integer", json));
  if (std::is_unsigned_v<T> && !json.is_number_unsigned())
    return errors.push_back(TypeError(path, "an integer >= 0", json));
  const bool fits = json.is_number_unsigned() ? std::in_range<T>(json.get<std::uint64_t>())
                                              : std::in_range<T>(json.get<std::int64_t>());
  if (!fits) return errors.push_back(TypeError(path, "a smaller integer", json));
  value = json.get<T>();
}

inline void ReadText(const OrderedJson& json, const std::string& path, std::string& value,
                     std::vector<std::string>& errors) {
  if (json.is_string())
    value = json.get<std::string>();
  else if (json.is_number() || json.is_boolean())
    value = json.dump();
  else
    errors.push_back(TypeError(path, "text", json));
}

template <class T>
void ReadList(const OrderedJson& json, const std::string& path, T& value, std::vector<std::string>& errors) {
  if (!json.is_array()) return errors.push_back(TypeError(path, "a list", json));
  value.clear();
  for (std::size_t i = 0; i < json.size(); ++i) {
    typename T::value_type item{};
    ReadValue(json[i], path + "[" + std::to_string(i) + "]", item, errors);
    value.push_back(std::move(item));
  }
}

template <class T>
void ReadMap(const OrderedJson& json, const std::string& path, T& value, std::vector<std::string>& errors) {
  value.clear();
  for (const auto& [key, item_json] : json.items()) {
    typename T::mapped_type item{};
    ReadValue(item_json, path + "." + key, item, errors);
    value.emplace(key, std::move(item));
  }
}

template <class T>
void ReadValue(const OrderedJson& json, const std::string& path, T& value, std::vector<std::string>& errors) {
  if constexpr (std::is_same_v<T, bool>) {
    if (!json.is_boolean()) return errors.push_back(TypeError(path, "true or false", json));
    value = json.get<bool>();
  } else if constexpr (std::is_integral_v<T>) {
    ReadInteger(json, path, value, errors);
  } else if constexpr (std::is_floating_point_v<T>) {
    if (!json.is_number()) return errors.push_back(TypeError(path, "a number", json));
    value = json.get<T>();
  } else if constexpr (std::is_same_v<T, std::string>) {
    ReadText(json, path, value, errors);
  } else if constexpr (std::is_same_v<T, OrderedJson>) {
    value = json;
  } else if constexpr (IsVector<T>::value) {
    ReadList(json, path, value, errors);
  } else {
    if (!json.is_object()) return errors.push_back(TypeError(path, "a map", json));
    if constexpr (IsMap<T>::value) {
      ReadMap(json, path, value, errors);
    } else {
      ConfigReader reader(json, path, errors);
      value.Visit(reader);
      reader.Finish();
    }
  }
}

template <class T>
OrderedJson WriteValue(const T& value) {
  if constexpr (std::is_arithmetic_v<T> || std::is_same_v<T, std::string> || std::is_same_v<T, OrderedJson>) {
    return value;
  } else if constexpr (IsVector<T>::value) {
    auto json = OrderedJson::array();
    for (const auto& item : value) json.push_back(WriteValue(item));
    return json;
  } else if constexpr (IsMap<T>::value) {
    auto json = OrderedJson::object();
    for (const auto& [key, item] : value) json[key] = WriteValue(item);
    return json;
  } else {
    ConfigWriter writer;
    const_cast<T&>(value).Visit(writer);  // the writer only reads
    return writer.json;
  }
}

Error ConfigError(const std::string& origin, const std::vector<std::string>& errors);

}  // namespace internal

/// Reads a config from JSON. All problems are reported at once. `origin` names the source in messages.
template <class T>
Result<T> FromJson(const OrderedJson& json, const std::string& origin) {
  T config;
  std::vector<std::string> errors;
  internal::ReadValue(json, "", config, errors);
  if (!errors.empty()) return Fail(internal::ConfigError(origin, errors));
  return config;
}

/// The config with every default filled in.
template <class T>
OrderedJson ToJson(const T& config) {
  return internal::WriteValue(config);
}

/// YAML file + `--set` overrides -> T.
/// @error kNotFound, kInvalidArgument (unknown key with the nearest match, wrong type, bad YAML).
template <class T>
Result<T> LoadConfig(const Path& path, const std::vector<std::string>& overrides = {}) {
  ETUDE_ASSIGN_OR_RETURN(const std::string text, ReadTextFile(path, 1 << 20));
  ETUDE_ASSIGN_OR_RETURN(OrderedJson json, ParseYaml(text, path.string()));
  if (json.is_null()) json = OrderedJson::object();
  for (const auto& text_override : overrides) ETUDE_RETURN_IF_ERROR(ApplyOverride(json, text_override));
  return FromJson<T>(json, path.string());
}

}  // namespace etude
