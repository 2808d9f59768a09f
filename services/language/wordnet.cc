// SPDX-License-Identifier: Apache-2.0
#include "services/language/wordnet.h"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <sstream>

#include "services/language/tokenizer.h"

namespace etude::language {
namespace {

const char* Suffix(Part part) { return part == Part::kNoun ? "noun" : part == Part::kVerb ? "verb" : "adj"; }

Path FileOf(const Path& folder, const char* kind, Part part) { return folder / (std::string(kind) + Suffix(part)); }

std::string Entry(const std::string& words) {
  std::string entry = words;
  std::replace(entry.begin(), entry.end(), ' ', '_');
  return entry;
}

// The line of a sorted index file that begins with `entry`, or "": bisection over byte offsets.
std::string FindLine(std::ifstream& file, const std::string& entry) {
  file.seekg(0, std::ios::end);
  std::streamoff low = 0, high = file.tellg();
  std::string line;
  while (low < high) {
    const std::streamoff middle = low + (high - low) / 2;
    file.clear();
    file.seekg(std::max<std::streamoff>(middle - 1, 0));
    if (middle > 0) std::getline(file, line);  // what is left of a line that began before
    const std::streamoff start = file.tellg();
    if (start < 0 || start >= high || !std::getline(file, line)) {
      high = middle;
      continue;
    }
    const int order = line.substr(0, line.find(' ')).compare(entry);
    if (order == 0) return line;
    if (order < 0)
      low = start + static_cast<std::streamoff>(line.size()) + 1;
    else
      high = middle;
  }
  return "";
}

// lemma pos synset_cnt p_cnt [ptr_symbol ...] sense_cnt tagsense_cnt synset_offset [synset_offset ...]
std::vector<long> SenseOffsets(const Path& index, const std::string& words, int count) {
  std::ifstream file(index);
  std::istringstream fields(FindLine(file, Entry(words)));
  std::string lemma, part, symbol;
  int senses = 0, symbols = 0, tagged = 0;
  fields >> lemma >> part >> senses >> symbols;
  for (int i = 0; i < symbols && fields; ++i) fields >> symbol;
  fields >> senses >> tagged;
  std::vector<long> offsets;
  for (long offset = 0; static_cast<int>(offsets.size()) < count && fields >> offset;) offsets.push_back(offset);
  return offsets;
}

struct Synset {
  std::vector<std::string> lemmas;
  std::vector<long> near;  ///< offsets of its kinds and of what it is a kind of, of the same part of speech
};

// synset_offset lex_filenum ss_type w_cnt(hex) word lex_id [word lex_id ...]
// p_cnt [pointer_symbol synset_offset pos source/target ...] ... | gloss
Synset ReadSynset(std::ifstream& data, long offset) {
  std::string line, field, type, word, lex_id;
  data.clear();
  data.seekg(offset);
  std::getline(data, line);
  std::istringstream fields(line);
  Synset synset;
  fields >> field;
  if (field != fmt::format("{:08}", offset)) return synset;  // another version's file
  fields >> field >> type >> field;
  for (long left = std::strtol(field.c_str(), nullptr, 16); left > 0 && fields >> word >> lex_id; --left)
    synset.lemmas.push_back(word.substr(0, word.find('(')));  // "ablaze(p)": where it may stand
  int pointers = 0;
  fields >> pointers;
  std::string symbol, part, between;
  for (long other = 0; pointers > 0 && fields >> symbol >> other >> part >> between; --pointers)
    if ((symbol == "@" || symbol == "~") && part == type) synset.near.push_back(other);
  return synset;
}

bool IsName(const std::string& lemma) {
  return std::any_of(lemma.begin(), lemma.end(), [](unsigned char c) { return c >= 'A' && c <= 'Z'; });
}

}  // namespace

Result<WordNet> WordNet::Open(const Path& folder) {
  for (const Part part : {Part::kNoun, Part::kVerb, Part::kAdjective})
    for (const char* kind : {"index.", "data."})
      if (const Path path = FileOf(folder, kind, part); !std::ifstream(path))
        return Fail(Code::kNotFound, fmt::format("open WordNet's '{}' (install wordnet-base)", path.string()));
  return WordNet(folder);
}

bool WordNet::Has(const std::string& words, Part part) const {
  return !SenseOffsets(FileOf(folder_, "index.", part), words, 1).empty();
}

std::vector<std::string> WordNet::Synonyms(const std::string& words, Part part) const { return Within(words, part, 0); }

std::vector<std::string> WordNet::Related(const std::string& words, Part part) const {
  return Within(words, part, DepthOf(part));
}

std::vector<std::string> WordNet::Within(const std::string& words, Part part, int steps) const {
  std::ifstream data(FileOf(folder_, "data.", part));
  std::vector<std::string> texts;
  const auto add = [&](const std::string& lemma) {
    if (IsName(lemma)) return;
    std::string text = Normalize(lemma);
    const bool known = text == words || std::find(texts.begin(), texts.end(), text) != texts.end();
    if (!known) texts.push_back(std::move(text));
  };
  std::vector<long> offsets = SenseOffsets(FileOf(folder_, "index.", part), words, kSenses);
  for (; !offsets.empty() && steps >= 0; --steps) {
    std::vector<long> next;
    for (const long offset : offsets) {
      const Synset synset = ReadSynset(data, offset);
      std::for_each(synset.lemmas.begin(), synset.lemmas.end(), add);
      next.insert(next.end(), synset.near.begin(), synset.near.end());
    }
    offsets = std::move(next);
  }
  return texts;
}

}  // namespace etude::language
