// SPDX-License-Identifier: Apache-2.0
#include "services/language/grammar.h"

#include <algorithm>
#include <map>
#include <set>

#include "services/core/check.h"
#include "services/core/log.h"
#include "services/language/lexicon.h"
#include "services/language/tokenizer.h"

namespace etude::language {
namespace {

const std::string& Pick(const std::vector<std::string>& items, Rng& rng) { return items[rng.Below(items.size())]; }

std::string JoinWords(const std::string& a, const std::string& b) {
  return a.empty() ? b : b.empty() ? a : a + " " + b;
}

// Adds `more` to `words`, each word once.
void AddWords(std::vector<std::string>& words, const std::vector<std::string>& more) {
  for (const auto& word : more)
    if (std::find(words.begin(), words.end(), word) == words.end()) words.push_back(word);
}

// "pick up" + "red can" -> "pick red can up" for verbs with a particle.
std::string SplitParticle(const std::string& verb, const std::string& noun) {
  const auto space = verb.rfind(' ');
  const std::string particle = space == std::string::npos ? "" : verb.substr(space + 1);
  const bool splits =
      particle == "up" || particle == "down" || particle == "over" || particle == "away" || particle == "forward";
  return splits ? verb.substr(0, space) + " " + noun + " " + particle : verb + " " + noun;
}

// One typing error: swap, drop, double or replace a letter inside a word of at least four letters.
void AddTypo(std::string& text, Rng& rng) {
  const std::size_t at = 1 + rng.Below(std::max<std::size_t>(text.size(), 3) - 2);
  if (at + 1 >= text.size() || text[at] == ' ' || text[at + 1] == ' ' || text[at - 1] == ' ') return;
  switch (rng.Below(4)) {
    case 0:
      std::swap(text[at], text[at + 1]);
      break;
    case 1:
      text.erase(at, 1);
      break;
    case 2:
      text.insert(at, 1, text[at]);
      break;
    default:
      text[at] = static_cast<char>('a' + rng.Below(26));
      break;
  }
}

}  // namespace

struct Grammar::Lexicon {
  struct Noun {
    NounTemplate base;
    std::vector<std::string> adjectives, nouns;  // base and synonyms
  };
  struct Verb {
    std::vector<std::string> base, all;
  };
  std::map<std::string, Noun> nouns;
  std::map<std::string, Verb> verbs;
  std::set<std::string> held_out_nouns, held_out_sentences;

  std::string SampleNoun(const Noun& noun, Rng& rng) const {
    while (true) {
      const bool plain = rng.Bernoulli(0.5);
      const auto& adjectives = plain || rng.Bernoulli(0.5) ? noun.base.adjectives : noun.adjectives;
      const auto& heads = plain || rng.Bernoulli(0.5) ? noun.base.nouns : noun.nouns;
      std::string adjective = Pick(adjectives, rng);
      std::string phrase = JoinWords(adjective, Pick(heads, rng));
      if (!held_out_nouns.contains(phrase)) return phrase;
    }
  }

  std::string SampleVaried(const Command& command, Rng& rng) const {
    static const std::vector<std::string> articles{"the", "the", "the", "that", "this", "a"};
    static const std::vector<std::string> openings{"please", "could you", "can you",      "now",
                                                   "robot",  "go and",    "i want you to"};
    static const std::vector<std::string> closings{"please", "for me", "now", "on the table", "over there"};
    const Verb& verb = verbs.at(command.task);
    std::string noun = SampleNoun(nouns.at(command.target), rng);
    if (rng.Bernoulli(0.6)) noun = JoinWords(Pick(articles, rng), noun);
    const std::string& words = Pick(rng.Bernoulli(0.5) ? verb.base : verb.all, rng);
    std::string sentence = rng.Bernoulli(0.25) ? SplitParticle(words, noun) : JoinWords(words, noun);
    if (rng.Bernoulli(0.15)) sentence = JoinWords(Pick(openings, rng), sentence);
    if (rng.Bernoulli(0.15)) sentence = JoinWords(sentence, Pick(closings, rng));
    return sentence;
  }
};

Result<Grammar> Grammar::Load() {
  auto lexicon = std::make_shared<Lexicon>();
  Grammar grammar;
  bool warned = false;
  const auto add_synsets = [&](std::vector<std::string>& words, const std::vector<SynsetRef>& synsets) {
    for (const auto& synset : synsets) {
      const auto lemmas = SynsetLemmas(kWordNetFolder, synset);
      if (lemmas) {
        AddWords(words, *lemmas);
      } else if (!warned) {
        warned = true;
        Log().warn("fewer synonyms: {} (install wordnet-base)", lemmas.error().message);
      }
    }
  };
  for (const auto& words : ObjectLexicon()) {
    Lexicon::Noun noun{words.base, words.base.adjectives, words.base.nouns};
    AddWords(noun.adjectives, words.more_adjectives);
    AddWords(noun.nouns, words.more_nouns);
    add_synsets(noun.adjectives, words.adjective_synsets);
    add_synsets(noun.nouns, words.noun_synsets);
    lexicon->nouns.emplace(words.object, std::move(noun));
    grammar.objects_.push_back(words.object);
  }
  for (const auto& words : TaskLexicon()) {
    Lexicon::Verb verb{words.base, words.base};
    AddWords(verb.all, words.more);
    add_synsets(verb.all, words.synsets);
    lexicon->verbs.emplace(words.task, std::move(verb));
    grammar.tasks_.push_back(words.task);
  }
  lexicon->held_out_nouns.insert(HeldOutNounPhrases().begin(), HeldOutNounPhrases().end());
  for (const auto& sentence : HeldOutSentences()) lexicon->held_out_sentences.insert(sentence.text);
  grammar.lexicon_ = std::move(lexicon);
  return grammar;
}

std::string Grammar::Sample(const Command& command, Style style, Rng& rng) const {
  ETUDE_CHECK(lexicon_->verbs.contains(command.task), "task '{}'", command.task);
  ETUDE_CHECK(lexicon_->nouns.contains(command.target), "target '{}'", command.target);
  if (style == Style::kTemplate) {
    const auto& noun = lexicon_->nouns.at(command.target).base;
    const std::string& verb = Pick(lexicon_->verbs.at(command.task).base, rng);
    const std::string& adjective = Pick(noun.adjectives, rng);
    return JoinWords(verb, JoinWords(adjective, Pick(noun.nouns, rng)));
  }
  std::string sentence;
  do {
    sentence = lexicon_->SampleVaried(command, rng);
    if (style == Style::kNoisy)
      for (std::uint64_t typos = rng.Below(3); typos > 0; --typos) AddTypo(sentence, rng);
  } while (lexicon_->held_out_sentences.contains(Normalize(sentence)));
  if (style == Style::kNoisy) {
    if (rng.Bernoulli(0.3)) sentence[0] = static_cast<char>(std::toupper(sentence[0]));
    if (rng.Bernoulli(0.3)) sentence += rng.Bernoulli(0.5) ? "." : "!";
  }
  return sentence;
}

std::vector<std::string> Grammar::Templates(const Command& command) const {
  ETUDE_CHECK(lexicon_->verbs.contains(command.task), "task '{}'", command.task);
  ETUDE_CHECK(lexicon_->nouns.contains(command.target), "target '{}'", command.target);
  const auto& noun = lexicon_->nouns.at(command.target).base;
  std::vector<std::string> sentences;
  for (const auto& verb : lexicon_->verbs.at(command.task).base)
    for (const auto& adjective : noun.adjectives)
      for (const auto& head : noun.nouns) sentences.push_back(JoinWords(verb, JoinWords(adjective, head)));
  return sentences;
}

}  // namespace etude::language
