// SPDX-License-Identifier: Apache-2.0
// Sentences for (task, target): the templates of the paper's Tables 9-10 and of the authors' code, and
// variations around them for training.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "services/core/result.h"
#include "services/core/rng.h"

namespace etude::language {

/// What a sentence talks about.
struct Command {
  std::string task;    ///< "pick"
  std::string target;  ///< "coke"
};

enum class Style {
  kTemplate,  ///< exactly the original's 232 template sentences ("pick up red can")
  kVaried,    ///< + synonyms (WordNet), articles, politeness, word order
  kNoisy,     ///< + typing errors, case, punctuation
};

/// Sentence generator. Immutable after Load; const methods are thread-safe.
class Grammar {
 public:
  /// The built-in templates and, when WordNet's database (package wordnet-base) is found, its synonyms;
  /// phrases of the paper's Tables 8 and 11 are never generated.
  static Result<Grammar> Load();

  /// One sentence for `command`, drawn with `rng`.
  std::string Sample(const Command& command, Style style, Rng& rng) const;
  /// All template sentences of `command`.
  std::vector<std::string> Templates(const Command& command) const;

  const std::vector<std::string>& tasks() const { return tasks_; }
  const std::vector<std::string>& objects() const { return objects_; }

 private:
  struct Lexicon;
  std::vector<std::string> tasks_, objects_;
  std::shared_ptr<const Lexicon> lexicon_;
};

}  // namespace etude::language
