// SPDX-License-Identifier: Apache-2.0
#include "services/language/wordnet.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/mman.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <sstream>
#include <string_view>
#include <utility>

#include "services/core/descriptor.h"
#include "services/core/hash.h"
#include "services/language/tokenizer.h"

namespace etude::language {
namespace {

constexpr std::array<Part, 3> kParts{Part::kNoun, Part::kVerb, Part::kAdjective};

const char* Suffix(Part part) { return part == Part::kNoun ? "noun" : part == Part::kVerb ? "verb" : "adj"; }

Path FileOf(const Path& folder, const char* kind, Part part) { return folder / (std::string(kind) + Suffix(part)); }

std::string Entry(const std::string& words) {
  std::string entry = words;
  std::replace(entry.begin(), entry.end(), ' ', '_');
  return entry;
}

// A file's bytes, of which the system keeps one copy for all processes.
class Mapping {
 public:
  static Result<Mapping> Of(const Path& path) {
    const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
    struct stat facts {};
    if (!file || ::fstat(file.get(), &facts) != 0) return Fail(ErrnoError("open", path, errno));
    Mapping mapping;
    mapping.size_ = static_cast<std::size_t>(facts.st_size);
    if (mapping.size_ == 0) return mapping;
    void* const bytes = ::mmap(nullptr, mapping.size_, PROT_READ, MAP_PRIVATE, file.get(), 0);
    if (bytes == MAP_FAILED) return Fail(ErrnoError("map", path, errno));
    mapping.bytes_ = static_cast<const char*>(bytes);
    return mapping;
  }
  Mapping() = default;
  Mapping(Mapping&& other) noexcept { *this = std::move(other); }
  Mapping& operator=(Mapping&& other) noexcept {
    std::swap(bytes_, other.bytes_);
    std::swap(size_, other.size_);
    return *this;
  }
  ~Mapping() {
    if (bytes_) ::munmap(const_cast<char*>(bytes_), size_);
  }
  std::string_view text() const { return {bytes_, bytes_ ? size_ : 0}; }

 private:
  const char* bytes_ = nullptr;
  std::size_t size_ = 0;
};

std::string_view LineAt(std::string_view file, std::size_t start) {
  return file.substr(start, file.find('\n', start) - start);
}

// The line of a sorted index file that begins with `entry`, or "": bisection over byte offsets.
std::string_view FindLine(std::string_view file, std::string_view entry) {
  if (entry.empty()) return "";  // not the licence, whose lines begin with spaces
  std::size_t low = 0, high = file.size();
  while (low < high) {
    const std::size_t middle = low + (high - low) / 2;
    const std::size_t newline = middle == 0 ? file.npos : file.rfind('\n', middle - 1);
    const std::size_t start = newline == file.npos ? 0 : newline + 1;
    const std::string_view line = LineAt(file, start);
    const int order = line.substr(0, line.find(' ')).compare(entry);
    if (order == 0) return line;
    if (order < 0)
      low = start + line.size() + 1;
    else
      high = start;
  }
  return "";
}

// lemma pos synset_cnt p_cnt [ptr_symbol ...] sense_cnt tagsense_cnt synset_offset [synset_offset ...]
std::vector<std::size_t> SenseOffsets(std::string_view index, const std::string& words, int count) {
  std::istringstream fields{std::string(FindLine(index, Entry(words)))};
  std::string lemma, part, symbol;
  int senses = 0, symbols = 0, tagged = 0;
  fields >> lemma >> part >> senses >> symbols;
  for (int i = 0; i < symbols && fields; ++i) fields >> symbol;
  fields >> senses >> tagged;
  std::vector<std::size_t> offsets;
  for (std::size_t offset = 0; static_cast<int>(offsets.size()) < count && fields >> offset;) offsets.push_back(offset);
  return offsets;
}

struct Synset {
  std::vector<std::string> lemmas;
  // offsets of synsets of the same part of speech
  std::vector<std::size_t> near;   ///< its kinds and what it is a kind of
  std::vector<std::size_t> above;  ///< what it is a kind or an instance of
  std::vector<std::size_t> nouns;  ///< of what is no noun: those that it is made of ("rectangular": rectangle)
};

// synset_offset lex_filenum ss_type w_cnt(hex) word lex_id [word lex_id ...]
// p_cnt [pointer_symbol synset_offset pos source/target ...] ... | gloss
Synset ReadSynset(std::string_view data, std::size_t offset) {
  Synset synset;
  if (offset >= data.size()) return synset;
  const std::string_view line = LineAt(data, offset);
  std::istringstream fields{std::string(line.substr(0, line.find('|')))};
  std::string field, type, word, lex_id;
  fields >> field;
  if (field != fmt::format("{:08}", offset)) return synset;  // another version's file
  fields >> field >> type >> field;
  for (long left = std::strtol(field.c_str(), nullptr, 16); left > 0 && fields >> word >> lex_id; --left)
    synset.lemmas.push_back(word.substr(0, word.find('(')));  // "ablaze(p)": where it may stand
  int pointers = 0;
  fields >> pointers;
  std::string symbol, part, between;
  for (std::size_t other = 0; pointers > 0 && fields >> symbol >> other >> part >> between; --pointers) {
    if (part == "n" && type != "n" && (symbol == "+" || symbol == "\\")) synset.nouns.push_back(other);
    if (part != type) continue;
    if (symbol == "@" || symbol == "~") synset.near.push_back(other);
    if (symbol == "@" || symbol == "@i") synset.above.push_back(other);
  }
  return synset;
}

// The endings of morphy(7WN) and what stands in their place.
using Endings = std::vector<std::pair<std::string_view, std::string_view>>;
const Endings& EndingsOf(Part part) {
  static const Endings of_nouns{{"s", ""},      {"ses", "s"},   {"xes", "x"},   {"zes", "z"},
                                {"ches", "ch"}, {"shes", "sh"}, {"men", "man"}, {"ies", "y"}};
  static const Endings of_verbs{{"s", ""},   {"ies", "y"}, {"es", "e"},  {"es", ""},
                                {"ed", "e"}, {"ed", ""},   {"ing", "e"}, {"ing", ""}};
  static const Endings of_adjectives{{"er", ""}, {"est", ""}, {"er", "e"}, {"est", "e"}};
  return part == Part::kNoun ? of_nouns : part == Part::kVerb ? of_verbs : of_adjectives;
}

bool IsName(const std::string& lemma) {
  return std::any_of(lemma.begin(), lemma.end(), [](unsigned char c) { return c >= 'A' && c <= 'Z'; });
}

}  // namespace

struct WordNet::Files {
  std::array<Mapping, kParts.size()> index, data;  ///< by Part

  std::string_view IndexOf(Part part) const { return index[static_cast<std::size_t>(part)].text(); }
  std::string_view DataOf(Part part) const { return data[static_cast<std::size_t>(part)].text(); }
};

Result<WordNet> WordNet::Open(const Path& folder) {
  auto files = std::make_shared<Files>();
  for (const Part part : kParts)
    for (const auto& [kind, mappings] : {std::pair{"index.", &files->index}, {"data.", &files->data}}) {
      auto mapping = Mapping::Of(FileOf(folder, kind, part));
      if (!mapping)
        return Fail(mapping.error().code, fmt::format("WordNet: {} (install wordnet-base)", mapping.error().message));
      (*mappings)[static_cast<std::size_t>(part)] = std::move(*mapping);
    }
  return WordNet(std::move(files));
}

std::string WordNet::sha256() const {
  Sha256 sum;
  for (const Part part : kParts)
    for (const auto& text : {files_->IndexOf(part), files_->DataOf(part)}) sum.Update(Sha256Hex(text));
  return ToHex(sum.Finish());
}

bool WordNet::Has(const std::string& words, Part part) const {
  return !FindLine(files_->IndexOf(part), Entry(words)).empty();
}

std::vector<std::string> WordNet::Synonyms(const std::string& words, Part part) const { return Within(words, part, 0); }

std::vector<std::string> WordNet::Related(const std::string& words, Part part) const {
  return Within(words, part, DepthOf(part));
}

std::vector<std::string> WordNet::Within(const std::string& words, Part part, int steps) const {
  const std::string_view data = files_->DataOf(part);
  std::vector<std::string> texts;
  const auto add = [&](const std::string& lemma) {
    if (IsName(lemma)) return;
    std::string text = Normalize(lemma);
    const bool known = text == words || std::find(texts.begin(), texts.end(), text) != texts.end();
    if (!known) texts.push_back(std::move(text));
  };
  std::vector<std::size_t> offsets = SenseOffsets(files_->IndexOf(part), words, kSenses);
  for (; !offsets.empty() && steps >= 0; --steps) {
    std::vector<std::size_t> next;
    for (const std::size_t offset : offsets) {
      const Synset synset = ReadSynset(data, offset);
      std::for_each(synset.lemmas.begin(), synset.lemmas.end(), add);
      next.insert(next.end(), synset.near.begin(), synset.near.end());
    }
    offsets = std::move(next);
  }
  return texts;
}

std::string WordNet::BaseForm(const std::string& words, Part part) const {
  if (Has(words, part)) return words;
  for (const auto& [ending, instead] : EndingsOf(part)) {
    if (words.size() <= ending.size() || !words.ends_with(ending)) continue;
    std::string base = words.substr(0, words.size() - ending.size()) + std::string(instead);
    if (Has(base, part)) return base;
  }
  return "";
}

std::vector<std::string> WordNet::Senses(const std::string& words) const {
  std::vector<std::string> names;
  const auto add = [&](const Synset& synset, Part part) {
    if (synset.lemmas.empty()) return;
    std::string name = fmt::format("{}:{}", Suffix(part), fmt::join(synset.lemmas, "/"));
    if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(std::move(name));
  };
  for (const Part part : kParts) {
    const std::string base = BaseForm(words, part);
    if (base.empty()) continue;
    std::vector<std::size_t> offsets = SenseOffsets(files_->IndexOf(part), base, kSenses);
    for (int steps = StepsUpOf(part); !offsets.empty() && steps >= 0; --steps) {
      std::vector<std::size_t> above;
      for (const std::size_t offset : offsets) {
        const Synset synset = ReadSynset(files_->DataOf(part), offset);
        add(synset, part);
        if (part == Part::kAdjective)
          for (const std::size_t noun : synset.nouns) add(ReadSynset(files_->DataOf(Part::kNoun), noun), Part::kNoun);
        above.insert(above.end(), synset.above.begin(), synset.above.end());
      }
      offsets = std::move(above);
    }
  }
  return names;
}

}  // namespace etude::language
