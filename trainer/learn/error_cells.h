// SPDX-License-Identifier: Apache-2.0
// Where a policy errs: by what a sentence asks for, as one figure for all of its modules.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "services/spec/sampling_weights.h"
#include "trainer/learn/evaluate.h"

namespace etude::learn {

/// How far one module was off for one sentence of one picture.
struct SentenceError {
  std::string module;
  std::uint64_t episode = 0;  ///< its number in the dataset
  std::string task;           ///< demonstrated; "" of a relabelled sentence
  std::string object;         ///< noun
  int place = 0;              ///< PlaceOf(the object at the start)
  double error = 0;           ///< in the module's own unit
};

/// Each error relative to the mean of its module (at most kLargestRelativeError), averaged in each cell, so that
/// pixels and metres count alike. A module without any error tells nothing. By task, object and place.
std::vector<ErrorCell> ToErrorCells(const std::vector<SentenceError>& errors);

/// Errors of the modules that say something about what the sentence names, and of the trajectory.
/// @returns nothing when no such module has been reached
/// @error as VisitBatches
Result<std::vector<ErrorCell>> MeasureErrors(policy::Policy& policy, const ValidationSet& set);

}  // namespace etude::learn
