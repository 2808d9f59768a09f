// SPDX-License-Identifier: Apache-2.0
// Which replay an attempt's is.
#pragma once

#include <cstdint>
#include <string>

#include "dashboard/server/api/context.h"

namespace etude::api {

/// An attempt that may be made again.
struct ReplayableAttempt {
  Path folder;      ///< of its dataset
  std::string key;  ///< of sources::Replays
};
/// @error kNotFound: no such dataset, or the campaign has no such episode; kInvalidArgument: it cannot be made again
Result<ReplayableAttempt> FindAttempt(Context& context, const std::string& dataset, std::uint64_t index,
                                      std::uint32_t attempt);
/// The dataset of its replay that is in the cache and has pictures; "": there is none. To list it is no use of it.
std::string PicturedReplay(Context& context, const OpenedDataset& opened, std::uint64_t index, std::uint32_t attempt);

}  // namespace etude::api
