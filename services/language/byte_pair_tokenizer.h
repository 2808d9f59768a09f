// SPDX-License-Identifier: Apache-2.0
// CLIP's tokeniser: byte pair encoding (Sennrich et al. 2016) over bytes (Radford et al. 2019), with "</w>" at the end
// of each word (Radford et al. 2021), from the two files that Hugging Face keeps it in.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "services/core/result.h"

namespace etude::language {

/// Immutable; const methods are thread-safe.
class BytePairTokenizer {
 public:
  /// @param vocabulary  text of vocab.json: a map of symbols to ids, "<|startoftext|>" and "<|endoftext|>" among them
  /// @param merges      text of merges.txt: a line that begins with #version, then two symbols a line, which are put
  ///                    together, those that are first
  /// @error kCorrupt: what is wrong, by symbol or line
  static Result<BytePairTokenizer> Parse(std::string_view vocabulary, std::string_view merges);

  /// The start token, those of the lower-case sentence, the end token. Words are runs of letters, single digits, runs
  /// of anything else but spaces, and the English endings 's 't 're 've 'm 'll 'd; the names of start and end token are
  /// text like any other. A symbol that the vocabulary lacks becomes the end token, as CLIP's own files have it.
  /// Cost: of a word the square of its length.
  std::vector<std::int64_t> Encode(std::string_view sentence) const;

  std::int64_t end_token() const { return end_; }
  std::int64_t largest_id() const { return largest_; }

 private:
  BytePairTokenizer();
  Status ReadVocabulary(std::string_view text);
  Status ReadMerges(std::string_view text);
  Status AddMerge(std::string_view line, int number);
  Result<std::int64_t> IdOf(const std::string& symbol) const;
  std::vector<std::string> SymbolsOf(std::string_view word) const;

  std::array<std::string, 256> bytes_;                  ///< each byte as a printable character
  std::unordered_map<std::string, std::int64_t> ids_;   ///< by symbol
  std::unordered_map<std::string, std::size_t> ranks_;  ///< by "FIRST SECOND"; low ones were learned first
  std::int64_t start_ = 0, end_ = 0, largest_ = 0;
};

}  // namespace etude::language
