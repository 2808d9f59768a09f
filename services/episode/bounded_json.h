// SPDX-License-Identifier: Apache-2.0
// JSON that another process or a file claims to be.
#pragma once

#include <optional>
#include <string_view>

#include "services/core/config.h"

namespace etude {

/// Deeper than anything that Etude writes, and far from what copying or printing a value can take.
inline constexpr int kMaxJsonDepth = 40;

/// Parses JSON from bytes that are not trusted. Never throws.
/// @returns nullopt when it is not JSON, is nested deeper than `max_depth`, or names a key of one
/// object twice. The value's memory is a small multiple (below 64) of the text's, so bound the text
/// first.
std::optional<OrderedJson> ParseBoundedJson(std::string_view text, int max_depth = kMaxJsonDepth);

/// Whether ParseBoundedJson takes the value's text back, as far as depth goes. Goes no deeper than `max_depth`.
bool IsBounded(const OrderedJson& json, int max_depth = kMaxJsonDepth);

}  // namespace etude
