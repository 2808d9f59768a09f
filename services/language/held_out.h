// SPDX-License-Identifier: Apache-2.0
// Language that is kept out of training, so that it can test what a policy makes of unseen words.
#pragma once

#include <set>
#include <string>
#include <vector>

#include "services/core/result.h"
#include "services/language/grammar.h"

namespace etude::language {

/// A sentence and what it asks for.
struct HeldOutSentence {
  std::string text;
  std::string task, object;
};

/// A noun phrase and what it names.
struct HeldOutPhrase {
  std::string text;
  std::string object;
};

/// Noun phrases of the paper's Table 8 and sentences of its Table 11, normalised. Grammar generates none:
/// no noun phrase of a sentence is one of the former, and none of the latter, nor a phrase of more than one
/// word, stands anywhere in a sentence. Their single words are not kept out: what of them training says all the
/// same follows from its base words (lexicon.h) and WordNet's rule, and UnseenWords tells the rest.
const std::vector<HeldOutPhrase>& HeldOutNounPhrases();
const std::vector<HeldOutSentence>& HeldOutSentences();

/// Every word that training on `tasks` and `objects` says, in any style; not those that typing errors make. A relation
/// is said with each object's next one of another class.
/// @error kInvalidArgument: an unknown task, or an object without words in `grammar`
Result<std::set<std::string>> SeenWords(const Grammar& grammar, const std::vector<std::string>& tasks,
                                        const std::vector<std::string>& objects);

/// Every word of what relabelled sentences may say besides (data.clauses of a training): an object, the obstacle or all
/// others to keep off, and relations between the objects, of all tasks that `grammar` knows. @error as SeenWords
Result<std::set<std::string>> ClauseWords(const Grammar& grammar, const std::vector<std::string>& tasks,
                                          const std::vector<std::string>& objects);

/// Words as a text and back, separated by spaces: how checkpoints say which ones training had.
std::string WordsText(const std::set<std::string>& words);
std::set<std::string> WordsIn(const std::string& text);

/// The words of `text` (normalised) that are not among `seen`, in order (Grammar::Words).
std::vector<std::string> UnseenWords(const std::string& text, const std::set<std::string>& seen);

}  // namespace etude::language
