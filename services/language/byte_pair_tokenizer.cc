// SPDX-License-Identifier: Apache-2.0
#include "services/language/byte_pair_tokenizer.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

#include "services/core/config.h"
#include "services/language/unicode.h"

namespace etude::language {
namespace {

constexpr char kStart[] = "<|startoftext|>", kEnd[] = "<|endoftext|>", kWordEnd[] = "</w>";
constexpr std::string_view kEndings[] = {"'s", "'t", "'re", "'ve", "'m", "'ll", "'d"};
constexpr std::int64_t kMostIds = 1 << 24;

std::string LowerCase(std::string_view text) {
  std::string lower;
  lower.reserve(text.size());
  while (!text.empty()) {
    const Character first = FirstCharacter(text);
    if (first.code == kNoCodePoint)
      lower += text.substr(0, first.size);
    else
      AppendUtf8(ToLower(first.code), lower);
    text.remove_prefix(first.size);
  }
  return lower;
}

// bytes of the word that `text` begins with, which is no space
std::size_t WordSize(std::string_view text) {
  for (const std::string_view ending : kEndings)
    if (text.starts_with(ending)) return ending.size();
  const Character first = FirstCharacter(text);
  const CharacterKind kind = KindOf(first.code);
  std::size_t size = first.size;
  while (kind != CharacterKind::kNumber && size < text.size()) {
    const Character next = FirstCharacter(text.substr(size));
    if (KindOf(next.code) != kind) break;
    size += next.size;
  }
  return size;
}

tl::unexpected<Error> Corrupt(std::string message) { return Fail(Code::kCorrupt, std::move(message)); }

}  // namespace

// bytes that print stand for themselves in Latin-1, the others for characters from U+0100 on, in their order
BytePairTokenizer::BytePairTokenizer() {
  char32_t next = 0x100;
  for (std::size_t byte = 0; byte < bytes_.size(); ++byte) {
    const bool prints = (byte > 0x20 && byte < 0x7F) || (byte > 0xA0 && byte < 0xAD) || byte > 0xAD;
    AppendUtf8(prints ? static_cast<char32_t>(byte) : next++, bytes_[byte]);
  }
}

Result<BytePairTokenizer> BytePairTokenizer::Parse(std::string_view vocabulary, std::string_view merges) {
  BytePairTokenizer tokenizer;
  ETUDE_RETURN_IF_ERROR(tokenizer.ReadVocabulary(vocabulary));
  ETUDE_RETURN_IF_ERROR(tokenizer.ReadMerges(merges));
  return tokenizer;
}

Status BytePairTokenizer::ReadVocabulary(std::string_view text) {
  // OrderedJson would search the whole map for each of its 49408 keys
  const Json json = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object()) return Corrupt("vocab.json is not a JSON map");
  for (const auto& [symbol, id] : json.items()) {
    if (!id.is_number_unsigned() || id.get<std::uint64_t>() >= kMostIds)
      return Corrupt(fmt::format("vocab.json: '{:.100}' has no id in [0, {})", symbol, kMostIds));
    ids_[symbol] = id.get<std::int64_t>();
    largest_ = std::max(largest_, ids_[symbol]);
  }
  ETUDE_ASSIGN_OR_RETURN(start_, IdOf(kStart));
  ETUDE_ASSIGN_OR_RETURN(end_, IdOf(kEnd));
  return {};
}

Result<std::int64_t> BytePairTokenizer::IdOf(const std::string& symbol) const {
  const auto found = ids_.find(symbol);
  if (found == ids_.end()) return Corrupt(fmt::format("vocab.json has no '{:.100}'", symbol));
  return found->second;
}

Status BytePairTokenizer::ReadMerges(std::string_view text) {
  if (!text.starts_with("#version")) return Corrupt("merges.txt does not begin with a line '#version'");
  for (int number = 1; !text.empty(); ++number) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    std::string_view line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    if (line.ends_with('\r')) line.remove_suffix(1);
    if (number > 1 && !line.empty()) ETUDE_RETURN_IF_ERROR(AddMerge(line, number));
  }
  return {};
}

Status BytePairTokenizer::AddMerge(std::string_view line, int number) {
  const std::size_t space = line.find(' ');
  const bool two = space != std::string_view::npos && space > 0 && space + 1 < line.size() &&
                   line.find(' ', space + 1) == std::string_view::npos;
  if (!two) return Corrupt(fmt::format("merges.txt:{}: '{:.100}' is not two symbols", number, line));
  const std::string both = fmt::format("{}{}", line.substr(0, space), line.substr(space + 1));
  if (!ids_.contains(both))
    return Corrupt(fmt::format("merges.txt:{}: '{:.100}' makes '{:.100}', which vocab.json lacks", number, line, both));
  ranks_.emplace(line, ranks_.size());  // one that stands twice keeps its first place
  return {};
}

std::vector<std::string> BytePairTokenizer::SymbolsOf(std::string_view word) const {
  std::vector<std::string> symbols;
  for (const unsigned char byte : word) symbols.push_back(bytes_[byte]);
  symbols.back() += kWordEnd;
  while (symbols.size() > 1) {
    // of the pairs that stand here, the one that was learned first
    std::size_t best = std::numeric_limits<std::size_t>::max(), at = 0;
    for (std::size_t i = 0; i + 1 < symbols.size(); ++i) {
      const auto found = ranks_.find(symbols[i] + " " + symbols[i + 1]);
      if (found == ranks_.end() || found->second >= best) continue;
      best = found->second;
      at = i;
    }
    if (best == std::numeric_limits<std::size_t>::max()) break;
    // wherever it stands
    const std::string first = symbols[at], second = symbols[at + 1];
    std::vector<std::string> merged;
    for (std::size_t i = 0; i < symbols.size(); ++i) {
      const bool pair = i + 1 < symbols.size() && symbols[i] == first && symbols[i + 1] == second;
      merged.push_back(pair ? first + second : symbols[i]);
      if (pair) ++i;
    }
    symbols = std::move(merged);
  }
  return symbols;
}

std::vector<std::int64_t> BytePairTokenizer::Encode(std::string_view sentence) const {
  const std::string text = LowerCase(sentence);
  std::vector<std::int64_t> ids{start_};
  for (std::string_view rest = text; !rest.empty();) {
    const Character first = FirstCharacter(rest);
    if (KindOf(first.code) == CharacterKind::kSpace) {
      rest.remove_prefix(first.size);
      continue;
    }
    const std::string_view word = rest.substr(0, WordSize(rest));
    rest.remove_prefix(word.size());
    for (const std::string& symbol : SymbolsOf(word)) {
      const auto found = ids_.find(symbol);
      ids.push_back(found == ids_.end() ? end_ : found->second);
    }
  }
  ids.push_back(end_);
  return ids;
}

}  // namespace etude::language
