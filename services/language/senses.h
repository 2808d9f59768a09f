// SPDX-License-Identifier: Apache-2.0
// What words mean, for encoders that shall understand words which no training sentence says: "naan" is bread.
#pragma once

#include <memory>
#include <string>
#include <unordered_map>
#include <vector>

#include "services/core/file.h"
#include "services/core/thread_annotations.h"
#include "services/language/wordnet.h"

namespace etude::language {

/// WordNet's senses of words in sentences, remembered. Thread-safe.
class Senses {
 public:
  using Names = std::shared_ptr<const std::vector<std::string>>;

  /// Who opens a folder that is open already gets the same.
  /// @param sha256  of the WordNet that is wanted (WordNet::sha256); "": any
  /// @error kNotFound, kUnavailable as WordNet::Open; kInvalidArgument: another one is installed
  static Result<std::shared_ptr<const Senses>> Open(const std::string& sha256 = "",
                                                    const Path& folder = kWordNetFolder);

  const std::string& sha256() const { return sha256_; }
  /// Names of the synsets that `word` may mean (WordNet::Senses), and those of the two words where they are one entry
  /// ("soft drink"). @param previous  the word before it, "" at a sentence's begin
  Names Of(const std::string& previous, const std::string& word) const ETUDE_EXCLUDES(mutex_);

 private:
  static constexpr std::size_t kRemembered = 32768;  ///< pairs of words, then all are forgotten

  Senses(WordNet wordnet, std::string sha256) : wordnet_(std::move(wordnet)), sha256_(std::move(sha256)) {}

  const WordNet wordnet_;
  const std::string sha256_;
  mutable Mutex mutex_;
  mutable std::unordered_map<std::string, Names> remembered_ ETUDE_GUARDED_BY(mutex_);
};

}  // namespace etude::language
