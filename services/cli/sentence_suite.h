// SPDX-License-Identifier: Apache-2.0
// Sentences to say to a policy: those of the paper's tables, or a file of the user's own.
#pragma once

#include <optional>
#include <set>
#include <string>
#include <vector>

#include "services/core/config.h"
#include "services/core/file.h"
#include "services/core/result.h"
#include "services/spec/campaign_spec.h"

namespace etude::cli {

/// "table8": the paper's fifty noun phrases, each pushed, as there ("push skimmed milk package"); "table11": its thirty
/// sentences; anything else: a file, a line each of
///
///   TASK OBJECT: SENTENCE                    pick bread: grab the loafs
///   TASK OBJECT REFERENCE: SENTENCE          place_left milk bread: put the carton left of the loaf
///
/// with an object's name or its class. Empty lines and lines that begin with # are left out.
/// @error kInvalidArgument: no such file, a line that is none of these (with its number), or no sentence
Result<std::vector<SentenceSpec>> LoadSentences(const std::string& suite);

/// Adds to each of "per_sentence" of an evaluation's report its words that training never says: "never_seen", in order.
/// @param said  what the policy's training says ("words_of": "training"); nothing: that is not known, and they are the
/// words of every sentence for `tasks` on `objects` in any style (language::SeenWords; "words_of": "campaign")
/// @error kInvalidArgument: a task or object without words
Status AddNeverSeen(const std::optional<std::set<std::string>>& said, const std::vector<std::string>& tasks,
                    const std::vector<std::string>& objects, OrderedJson& report);

}  // namespace etude::cli
