// SPDX-License-Identifier: Apache-2.0
// Private to services/language: the lexicon with its synonyms looked up.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "services/core/result.h"
#include "services/language/grammar.h"
#include "services/language/lexicon.h"

namespace etude::language {

/// "a" + "b" -> "a b"; either may be empty.
std::string JoinWords(const std::string& a, const std::string& b);
/// Does `phrase` stand in `text`, between word boundaries? Both normalised.
bool HasWords(const std::string& text, const std::string& phrase);

/// Immutable after Load.
class Vocabulary {
 public:
  struct Noun {
    NounTemplate base, varied;
  };
  struct Words {
    std::vector<std::string> base, all;  ///< all: with base and synonyms
  };

  static Result<Vocabulary> Load(const std::vector<OwnObject>& own);

  const Noun* FindNoun(const std::string& object) const;  ///< of the object or of its class; or nullptr
  const Words& verb(const std::string& task) const { return verbs_.at(task); }
  const Words& place(const std::string& task) const { return places_.at(task); }  ///< of a relation
  const std::vector<std::string>& avoid() const { return avoid_; }                ///< "avoid", "shun"
  const std::vector<std::string>& touch() const { return touch_; }                ///< "touch", "disturb"
  /// Whether a noun phrase, without article, is held out.
  static bool IsHeldOutPhrase(const std::string& phrase);
  /// Whether held-out language stands anywhere in the sentence (normalised).
  static bool HasHeldOut(const std::string& sentence);

  const std::vector<std::string>& tasks() const { return tasks_; }
  const std::vector<std::string>& objects() const { return objects_; }

 private:
  void AddObject(const ObjectWords& words);
  Status AddOwn(const OwnObject& object);
  void AddTasks();
  void AddSynonyms(const std::vector<SynsetRef>& synsets, std::vector<std::string>& words);

  std::vector<std::string> tasks_, objects_;
  std::map<std::string, Noun> nouns_;
  std::map<std::string, Words> verbs_, places_;
  std::vector<std::string> avoid_, touch_;
  bool warned_ = false;
};

/// All phrases of a noun that are not held out.
std::vector<std::string> Phrases(const Vocabulary::Noun& noun);

}  // namespace etude::language
