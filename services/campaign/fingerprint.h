// SPDX-License-Identifier: Apache-2.0
// What the bytes of a host's episodes depend on beside the spec, as its workers say it (worker/fingerprint.h takes it),
// and whether two hosts agree.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "services/core/result.h"

namespace etude::campaign {

/// Name and value, in a fixed order: content, libraries, gl, picture, physics, libm, deflated.
using Fingerprint = std::vector<std::pair<std::string, std::string>>;

/// A JSON object, for a message and a file.
std::string FingerprintText(const Fingerprint& fingerprint);
/// @error kCorrupt: no JSON object of at most 32 texts of at most 4096 bytes
Result<Fingerprint> ParseFingerprint(std::string_view text);
/// Twelve hexadecimal digits of its SHA-256: what an episode's line in the journal says of its host.
std::string ShortHash(const Fingerprint& fingerprint);

/// The first line in which `other` makes other episodes than `first`: "physics: here 1a.., there 2b..". Nothing when
/// they agree in what a campaign's `determinism` asks for: bytes (all lines) | physics (not gl, picture and deflated) |
/// none. Of "deflated" a program of before it says nothing, and is taken for one that agrees.
std::optional<std::string> FirstDifference(const Fingerprint& first, const Fingerprint& other,
                                           std::string_view determinism);

}  // namespace etude::campaign
