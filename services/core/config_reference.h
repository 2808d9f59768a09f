// SPDX-License-Identifier: Apache-2.0
// The reference of a config, from its Visit function: every key with type, default, unit and meaning.
#pragma once

#include <string>
#include <type_traits>
#include <vector>

#include "services/core/config.h"

namespace etude {

/// One key of a config, for people.
struct ConfigKey {
  std::string path;           ///< "camera.width"; "modules[].name" in a list's items, "wait.NAME" in a map's values
  std::string type;           ///< "integer", "number", "text", "true or false", "list of numbers", "section"
  std::string default_value;  ///< as JSON; "" of a section
  std::string unit;           ///< "m/s"; "-": a number without; "": not a number
  std::string meaning;
};

namespace internal {

/// Nesting at which a reference ends: a config that holds a list of its own kind has no end.
inline constexpr int kMaxReferenceDepth = 6;

template <class T>
constexpr bool kIsSection = !std::is_arithmetic_v<T> && !std::is_same_v<T, std::string> &&
                            !std::is_same_v<T, OrderedJson> && !IsVector<T>::value && !IsMap<T>::value;

/// What a value is called, and with `many` a list of them.
template <class T>
std::string TypeName(bool many = false) {
  if constexpr (std::is_same_v<T, bool>) {
    return many ? "switches" : "true or false";
  } else if constexpr (std::is_integral_v<T>) {
    return many ? "integers" : "integer";
  } else if constexpr (std::is_floating_point_v<T>) {
    return many ? "numbers" : "number";
  } else if constexpr (std::is_same_v<T, std::string>) {
    return many ? "texts" : "text";
  } else if constexpr (std::is_same_v<T, OrderedJson>) {
    return "any";
  } else if constexpr (IsVector<T>::value) {
    return std::string(many ? "lists of " : "list of ") + TypeName<typename T::value_type>(true);
  } else if constexpr (IsMap<T>::value) {
    return std::string(many ? "maps of " : "map of ") + TypeName<typename T::mapped_type>(true);
  } else {
    return many ? "sections" : "section";
  }
}

/// The visitor that collects keys.
class ConfigReferrer {
 public:
  ConfigReferrer(std::string prefix, int depth, std::vector<ConfigKey>& keys)
      : prefix_(std::move(prefix)), depth_(depth), keys_(keys) {}

  template <class T>
  void operator()(const char* key, T& value, const char* unit = "", const char* meaning = "") {
    const std::string path = prefix_ + key;
    keys_.push_back({path, TypeName<T>(), kIsSection<T> ? "" : WriteValue(value).dump(), unit, meaning});
    Enter(path, value);
  }

 private:
  template <class T>
  void Enter(const std::string& path, T& value) {
    if (depth_ >= kMaxReferenceDepth) return;
    if constexpr (IsVector<T>::value) {
      typename T::value_type item{};
      Enter(path + "[]", item);
    } else if constexpr (IsMap<T>::value) {
      typename T::mapped_type item{};
      Enter(path + ".NAME", item);
    } else if constexpr (kIsSection<T>) {
      ConfigReferrer inner(path + ".", depth_ + 1, keys_);
      value.Visit(inner);
    }
  }

  std::string prefix_;
  int depth_;
  std::vector<ConfigKey>& keys_;
};

}  // namespace internal

/// All keys of config T in the order of Visit, a section before its keys.
template <class T>
std::vector<ConfigKey> ConfigReference() {
  std::vector<ConfigKey> keys;
  internal::ConfigReferrer referrer("", 0, keys);
  T config{};
  config.Visit(referrer);
  return keys;
}

/// What is missing: "camera.width: no meaning", "camera.width: no unit".
std::vector<std::string> MissingFromReference(const std::vector<ConfigKey>& keys);

/// As text, two lines a key: path, type, unit and default, then the meaning.
std::string FormatReference(const std::vector<ConfigKey>& keys);
/// To standard output, as text or as a JSON list of {key, type, unit, default, meaning}.
void PrintReference(const std::vector<ConfigKey>& keys, bool as_json);

}  // namespace etude
