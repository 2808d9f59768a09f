// SPDX-License-Identifier: Apache-2.0
// What reads a policy's graph out of files and checkpoints, and what viewers wish to see answered otherwise. A program
// of its own: its library is linked with libtorch.
#include "services/core/check.h"
#include "services/core/file.h"
#include "tests/fuzz/targets.h"
#include "trainer/policy/compose.h"
#include "trainer/policy/config.h"
#include "trainer/policy/policy_file.h"
#include "trainer/policy/what_if.h"

namespace etude::fuzz {
namespace {

constexpr char kPolicies[] = "trainer/experiments/policies/compact/";

Bytes BytesOf(const std::string& name) {
  const auto bytes = ReadBinaryFile(kPolicies + name);
  ETUDE_CHECK(bytes.has_value(), "run it in the root of the sources: {}", bytes.error().message);
  return *bytes;
}

const OrderedJson& Base() {
  static const OrderedJson base = [] {
    const Bytes text = BytesOf("base.yaml");
    const auto json = ParseYaml({text.begin(), text.end()}, "base");
    ETUDE_CHECK(json.has_value());
    return *json;
  }();
  return base;
}

// As a graph of its own, and put on top of another one.
void PolicyConfigOf(std::span<const std::uint8_t> bytes) {
  auto json = ParseYaml({bytes.begin(), bytes.end()}, "fuzz");
  if (!json || !json->is_object()) return;
  policy::WriteOutLanguage(*json);
  for (const OrderedJson& graph : {*json, policy::Compose(Base(), *json)}) {
    const auto config = FromJson<policy::PolicyConfig>(graph, "fuzz");
    if (config) (void)config->Validate();
  }
}

const policy::PolicyConfig& BaseConfig() {
  static const policy::PolicyConfig config = [] {
    OrderedJson json = Base();
    policy::WriteOutLanguage(json);
    auto read = FromJson<policy::PolicyConfig>(json, "base");
    ETUDE_CHECK(read.has_value(), "{}", read.error().message);
    read->objects = {"coke", "pepsi", "milk"};
    read->tasks = {"pick", "push"};
    return *read;
  }();
  return config;
}

// What is taken is done to a picture, too: rectangles lie where they like.
void WhatIfOf(std::span<const std::uint8_t> bytes) {
  const auto what_if = policy::ParseWhatIf({bytes.begin(), bytes.end()}, BaseConfig());
  if (!what_if) return;
  policy::Hide(*what_if, torch::zeros({1, 3, 16, 24}, torch::kUInt8), torch::tensor({{10.0F, 20.0F}}));
  (void)policy::SayInstead(*what_if, BaseConfig());
}

std::vector<Target> Make() {
  const auto text = [](const std::string& wish) { return Bytes{wish.begin(), wish.end()}; };
  return {
      {"policy_config", PolicyConfigOf, {BytesOf("base.yaml"), BytesOf("obstacle.yaml"), BytesOf("relational.yaml")}},
      {"what_if",
       WhatIfOf,
       {text(R"({"sentence": "push the coke", "hide": [[100, 80, 12, 12], [12, 21, 4, 2]], "worth": true})"),
        text(R"({"say": {"TAR3D": {"position": [0.1, 0.3, 0.04]}, "TAR2D": {"pixel": [30, 40.5]}}})"),
        text(R"({"say": {"LANG": {"class": "coke"}, "TASK": {"task": "push"}}, "think": {"TAR2D": "zero"}})")}}};
}

}  // namespace

const std::vector<Target>& Targets() {
  static const std::vector<Target> targets = Make();
  return targets;
}

}  // namespace etude::fuzz
