// SPDX-License-Identifier: Apache-2.0
// What each word of a sentence and each joint is worth: how far the planned waypoints move when it is left out.
#pragma once

#include <string>
#include <vector>

#include "trainer/policy/policy.h"

namespace etude::policy {

/// Words beyond these are not left out: no language encoder reads so many.
inline constexpr std::size_t kMostWords = 64;

/// m, the mean over the waypoints of the distance between each and what it is without the word or the joint. Each is
/// compared with the plan of the same batch, since batching changes bits.
struct Worth {
  struct Word {
    std::string word;  ///< as the sentence has it between its spaces
    double moves = 0;
  };
  std::vector<Word> words;     ///< in the sentence's order
  std::vector<double> joints;  ///< each where it is on average in training, not where it is
};

/// @param inputs  one picture and one sentence, spoken in `sentences`
/// @returns nothing where no module decodes a trajectory, or a plan is not finite. Gradients are the caller's to
/// forbid.
Worth WorthOf(Policy& policy, const Inputs& inputs);

}  // namespace etude::policy
