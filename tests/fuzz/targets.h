// SPDX-License-Identifier: Apache-2.0
// Everything that reads bytes which others made: each as a function of bytes alone, that must neither crash nor take
// memory without bounds, whatever they are. mutation_test.cc runs them over seeded mutations, libfuzzer_main.cc makes
// libFuzzer programs of them.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

namespace etude::fuzz {

using Bytes = std::vector<std::uint8_t>;

struct Target {
  std::string name;
  std::function<void(std::span<const std::uint8_t>)> run;
  std::vector<Bytes> seeds;  ///< sound inputs to begin with
};

/// Those of this program: targets.cc, or policy_targets.cc and gateway_targets.cc, which need more to link.
const std::vector<Target>& Targets();

}  // namespace etude::fuzz
