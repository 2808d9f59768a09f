// SPDX-License-Identifier: Apache-2.0
// What else a word is called, from WordNet 3.0's database files (Debian package wordnet-base), by one fixed rule.
// Source of the format: wndb(5WN).
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "services/core/file.h"

namespace etude::language {

/// Where wordnet-base installs its files.
inline constexpr const char* kWordNetFolder = "/usr/share/wordnet";

enum class Part { kNoun, kVerb, kAdjective };

/// How many senses of a word count, the most frequent first, of every part of speech alike. Nobody chose senses or
/// words.
inline constexpr int kSenses = 2;
/// Steps to kinds (hyponyms) and to what it is a kind of (hypernyms): of nouns one. Verbs have none: what WordNet has
/// under "move" is every way to move, and those of "raise" among them mean another task. Adjectives have no kinds.
constexpr int DepthOf(Part part) { return part == Part::kNoun ? 1 : 0; }

/// Steps from a sense to what it is a kind of, where words are compared by what they mean (Senses).
constexpr int StepsUpOf(Part part) { return part == Part::kNoun ? 3 : part == Part::kVerb ? 1 : 0; }

/// The rule: the lemmas of the word's first kSenses senses and of the synsets within DepthOf(part) steps of them, but
/// for names, which WordNet writes with capital letters. Copies share what they read. Const methods are thread-safe.
class WordNet {
 public:
  /// @error kNotFound: `folder` has no database; kUnavailable: it cannot be read
  static Result<WordNet> Open(const Path& folder = kWordNetFolder);

  /// Whether `words` ("pick up") is an entry.
  bool Has(const std::string& words, Part part) const;
  /// What means the same as `words` (depth 0), normalised, in WordNet's order, without `words` itself; none when it is
  /// no entry.
  std::vector<std::string> Synonyms(const std::string& words, Part part) const;
  /// All that the rule makes of `words`: Synonyms, then what is a step away.
  std::vector<std::string> Related(const std::string& words, Part part) const;
  /// Names of the synsets of the first kSenses senses of `words` as a noun, a verb and an adjective, of what those
  /// are kinds of, StepsUpOf(part) steps up, and of the nouns that an adjective comes from ("rectangular"): what "naan"
  /// and "bread" have in common. Of "loafs" those of "loaf"
  /// (morphy(7WN)'s endings, not its exceptions). None of what is no entry.
  std::vector<std::string> Senses(const std::string& words) const;

  /// Of all that is read: of the six files' hashes one behind the other.
  std::string sha256() const;

 private:
  struct Files;
  explicit WordNet(std::shared_ptr<const Files> files) : files_(std::move(files)) {}
  std::string BaseForm(const std::string& words, Part part) const;
  std::vector<std::string> Within(const std::string& words, Part part, int steps) const;
  std::shared_ptr<const Files> files_;
};

}  // namespace etude::language
