// SPDX-License-Identifier: Apache-2.0
#include "services/language/tokenizer.h"

#include <algorithm>

#include "services/core/check.h"

namespace etude::language {
namespace {

// FNV-1a, 64 bit; `salt` keeps words, n-grams and pairs of the same text apart.
std::int64_t Bucket(std::string_view text, unsigned char salt, int buckets) {
  std::uint64_t hash = 0xcbf29ce484222325ULL;
  const auto mix = [&](unsigned char c) {
    hash ^= c;
    hash *= 0x100000001b3ULL;
  };
  mix(salt);
  for (unsigned char c : text) mix(c);
  // FNV's low bits are its best; fold the high ones in for small moduli
  return static_cast<std::int64_t>((hash ^ (hash >> 32)) % static_cast<std::uint64_t>(buckets));
}

}  // namespace

std::string Normalize(std::string_view sentence) {
  std::string text;
  text.reserve(sentence.size());
  for (unsigned char c : sentence) {
    const bool letter = (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c >= 0x80;
    if (c >= 'A' && c <= 'Z') {
      text += static_cast<char>(c - 'A' + 'a');
    } else if (letter) {
      text += static_cast<char>(c);
    } else if (!text.empty() && text.back() != ' ') {
      text += ' ';
    }
  }
  if (!text.empty() && text.back() == ' ') text.pop_back();
  return text;
}

std::vector<WordFeatures> Tokenize(std::string_view sentence, const TokenizerConfig& config, const Senses* senses) {
  ETUDE_CHECK(config.buckets > 0 && config.min_ngram > 0 && config.max_words > 0);
  const std::string text = Normalize(sentence);
  std::vector<WordFeatures> words;
  std::string previous;
  std::size_t begin = 0;
  while (begin < text.size() && static_cast<int>(words.size()) < config.max_words) {
    const std::size_t end = std::min(text.find(' ', begin), text.size());
    const std::string word = text.substr(begin, end - begin);
    begin = end + 1;

    WordFeatures features{Bucket(word, 'w', config.buckets)};
    const std::string framed = "<" + word + ">";
    for (int n = config.min_ngram; n <= config.max_ngram; ++n)
      for (std::size_t i = 0; i + n <= framed.size(); ++i)
        features.push_back(Bucket(std::string_view(framed).substr(i, n), 'n', config.buckets));
    features.push_back(Bucket(previous + " " + word, 'p', config.buckets));
    if (senses) {
      const auto names = senses->Of(previous, word);  // may be nobody else's
      for (const auto& sense : *names) features.push_back(config.buckets + Bucket(sense, 's', kSenseBuckets));
    }
    words.push_back(std::move(features));
    previous = word;
  }
  if (words.empty()) words.push_back({Bucket("", 'w', config.buckets)});
  return words;
}

}  // namespace etude::language
