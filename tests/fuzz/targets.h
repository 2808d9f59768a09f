// SPDX-License-Identifier: Apache-2.0
// Everything that reads bytes which others made: each as a function of bytes alone, that must neither crash nor take
// memory without bounds, whatever they are.
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

const std::vector<Target>& Targets();

}  // namespace etude::fuzz
