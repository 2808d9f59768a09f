// SPDX-License-Identifier: Apache-2.0
// A policy's graph for people: who reads what, is supervised to attend where, says what, and how far it has come.
#pragma once

#include <string>

#include "trainer/checkpoint/metadata.h"

namespace etude::checkpoint {

/// Level by level, a paragraph a module.
std::string GraphText(const Metadata& metadata);

/// A drawing: a column a level, encoders first. Strong arrows are supervised attention, thin ones what is read
/// besides, dashed ones queries; frozen parts are hatched.
std::string GraphSvg(const Metadata& metadata);

}  // namespace etude::checkpoint
