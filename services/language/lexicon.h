// SPDX-License-Identifier: Apache-2.0
// The words of the tabletop domain: the original's templates and where their synonyms come from.
#pragma once

#include <string>
#include <vector>

#include "services/language/wordnet.h"

namespace etude::language {

/// adjective x noun; "" stands for no word.
struct NounTemplate {
  std::vector<std::string> adjectives;
  std::vector<std::string> nouns;
};

struct ObjectWords {
  std::string object;
  NounTemplate base;                         ///< the paper's Table 9
  std::vector<std::string> more_adjectives;  ///< ours, beside WordNet's
  std::vector<std::string> more_nouns;
  std::vector<SynsetRef> adjective_synsets;
  std::vector<SynsetRef> noun_synsets;
};

struct TaskWords {
  std::string task;
  std::vector<std::string> base;  ///< the paper's Table 10 (and "hold" of the authors' code)
  std::vector<std::string> more;
  std::vector<SynsetRef> synsets;
};

const std::vector<ObjectWords>& ObjectLexicon();
const std::vector<TaskWords>& TaskLexicon();

/// A sentence and what it asks for.
struct HeldOutSentence {
  std::string text;
  std::string task, object;
};

/// Noun phrases of the paper's Table 8 and sentences of Table 11, normalised: kept out of training so that
/// they can be used as tests of unseen language.
const std::vector<std::string>& HeldOutNounPhrases();
const std::vector<HeldOutSentence>& HeldOutSentences();

}  // namespace etude::language
