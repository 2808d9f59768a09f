// SPDX-License-Identifier: Apache-2.0
// Language that is kept out of training, so that it can test what a policy makes of unseen words.
#pragma once

#include <string>
#include <vector>

namespace etude::language {

/// A sentence and what it asks for.
struct HeldOutSentence {
  std::string text;
  std::string task, object;
};

/// Noun phrases of the paper's Table 8 and sentences of its Table 11, normalised. Grammar generates none:
/// no noun phrase of a sentence is one of the former, and none of the latter, nor a phrase of more than one
/// word, stands anywhere in a sentence.
const std::vector<std::string>& HeldOutNounPhrases();
const std::vector<HeldOutSentence>& HeldOutSentences();

}  // namespace etude::language
