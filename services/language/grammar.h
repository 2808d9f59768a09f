// SPDX-License-Identifier: Apache-2.0
// Sentences for what a robot is to do: the templates of the paper's Tables 9-10 and of the authors' code,
// our own in their manner for the tasks that have none, and variations around them for training.
#pragma once

#include <memory>
#include <set>
#include <string>
#include <vector>

#include "services/core/result.h"
#include "services/core/rng.h"
#include "services/spec/task_name.h"

namespace etude::language {

/// What a sentence talks about. Objects are named as scenes name them: "coke", "basketball", "apple_03".
struct Command {
  std::string task;         ///< "pick"
  std::string target;       ///< object A: the one to move
  std::string reference{};  ///< object B of a relation ("place_left"); "" with the other tasks
  std::string obstacle{};   ///< object to keep off, or kEverythingElse; "" when there is none
};

inline constexpr const char* kEverythingElse = "others";

Command CommandFor(const TaskName& task, const std::string& target, const std::string& reference);

enum class Style {
  kTemplate,  ///< exactly the template sentences ("pick up red can"); 232 for the three basic tasks
  kVaried,    ///< + words by WordNet's rule (wordnet.h), articles, politeness, word order
  kNoisy,     ///< + typing errors, case, punctuation
};

/// An object of the user's own, and what it is called.
struct OwnObject {
  std::string name;                  ///< "rubber_duck"
  std::vector<std::string> phrases;  ///< {"duck", "yellow duck"}; none: the name's words
};

class Vocabulary;

/// Sentence generator. A sentence means one command only as long as no two objects of the scene are of one
/// class. Immutable after Load; const methods are thread-safe.
class Grammar {
 public:
  /// The built-in templates and, when WordNet's database (package wordnet-base) is found, its synonyms;
  /// held-out language (held_out.h) is never generated.
  /// @error kInvalidArgument: an object of `own` has a phrase that means another object, or is held out; two of `tasks`
  /// have a sentence in common; kNotFound: no task files
  /// @param tasks  as a campaign names them: the words of a user's own are in their files
  static Result<Grammar> Load(const std::vector<OwnObject>& own = {}, const std::vector<std::string>& tasks = {});
  /// Load, with every one of a scene's `objects` that has no built-in words called by its name: "rubber duck".
  static Result<Grammar> LoadFor(const std::vector<std::string>& objects, const std::vector<std::string>& tasks = {});

  /// One sentence for `command`, which Check accepts, drawn with `rng`.
  /// @param masked  which share (0..1) of the noun phrases of kVaried and kNoisy have a word of random letters in place
  /// of an adjective or a noun, where the other one tells the object from all the `objects` of LoadFor ("xqv cube")
  std::string Sample(const Command& command, Style style, Rng& rng, double masked = 0) const;
  /// All template sentences of `command`, which Check accepts.
  std::vector<std::string> Templates(const Command& command) const;

  /// @error kInvalidArgument: a task or an object without words (names the nearest), a relation without
  /// reference or the other way round, two of the objects of one class.
  Status Check(const Command& command) const;
  /// Every word that a sentence for `command`, which Check accepts, may hold in any style; not those that a
  /// typing error of kNoisy makes.
  std::set<std::string> Words(const Command& command) const;
  /// Every noun phrase that may stand for `object`, without article; empty when it has no words.
  std::vector<std::string> NounPhrases(const std::string& object) const;

  const std::vector<std::string>& tasks() const;
  /// Objects and classes: "apple" stands for "apple_00", "apple_01", ...
  const std::vector<std::string>& objects() const;

 private:
  std::shared_ptr<const Vocabulary> vocabulary_;
};

}  // namespace etude::language
