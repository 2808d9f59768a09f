// SPDX-License-Identifier: Apache-2.0
// Text -> feature ids for language encoders that are trained along: hashed words, character n-grams and word pairs,
// so that typos and unseen words still land near what was learned (after fastText, Bojanowski et al. 2017).
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "services/language/senses.h"

namespace etude::language {

struct TokenizerConfig {
  int buckets = 8192;  ///< ids are in [0, buckets)
  int min_ngram = 3;   ///< characters, on "<word>"
  int max_ngram = 5;
  int max_words = 32;  ///< longer sentences are cut
};

/// Ids of senses are in [buckets, buckets + kSenseBuckets).
inline constexpr int kSenseBuckets = 8192;

/// One word's features: the word itself, its character n-grams, and the pair with the word before it; then its senses.
using WordFeatures = std::vector<std::int64_t>;

/// Normalises (lower case, punctuation to spaces, collapsed spaces) and hashes. Pure, thread-safe, the
/// same on every machine. An empty sentence gives one word with one feature.
/// @param senses  of one and the same WordNet everywhere; nullptr: words have spellings alone
std::vector<WordFeatures> Tokenize(std::string_view sentence, const TokenizerConfig& config,
                                   const Senses* senses = nullptr);

/// "  Pick UP the Coke-can! " -> "pick up the coke can"
std::string Normalize(std::string_view sentence);

}  // namespace etude::language
