// SPDX-License-Identifier: Apache-2.0
// Base words: what the paper's Tables 9-10 and the authors' code say, and words of ours in their manner for what
// they have no words for. Everything else that training says comes from them by WordNet's rule (wordnet.h) and
// from function words (sentence.cc); no synonym is written down here.
#pragma once

#include <string>
#include <vector>

namespace etude::language {

/// adjective x noun; "" stands for no word.
struct NounTemplate {
  std::vector<std::string> adjectives;
  std::vector<std::string> nouns;
};

/// How an object, or each instance of a class, is called. Nobody else's phrases are among an object's.
struct ObjectWords {
  std::string object;
  NounTemplate base;
};

/// How a sentence says what the arm must keep off; ours.
struct ObstacleWords {
  std::vector<std::string> before, after;  ///< "avoid B and ...", "... without touching B"
  std::string avoid, touch;                ///< verbs, whose synonyms are said, too: "and avoid B", "but do not touch B"
  std::vector<std::string> others;         ///< B, when it is everything else
  std::vector<std::string> any_other;      ///< the same after "without" and "not"
};

const std::vector<ObjectWords>& ObjectLexicon();  ///< the six and the basketball
const std::vector<ObjectWords>& ClassLexicon();   ///< the ten classes of generated objects
const ObstacleWords& ObstacleLexicon();

}  // namespace etude::language
