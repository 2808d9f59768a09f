// SPDX-License-Identifier: Apache-2.0
// Private to services/language: how words become a sentence.
#pragma once

#include <set>
#include <string>
#include <vector>

#include "services/core/rng.h"
#include "services/language/vocabulary.h"

namespace etude::language {

/// A draw from the template sentences of `command`. Base tasks without obstacle: verb, adjective, noun.
std::string DrawTemplate(const Vocabulary& vocabulary, const Command& command, Rng& rng);
std::vector<std::string> AllTemplates(const Vocabulary& vocabulary, const Command& command);
/// A draw with synonyms, articles, politeness and free word order; may hold held-out language.
/// @param masked  as Grammar::Sample
std::string DrawVaried(const Vocabulary& vocabulary, const Command& command, double masked, Rng& rng);

/// Every word that a sentence for `command` may hold, but for typing errors.
std::set<std::string> AllWords(const Vocabulary& vocabulary, const Command& command);

/// At most one typing error: swaps, drops, doubles or replaces a letter inside a word.
void AddTypo(std::string& text, Rng& rng);
/// A word of three to nine random letters.
std::string StrangeWord(Rng& rng);
/// Puts a StrangeWord before one of `text`'s, or behind the last.
void AddStrangeWord(std::string& text, Rng& rng);

}  // namespace etude::language
