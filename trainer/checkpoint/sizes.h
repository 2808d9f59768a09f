// SPDX-License-Identifier: Apache-2.0
// How large a network is at least, from its configuration alone: what a hostile file claims is compared with what
// it holds before anything is allocated.
#pragma once

#include <cstdint>

#include "services/core/result.h"
#include "trainer/policy/config.h"

namespace etude::checkpoint {

inline constexpr int kMaxPicture = 4096;  ///< px a side, of a picture that a checkpoint was trained on
inline constexpr int kMaxJoints = 1024;   ///< numbers of an observation's joints

/// Numbers in the matrices of the network: never more than its parameters are.
/// @param config  validated: sizes are in their ranges   @param joints  of an observation, >= 0
std::uint64_t LeastParameters(const policy::PolicyConfig& config, int joints);

/// Whether a network of `config` for an observation of `joints` numbers may be built from `numbers` numbers, and its
/// crop lies in a picture.
/// @error kCorrupt: what it claims and what is there.
Status CheckSizes(const policy::PolicyConfig& config, int joints, std::uint64_t numbers);

}  // namespace etude::checkpoint
