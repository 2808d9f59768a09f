// SPDX-License-Identifier: Apache-2.0
// What reads a policy's graph out of files and checkpoints. A program of its own: its library is linked with libtorch.
#include "services/core/check.h"
#include "services/core/file.h"
#include "tests/fuzz/targets.h"
#include "trainer/policy/compose.h"
#include "trainer/policy/config.h"
#include "trainer/policy/policy_file.h"

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

std::vector<Target> Make() {
  return {
      {"policy_config", PolicyConfigOf, {BytesOf("base.yaml"), BytesOf("obstacle.yaml"), BytesOf("relational.yaml")}}};
}

}  // namespace

const std::vector<Target>& Targets() {
  static const std::vector<Target> targets = Make();
  return targets;
}

}  // namespace etude::fuzz
