// SPDX-License-Identifier: Apache-2.0
// What a sentence of a person asks for: the grammar the other way round, and which of its words training never says.
#pragma once

#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "services/core/config.h"
#include "services/core/result.h"
#include "services/language/grammar.h"

namespace etude::language {

class Vocabulary;

/// A word of a sentence as the policy's encoder gets it.
struct SpokenWord {
  std::string text;
  bool seen = false;  ///< training says it
};

/// What a person means by a sentence; chips that they may change before they say it.
struct Meaning {
  std::string sentence;           ///< normalised
  std::vector<SpokenWord> words;  ///< of it, in order
  /// Nothing where it could not be told; then `why` says what is missing or what it could be.
  std::optional<Command> command;
  std::string why;

  /// "push+others"; "" without a command.
  std::string task() const;
  std::vector<std::string> unseen() const;
};
/// Which of its words a policy's training had, where they are known (a checkpoint's `words`): `seen` takes the place of
/// what the parser's own tasks and objects make.
void MarkSeen(Meaning& meaning, const std::set<std::string>& seen);
/// {"sentence", "words": [{"text", "seen"}], "task", "target", "reference", "why"}; task, target and reference are ""
/// where they are not known.
OrderedJson ToJson(const Meaning& meaning);

/// Of sentences about the objects of one campaign. A verb is found with other words in its middle ("pick the can up"),
/// noun phrases and places as they stand. Immutable after Load; thread-safe.
class MeaningParser {
 public:
  /// @param tasks, objects  that training is about: what it says is what Grammar makes of them (SeenWords)
  /// @error kInvalidArgument: as Grammar::LoadFor, or a task or object without words
  static Result<MeaningParser> Load(const std::vector<std::string>& tasks, const std::vector<std::string>& objects);

  /// @param on_table  objects that may be meant, as scenes name them; none: all that training is about
  Meaning Parse(const std::string& sentence, const std::vector<std::string>& on_table = {}) const;

 private:
  std::shared_ptr<const Vocabulary> vocabulary_;
  std::vector<std::string> objects_;
  std::set<std::string> seen_;
};

}  // namespace etude::language
