// SPDX-License-Identifier: Apache-2.0
#include "services/language/wordnet.h"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <sstream>

#include "services/language/tokenizer.h"

namespace etude::language {

Result<std::vector<std::string>> SynsetLemmas(const Path& folder, const SynsetRef& synset) {
  const Path path = folder / (std::string("data.") + synset.part);
  std::ifstream file(path);
  if (!file) return Fail(Code::kNotFound, fmt::format("open WordNet's '{}'", path.string()));
  file.seekg(synset.offset);
  std::string line;
  std::getline(file, line);

  // offset lex_filenum ss_type w_cnt(hex) word lex_id [word lex_id ...] ...
  std::istringstream fields(line);
  std::string offset, file_number, type, count_text;
  fields >> offset >> file_number >> type >> count_text;
  const bool fits = offset == fmt::format("{:08}", synset.offset) && count_text.size() == 2;
  const long count = fits ? std::strtol(count_text.c_str(), nullptr, 16) : 0;
  std::vector<std::string> lemmas;
  bool anchored = false;
  for (long i = 0; i < count; ++i) {
    std::string word, lex_id;
    fields >> word >> lex_id;
    anchored = anchored || word == synset.anchor;
    lemmas.push_back(Normalize(word.substr(0, word.find('('))));
  }
  if (!anchored)
    return Fail(Code::kCorrupt, fmt::format("'{}' has no synset with '{}' at {}; WordNet 3.0 is needed", path.string(),
                                            synset.anchor, synset.offset));
  return lemmas;
}

}  // namespace etude::language
