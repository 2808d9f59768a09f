// SPDX-License-Identifier: Apache-2.0
// Synonyms from WordNet 3.0's database files (Debian package wordnet-base).
// Source of the format: wndb(5WN).
#pragma once

#include <string>
#include <vector>

#include "services/core/file.h"

namespace etude::language {

/// One sense, named by its file and byte offset, with a word it must contain so that another database
/// version is noticed.
struct SynsetRef {
  const char* part;    ///< noun | verb | adj
  long offset;         ///< byte offset in data.<part>
  const char* anchor;  ///< lemma that must be there, e.g. "pick_up"
};

/// Where wordnet-base installs its files.
inline constexpr const char* kWordNetFolder = "/usr/share/wordnet";

/// The lemmas of a synset, underscores as spaces, lower case.
/// @error kNotFound (no database), kCorrupt (the line is not a synset with the anchor).
Result<std::vector<std::string>> SynsetLemmas(const Path& folder, const SynsetRef& synset);

}  // namespace etude::language
