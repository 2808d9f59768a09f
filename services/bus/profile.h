// SPDX-License-Identifier: Apache-2.0
// The settings of Cyclone DDS as XML. Internal to services/bus.
#pragma once

#include <string>

#include "services/core/result.h"

namespace etude::bus {

/// The text of the profile: `profile` itself where it is XML, the file of that name, or, when it is empty, what
/// CYCLONEDDS_URI says (XML, a file, or file://FILE), else the built-in one. A list of several files in CYCLONEDDS_URI
/// is handed on as it is. @error kUnavailable: a file that cannot be read
Result<std::string> ProfileText(const std::string& profile);

/// Finds what works without security and fails in silence with it. @error kUnavailable: says what to change; also where
/// `profile` is a list of files, which is not looked into
Status CheckSecuredProfile(const std::string& profile);

/// Seconds without a word after which a participant of this profile counts as gone (LeaseDuration), the library's own
/// 10 where it says none.
double LeaseSeconds(const std::string& profile);

}  // namespace etude::bus
