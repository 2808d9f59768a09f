// SPDX-License-Identifier: Apache-2.0
// What is true at a recorded step, from what its dataset holds, and how far from it is what a policy's modules say.
#pragma once

#include "services/episode/episode.h"
#include "services/policy/insight.h"

namespace etude::api {

/// What of a record may be held against a policy that is shown its picture.
struct TruthScope {
  bool as_spoken = true;     ///< it was told the record's sentence: of another one, target and reference are not known
  bool demonstrated = true;  ///< the commands are an expert's: those of a rollout are a policy's own
};

/// Insight.truth of openapi.json. @param step  control step, in [0, episode.steps())
OrderedJson TruthJson(const Episode& episode, int step, const policy::Insight& insight, const TruthScope& scope);

}  // namespace etude::api
