// SPDX-License-Identifier: Apache-2.0
// Several collectors share a campaign: which of its episodes each of them has.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "services/core/result.h"

namespace etude {

/// Of `count` shards the one of `number`, from 1: it has the episodes whose index leaves number - 1 when divided by
/// `count`. No episode is another one for it, and all shards together are the campaign; one alone has its share of
/// tasks and robots only where `count` and their numbers have no common divisor (of three tasks in turn, each of three
/// shards has one). {1, 1} is the whole campaign.
struct Shard {
  std::uint32_t number = 1, count = 1;

  bool whole() const { return count == 1; }
  bool Has(std::uint64_t index) const { return index % count == number - 1; }
  /// Of the indices 0 .. episodes - 1.
  std::uint64_t CountOf(std::uint64_t episodes) const {
    return episodes < number ? 0 : (episodes - number) / count + 1;
  }
  std::string text() const { return std::to_string(number) + "/" + std::to_string(count); }
  bool operator==(const Shard&) const = default;
};

/// "2/3". @error kInvalidArgument: not NUMBER/COUNT with 1 <= NUMBER <= COUNT <= 1000
Result<Shard> ParseShard(std::string_view text);

}  // namespace etude
