// SPDX-License-Identifier: Apache-2.0
// Synonyms from WordNet 3.0's database files (Debian package wordnet-base), by one fixed rule.
// Source of the format: wndb(5WN).
#pragma once

#include <string>
#include <vector>

#include "services/core/file.h"

namespace etude::language {

/// Where wordnet-base installs its files.
inline constexpr const char* kWordNetFolder = "/usr/share/wordnet";

enum class Part { kNoun, kVerb, kAdjective };

/// How many senses of a word count, the most frequent first: WordNet's average polysemy, rounded (wnstats(7WN):
/// verbs 2.17, nouns 1.24, adjectives 1.40). Nobody chose senses or words.
constexpr int SensesOf(Part part) { return part == Part::kVerb ? 2 : 1; }

/// The rule: the lemmas of the word's first SensesOf(part) senses (depth 0: of these synsets, none related to
/// them), but for names, which WordNet writes with capital letters. Const methods are thread-safe.
class WordNet {
 public:
  /// @error kNotFound: `folder` has no database
  static Result<WordNet> Open(const Path& folder = kWordNetFolder);

  /// Whether `words` ("pick up") is an entry.
  bool Has(const std::string& words, Part part) const;
  /// What one may say instead of `words`, normalised, in WordNet's order, without `words` itself; none when it is
  /// no entry.
  std::vector<std::string> Synonyms(const std::string& words, Part part) const;

 private:
  explicit WordNet(Path folder) : folder_(std::move(folder)) {}
  Path folder_;
};

}  // namespace etude::language
