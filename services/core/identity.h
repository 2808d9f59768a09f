// SPDX-License-Identifier: Apache-2.0
// Who a folder is. A campaign's dataset and a run get a random id with their folder: names are for people, and two
// folders may have the same. Ids never enter an episode's bytes.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "services/core/file.h"
#include "services/core/result.h"

namespace etude {

struct Identity {
  std::string id;           ///< 16 lower-case hexadecimal digits
  std::uint64_t since = 0;  ///< when it was minted, seconds since 1970
};

/// What a start does about its folder's id. A copied folder brings its original's id along, and two that are at work
/// under one id would be taken for one.
enum class Claim : std::uint8_t {
  kRefuse,  ///< an id that is live elsewhere is an error
  kNewId,   ///< this folder is a copy: it gets an id of its own
  kAdopt,   ///< this folder goes on in the other's place, which is told to end
};

/// A random id.
std::string NewId();
bool IsId(std::string_view text);

/// FOLDER/identity.json; minted, durable, when there is none or with kNewId. Makes missing folders.
/// @error kCorrupt when the file is not understood, kUnavailable of the disk.
Result<Identity> OpenIdentity(const Path& folder, Claim claim = Claim::kRefuse);
/// @error kNotFound: the folder has none; kCorrupt.
Result<Identity> ReadIdentity(const Path& folder);

/// "NAME" or "NAME@ID", where the first digits of the id are enough.
struct Selector {
  std::string name, id;
  std::string text() const { return id.empty() ? name : name + "@" + id; }
};
/// @error kInvalidArgument: not a plain name, not an id. `what` says what it should name: "--campaign".
Result<Selector> ParseSelector(std::string_view text, std::string_view what);

std::string HostName();
/// The account's name, "uid 1000" when it has none.
std::string UserName();

}  // namespace etude
