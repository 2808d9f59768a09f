// SPDX-License-Identifier: Apache-2.0
#include "services/spec/object_names.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>

#include "services/core/check.h"
#include "services/core/config.h"
#include "services/core/share.h"

namespace etude {
namespace {

constexpr std::string_view kGenerated = "generated:";
constexpr std::string_view kDistractor = "distractor_";
constexpr std::string_view kBall = "ball";

std::vector<std::string> Instances(int from, int to) {
  std::vector<std::string> names;
  for (const std::string& name : GeneratedClasses())
    for (int i = from; i < to; ++i) names.push_back(GeneratedObject(name, i));
  return names;
}

bool Contains(const std::vector<std::string>& names, const std::string& name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

/// "apple_03" as its word and number, whatever they are.
std::optional<GeneratedName> ParseNumbered(const std::string& name) {
  const auto is_digit = [](char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; };
  if (name.size() < 4 || name[name.size() - 3] != '_' || !is_digit(name[name.size() - 2]) || !is_digit(name.back()))
    return std::nullopt;
  return GeneratedName{name.substr(0, name.size() - 3), 10 * (name[name.size() - 2] - '0') + (name.back() - '0')};
}

/// All names but paths, to guess what was meant.
std::vector<std::string> AllNames() {
  std::vector<std::string> names = TabletopObjects();
  names.push_back("basketball");
  const auto generated = GeneratedObjects();
  names.insert(names.end(), generated.begin(), generated.end());
  return names;
}

}  // namespace

const std::vector<std::string>& TabletopObjects() {
  static const std::vector<std::string> names{"cube", "coke", "pepsi", "milk", "bread", "bottle"};
  return names;
}

const std::vector<std::string>& GeneratedClasses() {
  static const std::vector<std::string> names{"apple", "avocado", "donut", "hamburger", "lemon",
                                              "mug",   "orange",  "pear",  "sourdough", "strawberry"};
  return names;
}

std::optional<GeneratedName> ParseGenerated(const std::string& name) {
  const auto numbered = ParseNumbered(name);
  if (!numbered || !Contains(GeneratedClasses(), numbered->class_name) || numbered->instance >= kInstancesPerClass)
    return std::nullopt;
  return numbered;
}

std::string GeneratedObject(const std::string& class_name, int instance) {
  return fmt::format("{}_{:02}", class_name, instance);
}

std::string SplitOfInstance(int instance) { return instance < kTrainInstances ? "train" : "test"; }

std::vector<std::string> TrainObjects() { return Instances(0, kTrainInstances); }
std::vector<std::string> TestObjects() { return Instances(kTrainInstances, kInstancesPerClass); }
std::vector<std::string> GeneratedObjects() { return Instances(0, kInstancesPerClass); }

bool IsObjectPath(const std::string& name) { return name.find('/') != std::string::npos; }

Path ObjectFolder(const Path& object) { return object.filename() == "object.yaml" ? object.parent_path() : object; }

std::optional<Path> SharedObject(const std::string& name) {
  if (!IsPlainName(name)) return std::nullopt;
  static const Result<Path> objects = FindShared("objects");
  std::error_code ignored;
  if (!objects || !std::filesystem::is_regular_file(*objects / name / "object.yaml", ignored)) return std::nullopt;
  return *objects / name;
}

std::string SceneName(const std::string& name) {
  if (!IsObjectPath(name)) return name;
  std::string path = ObjectFolder(name).string();
  while (path.size() > 1 && path.back() == '/') path.pop_back();
  return path.substr(path.rfind('/') + 1);
}

std::vector<std::string> SceneNames(const std::vector<std::string>& names) {
  std::vector<std::string> scene_names;
  for (const std::string& name : names) scene_names.push_back(SceneName(name));
  return scene_names;
}

std::string ObjectNoun(const std::string& name) {
  const std::string called = SceneName(name);  // "objects/mug_00" of the user's is said as "mug_00" is
  // of the user's own there may be more instances than come along
  const auto numbered = ParseNumbered(called);
  return numbered && Contains(GeneratedClasses(), numbered->class_name) ? numbered->class_name : called;
}

std::string BallName(int colour) {
  ETUDE_CHECK(colour >= 0 && colour < kBallColours, "colour={}", colour);
  return fmt::format("{}_{:02}", kBall, colour);
}

std::optional<int> ParseBall(const std::string& name) {
  const auto numbered = ParseNumbered(name);
  if (!numbered || numbered->class_name != kBall || numbered->instance >= kBallColours) return std::nullopt;
  return numbered->instance;
}

std::string DistractorName(const std::string& what) { return std::string(kDistractor) + what; }

bool IsDistractor(const std::string& name) {
  if (!name.starts_with(kDistractor)) return false;
  const std::string what = name.substr(kDistractor.size());
  return ParseGenerated(what).has_value() || ParseBall(what).has_value();
}

std::string WhatDistracts(const std::string& name) {
  ETUDE_CHECK(IsDistractor(name), "name={}", name);
  return name.substr(kDistractor.size());
}

Result<std::vector<std::string>> ExpandObjects(const std::vector<std::string>& names) {
  std::vector<std::string> expanded;
  for (const std::string& name : names) {
    if (!name.starts_with(kGenerated)) {
      expanded.push_back(name);
      continue;
    }
    const std::string which = name.substr(kGenerated.size());
    if (which != "train" && which != "test" && which != "all")
      return Fail(Code::kInvalidArgument,
                  fmt::format("objects: '{}' is not known: generated:train, generated:test, generated:all", name));
    const auto some = which == "train" ? TrainObjects() : which == "test" ? TestObjects() : GeneratedObjects();
    expanded.insert(expanded.end(), some.begin(), some.end());
  }
  return expanded;
}

Status CheckObjectName(const std::string& name) {
  const std::vector<std::string> known = AllNames();
  if (IsObjectPath(name) || Contains(known, name) || SharedObject(name)) return {};
  return Fail(Code::kInvalidArgument,
              fmt::format("objects: '{}' is not known{}; known: {}, basketball, {}_00 to _{:02}, or the folder of an "
                          "imported object (with a '/')",
                          name, Suggestion(name, known), fmt::join(TabletopObjects(), ", "),
                          fmt::join(GeneratedClasses(), "_00, "), kInstancesPerClass - 1));
}

}  // namespace etude
