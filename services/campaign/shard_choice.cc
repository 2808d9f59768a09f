// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/shard_choice.h"

#include <algorithm>
#include <functional>
#include <iterator>
#include <utility>

#include "services/core/rng.h"

namespace etude::campaign {

ShardChoice::ShardChoice(std::string worker, std::chrono::milliseconds stay)
    : worker_(std::move(worker)), stay_s_(std::chrono::duration<double>(stay).count()) {}

// In [0, 1), another one for each worker and each shard that it goes to.
double ShardChoice::Draw() const {
  return Rng(MixSeed({std::hash<std::string>()(worker_), joins_}, "shard")).Uniform();
}

std::optional<std::uint32_t> ShardChoice::Next(const std::set<std::uint32_t>& open) const {
  if (open.empty()) return std::nullopt;
  const auto any = static_cast<std::ptrdiff_t>(Draw() * static_cast<double>(open.size()));
  if (!last_) return *std::next(open.begin(), any);
  const auto behind = open.upper_bound(*last_);
  return behind == open.end() ? *open.begin() : *behind;
}

void ShardChoice::Joined(std::uint32_t shard) {
  last_ = shard;
  ++joins_;
}

void ShardChoice::WaitLonger() { patience_s_ = std::min(2 * patience_s_, kMostPatience_s); }

bool ShardChoice::HasStayed(double joined_s) const { return joined_s >= stay_s_ * (0.5 + Draw()); }

}  // namespace etude::campaign
