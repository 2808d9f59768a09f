// SPDX-License-Identifier: Apache-2.0
// The words of the tabletop domain: templates, and where their synonyms come from.
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

/// How an object, or each instance of a class, is called. Nobody else's phrases are among an object's.
struct ObjectWords {
  std::string object;
  NounTemplate base;    ///< templates: the paper's Table 9, or the authors' code for the ten classes
  NounTemplate varied;  ///< what else one may say; synonyms join it
  std::vector<SynsetRef> adjective_synsets;
  std::vector<SynsetRef> noun_synsets;
};

/// The verbs of a task. No verb of another task is among them.
struct TaskWords {
  std::string task;
  std::vector<std::string> base;  ///< the paper's Table 10 (and "hold" of the authors' code)
  std::vector<std::string> more;
  std::vector<SynsetRef> synsets;
};

/// Where A goes, seen from B: "to the left of".
struct RelationWords {
  std::string task;
  std::vector<std::string> base;
  std::vector<std::string> more;
};

/// How a sentence says what the arm must keep off.
struct ObstacleWords {
  std::vector<std::string> base_before, base_after;  ///< "avoid B and ...", "... without touching B"
  std::vector<std::string> before, after;            ///< of varied sentences, beside those
  std::vector<std::string> others;                   ///< B, when it is everything else
  std::vector<std::string> any_other;                ///< the same after "without" and "not"
  std::vector<SynsetRef> avoid_synsets, touch_synsets;
};

const std::vector<ObjectWords>& ObjectLexicon();  ///< the six and the basketball
const std::vector<ObjectWords>& ClassLexicon();   ///< the ten classes of generated objects
const std::vector<TaskWords>& TaskLexicon();      ///< tasks without a second object
const TaskWords& PlacingLexicon();                ///< verbs of all relations
const std::vector<RelationWords>& RelationLexicon();
const ObstacleWords& ObstacleLexicon();

/// Lemmas of the synsets above that nobody says at a table, or that mean something else here.
const std::vector<std::string>& UnusedLemmas();

}  // namespace etude::language
