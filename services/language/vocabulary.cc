// SPDX-License-Identifier: Apache-2.0
#include "services/language/vocabulary.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "services/core/log.h"
#include "services/episode/object_names.h"
#include "services/language/held_out.h"
#include "services/language/tokenizer.h"

namespace etude::language {
namespace {

// Adds `more` to `words`, each word once.
void AddWords(std::vector<std::string>& words, const std::vector<std::string>& more) {
  for (const auto& word : more)
    if (std::find(words.begin(), words.end(), word) == words.end()) words.push_back(word);
}

bool IsUnused(const std::string& lemma) {
  const auto& unused = UnusedLemmas();
  return std::find(unused.begin(), unused.end(), lemma) != unused.end();
}

}  // namespace

std::string JoinWords(const std::string& a, const std::string& b) {
  return a.empty() ? b : b.empty() ? a : a + " " + b;
}

bool HasWords(const std::string& text, const std::string& phrase) {
  for (std::size_t at = text.find(phrase); at != std::string::npos; at = text.find(phrase, at + 1)) {
    const std::size_t end = at + phrase.size();
    if ((at == 0 || text[at - 1] == ' ') && (end == text.size() || text[end] == ' ')) return true;
  }
  return false;
}

std::vector<std::string> Phrases(const Vocabulary::Noun& noun) {
  std::vector<std::string> phrases;
  for (const auto* half : {&noun.base, &noun.varied})
    for (const auto& adjective : half->adjectives)
      for (const auto& head : half->nouns) {
        std::string phrase = JoinWords(adjective, head);
        if (!Vocabulary::IsHeldOutPhrase(phrase)) AddWords(phrases, {std::move(phrase)});
      }
  return phrases;
}

bool Vocabulary::IsHeldOutPhrase(const std::string& phrase) {
  static const std::set<std::string> phrases(HeldOutNounPhrases().begin(), HeldOutNounPhrases().end());
  return phrases.contains(phrase) || HasHeldOut(phrase);
}

bool Vocabulary::HasHeldOut(const std::string& sentence) {
  // a single word may be part of another phrase ("can"), and is looked for in whole phrases only
  static const std::vector<std::string> texts = [] {
    std::vector<std::string> list;
    for (const auto& phrase : HeldOutNounPhrases())
      if (phrase.find(' ') != std::string::npos) list.push_back(phrase);
    for (const auto& held_out : HeldOutSentences()) list.push_back(held_out.text);
    return list;
  }();
  return std::any_of(texts.begin(), texts.end(), [&](const auto& text) { return HasWords(sentence, text); });
}

const Vocabulary::Noun* Vocabulary::FindNoun(const std::string& object) const {
  auto found = nouns_.find(object);
  if (found == nouns_.end()) found = nouns_.find(ObjectNoun(object));
  return found == nouns_.end() ? nullptr : &found->second;
}

void Vocabulary::AddSynonyms(const std::vector<SynsetRef>& synsets, std::vector<std::string>& words) {
  for (const auto& synset : synsets) {
    const auto lemmas = SynsetLemmas(kWordNetFolder, synset);
    if (!lemmas) {
      if (!warned_) Log().warn("fewer synonyms: {} (install wordnet-base)", lemmas.error().message);
      warned_ = true;
      continue;
    }
    for (const auto& lemma : *lemmas)
      if (!IsUnused(lemma)) AddWords(words, {lemma});
  }
}

void Vocabulary::AddObject(const ObjectWords& words) {
  Noun noun{words.base, words.varied};
  AddSynonyms(words.adjective_synsets, noun.varied.adjectives);
  AddSynonyms(words.noun_synsets, noun.varied.nouns);
  // without WordNet there may be none
  if (noun.varied.nouns.empty()) noun.varied.nouns = words.base.nouns;
  nouns_.emplace(words.object, std::move(noun));
  objects_.push_back(words.object);
}

Status Vocabulary::AddOwn(const OwnObject& object) {
  const auto refuse = [&](const std::string& why) {
    return Fail(Code::kInvalidArgument, fmt::format("words of object '{}': {}", object.name, why));
  };
  if (nouns_.contains(object.name)) return refuse("there are words already");
  NounTemplate words{{""}, {}};
  for (const auto& phrase : object.phrases) AddWords(words.nouns, {Normalize(phrase)});
  if (words.nouns.empty()) words.nouns.push_back(Normalize(object.name));
  for (const auto& phrase : words.nouns) {
    if (phrase.empty()) return refuse("a phrase has no letters");
    if (IsHeldOutPhrase(phrase)) return refuse(fmt::format("'{}' is held out of training", phrase));
    for (const auto& [name, noun] : nouns_) {
      const auto taken = Phrases(noun);
      if (std::find(taken.begin(), taken.end(), phrase) != taken.end())
        return refuse(fmt::format("'{}' means {}", phrase, name));
    }
  }
  nouns_.emplace(object.name, Noun{words, words});
  objects_.push_back(object.name);
  return {};
}

void Vocabulary::AddTasks() {
  const auto make = [&](const TaskWords& words) {
    Words verb{words.base, words.base};
    AddWords(verb.all, words.more);
    AddSynonyms(words.synsets, verb.all);
    return verb;
  };
  for (const auto& words : TaskLexicon()) {
    verbs_.emplace(words.task, make(words));
    tasks_.push_back(words.task);
  }
  for (const auto& words : RelationLexicon()) {
    verbs_.emplace(words.task, make(PlacingLexicon()));
    Words place{words.base, words.base};
    AddWords(place.all, words.more);
    places_.emplace(words.task, std::move(place));
    tasks_.push_back(words.task);
  }
  AddSynonyms(ObstacleLexicon().avoid_synsets, avoid_);
  AddSynonyms(ObstacleLexicon().touch_synsets, touch_);
  AddWords(avoid_, {"avoid"});
  AddWords(touch_, {"touch"});
}

Result<Vocabulary> Vocabulary::Load(const std::vector<OwnObject>& own) {
  Vocabulary vocabulary;
  for (const auto* lexicon : {&ObjectLexicon(), &ClassLexicon()})
    for (const auto& words : *lexicon) vocabulary.AddObject(words);
  vocabulary.AddTasks();
  for (const auto& object : own) ETUDE_RETURN_IF_ERROR(vocabulary.AddOwn(object));
  return vocabulary;
}

}  // namespace etude::language
