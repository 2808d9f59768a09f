// SPDX-License-Identifier: Apache-2.0
// Private to services/language: the lexicon with its synonyms looked up.
#pragma once

#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "services/core/result.h"
#include "services/language/grammar.h"
#include "services/language/lexicon.h"
#include "services/language/wordnet.h"
#include "services/spec/task_name.h"

namespace etude::language {

/// "a" + "b" -> "a b"; either may be empty.
std::string JoinWords(const std::string& a, const std::string& b);
/// Words of a text between spaces.
std::vector<std::string> SplitWords(const std::string& text);
/// Does `phrase` stand in `text`, between word boundaries? Both normalised.
bool HasWords(const std::string& text, const std::string& phrase);

/// Immutable after Load.
class Vocabulary {
 public:
  struct Noun {
    NounTemplate base;
    /// What WordNet's rule makes of each base word; a phrase has at most one of these.
    std::map<std::string, std::vector<std::string>> adjectives, nouns;
    /// All that is said. A phrase of base words belongs to its object alone; one that the rule makes of two objects is
    /// said of neither, and what is held out of none.
    std::set<std::string> phrases;
    /// Those of its adjectives and nouns that tell it from the others of a training, whatever stands beside them.
    std::set<std::string> telling;
  };
  struct Words {
    std::vector<std::string> base, all;  ///< all: with base and synonyms
  };

  static Result<Vocabulary> Load(const std::vector<OwnObject>& own, const std::vector<std::string>& tasks);
  /// Of a training about `objects`: every one of them that has no built-in words is called by its name, and what tells
  /// one tells it from the others of them (of Load: from all there are).
  static Result<Vocabulary> LoadFor(const std::vector<std::string>& objects, const std::vector<std::string>& tasks);

  const Noun* FindNoun(const std::string& object) const;  ///< of the object or of its class; or nullptr
  const Words& verb(const std::string& task) const { return verbs_.at(task); }
  const Words& place(const std::string& task) const { return places_.at(task); }  ///< of a relation
  bool needs_reference(const std::string& task) const { return places_.contains(task); }
  const std::vector<std::string>& avoid() const { return avoid_; }  ///< "avoid", "ward off"
  const std::vector<std::string>& touch() const { return touch_; }
  /// Whether a noun phrase, without article, is held out.
  static bool IsHeldOutPhrase(const std::string& phrase);
  /// Whether held-out language stands anywhere in the sentence (normalised).
  static bool HasHeldOut(const std::string& sentence);

  const std::vector<std::string>& tasks() const { return tasks_; }
  const std::vector<std::string>& objects() const { return objects_; }

 private:
  void AddObject(const ObjectWords& words);
  Status AddOwn(const OwnObject& object);
  void AddTasks(const std::vector<TaskName>& tasks);
  void ChoosePhrases();
  void ChooseTelling(const std::vector<std::string>& objects);
  std::vector<std::string> Expand(const std::string& phrase, Part part) const;
  std::vector<std::string> ExpandAll(const std::vector<std::string>& phrases, Part part) const;

  std::optional<WordNet> wordnet_;  // none when it is not installed
  std::vector<std::string> tasks_, objects_;
  std::map<std::string, Noun> nouns_;
  std::map<std::string, Words> verbs_, places_;
  std::vector<std::string> avoid_, touch_;
};

/// Of base words alone.
std::vector<std::string> BasePhrases(const NounTemplate& base);
/// Every phrase that base words and the rule make, whether it is said or not.
std::set<std::string> AllPhrases(const Vocabulary::Noun& noun);

}  // namespace etude::language
