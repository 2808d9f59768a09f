// SPDX-License-Identifier: Apache-2.0
#include "services/spec/shard.h"

#include <fmt/format.h>

#include <charconv>

namespace etude {
namespace {

constexpr std::uint32_t kMostShards = 1000;

bool ReadShardNumber(std::string_view text, std::uint32_t& number) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  return error == std::errc() && end == text.data() + text.size();
}

}  // namespace

Result<Shard> ParseShard(std::string_view text) {
  const auto slash = text.find('/');
  Shard shard;
  const bool good = slash != std::string_view::npos && ReadShardNumber(text.substr(0, slash), shard.number) &&
                    ReadShardNumber(text.substr(slash + 1), shard.count);
  if (good && shard.number >= 1 && shard.number <= shard.count && shard.count <= kMostShards) return shard;
  return Fail(Code::kInvalidArgument,
              fmt::format("shard '{}': say NUMBER/COUNT, e.g. 1/3, 2/3 and 3/3 for three collectors (at most {})", text,
                          kMostShards));
}

}  // namespace etude
