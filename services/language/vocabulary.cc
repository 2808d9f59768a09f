// SPDX-License-Identifier: Apache-2.0
#include "services/language/vocabulary.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <sstream>

#include "services/core/log.h"
#include "services/language/held_out.h"
#include "services/language/tokenizer.h"
#include "services/spec/object_names.h"

namespace etude::language {
namespace {

// Adds `more` to `words`, each word once.
void AddWords(std::vector<std::string>& words, const std::vector<std::string>& more) {
  for (const auto& word : more)
    if (std::find(words.begin(), words.end(), word) == words.end()) words.push_back(word);
}

std::string Join(const std::vector<std::string>& words) {
  std::string phrase;
  for (const auto& word : words) phrase = JoinWords(phrase, word);
  return phrase;
}

// "to the left of" -> "on the left of", "at the left of": other prepositions, no other words
std::vector<std::string> OtherPrepositions(const std::vector<std::string>& places) {
  std::vector<std::string> others;
  for (const auto& place : places)
    if (place.starts_with("to the "))
      for (const char* preposition : {"on ", "at "}) others.push_back(preposition + place.substr(3));
  return others;
}

}  // namespace

std::string JoinWords(const std::string& a, const std::string& b) {
  return a.empty() ? b : b.empty() ? a : a + " " + b;
}

std::vector<std::string> SplitWords(const std::string& text) {
  std::vector<std::string> words;
  std::istringstream stream(text);
  for (std::string word; stream >> word;) words.push_back(std::move(word));
  return words;
}

bool HasWords(const std::string& text, const std::string& phrase) {
  for (std::size_t at = text.find(phrase); at != std::string::npos; at = text.find(phrase, at + 1)) {
    const std::size_t end = at + phrase.size();
    if ((at == 0 || text[at - 1] == ' ') && (end == text.size() || text[end] == ' ')) return true;
  }
  return false;
}

std::vector<std::string> BasePhrases(const NounTemplate& base) {
  std::vector<std::string> phrases;
  for (const auto& adjective : base.adjectives)
    for (const auto& head : base.nouns) phrases.push_back(JoinWords(adjective, head));
  return phrases;
}

std::set<std::string> AllPhrases(const Vocabulary::Noun& noun) {
  std::set<std::string> phrases;
  for (const auto& adjective : noun.base.adjectives)
    for (const auto& head : noun.base.nouns) {
      phrases.insert(JoinWords(adjective, head));
      for (const auto& other : noun.adjectives.at(adjective)) phrases.insert(JoinWords(other, head));
      for (const auto& other : noun.nouns.at(head)) phrases.insert(JoinWords(adjective, other));
    }
  return phrases;
}

bool Vocabulary::IsHeldOutPhrase(const std::string& phrase) {
  static const std::set<std::string> phrases = [] {
    std::set<std::string> texts;
    for (const auto& held_out : HeldOutNounPhrases()) texts.insert(held_out.text);
    return texts;
  }();
  return phrases.contains(phrase) || HasHeldOut(phrase);
}

bool Vocabulary::HasHeldOut(const std::string& sentence) {
  // a single word may be part of another phrase ("can"), and is looked for in whole phrases only
  static const std::vector<std::string> texts = [] {
    std::vector<std::string> list;
    for (const auto& phrase : HeldOutNounPhrases())
      if (phrase.text.find(' ') != std::string::npos) list.push_back(phrase.text);
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

// What the rule makes of `phrase`: of the whole where WordNet has it, else of one word at a time what means the same (a
// kind of one of its words is no kind of what it names).
std::vector<std::string> Vocabulary::Expand(const std::string& phrase, Part part) const {
  if (!wordnet_ || phrase.empty()) return {};
  const WordNet& wordnet = *wordnet_;
  // what describes a noun may be a noun ("milk carton")
  const auto part_of = [&](const std::string& words) {
    return part == Part::kAdjective && !wordnet.Has(words, part) ? Part::kNoun : part;
  };
  const auto words = SplitWords(phrase);
  if (words.size() == 1 || wordnet.Has(phrase, part_of(phrase))) return wordnet.Related(phrase, part_of(phrase));
  std::vector<std::string> phrases;
  for (std::size_t i = 0; i < words.size(); ++i)
    for (const auto& synonym : wordnet.Synonyms(words[i], part_of(words[i]))) {
      auto changed = words;
      changed[i] = synonym;
      AddWords(phrases, {Join(changed)});
    }
  return phrases;
}

std::vector<std::string> Vocabulary::ExpandAll(const std::vector<std::string>& phrases, Part part) const {
  std::vector<std::string> all = phrases;
  for (const auto& phrase : phrases) AddWords(all, Expand(phrase, part));
  return all;
}

void Vocabulary::AddObject(const ObjectWords& words) {
  Noun noun{words.base, {}, {}, {}};
  for (const auto& adjective : words.base.adjectives) noun.adjectives[adjective] = Expand(adjective, Part::kAdjective);
  for (const auto& head : words.base.nouns) noun.nouns[head] = Expand(head, Part::kNoun);
  nouns_.emplace(words.object, std::move(noun));
  objects_.push_back(words.object);
}

void Vocabulary::ChoosePhrases() {
  std::map<std::string, int> objects;  // that a phrase could be of
  std::set<std::string> base;
  for (const auto& [object, noun] : nouns_) {
    for (const auto& phrase : AllPhrases(noun)) ++objects[phrase];
    for (auto& phrase : BasePhrases(noun.base)) base.insert(std::move(phrase));
  }
  for (auto& [object, noun] : nouns_) {
    const std::vector<std::string> own = BasePhrases(noun.base);
    noun.phrases = AllPhrases(noun);
    std::erase_if(noun.phrases, [&](const std::string& phrase) {
      const bool is_own = std::find(own.begin(), own.end(), phrase) != own.end();
      return IsHeldOutPhrase(phrase) || (!is_own && (base.contains(phrase) || objects.at(phrase) > 1));
    });
  }
}

// A part of several words tells it where one of them does: a base word that is no other's base word, or what the rule
// makes of one and says of no other.
void Vocabulary::ChooseTelling(const std::vector<std::string>& objects) {
  using WordsOf = std::map<std::string, std::set<const Noun*>>;  // word -> nouns whose phrases have it
  WordsOf base, all;
  const auto add = [](const auto& phrases, const Noun* noun, WordsOf& words) {
    for (const auto& phrase : phrases)
      for (const auto& word : SplitWords(phrase)) words[word].insert(noun);
  };
  for (const auto& object : objects) {
    const Noun* const noun = FindNoun(object);
    if (!noun) continue;
    add(BasePhrases(noun->base), noun, base);
    add(AllPhrases(*noun), noun, all);
  }
  for (auto& [object, noun] : nouns_) {
    noun.telling.clear();
    const std::set<const Noun*> itself{&noun};
    const auto tells = [&](const std::string& part, const WordsOf& words) {
      return std::ranges::any_of(SplitWords(part), [&](const auto& word) {
        const auto it = words.find(word);
        return it != words.end() && it->second == itself;
      });
    };
    for (const auto* parts : {&noun.adjectives, &noun.nouns})
      for (const auto& [part, others] : *parts) {
        if (tells(part, base)) noun.telling.insert(part);
        for (const auto& other : others)
          if (tells(other, all)) noun.telling.insert(other);
      }
  }
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
      const auto taken = BasePhrases(noun.base);
      if (std::find(taken.begin(), taken.end(), phrase) != taken.end())
        return refuse(fmt::format("'{}' means {}", phrase, name));
    }
  }
  Noun noun{words, {}, {}, {}};
  noun.adjectives[""];  // nothing is said instead
  for (const auto& phrase : words.nouns) noun.nouns[phrase];
  nouns_.emplace(object.name, std::move(noun));
  objects_.push_back(object.name);
  return {};
}

// A synonym that two tasks would share, or that is another one's own verb, is said of neither. Tasks with places
// share their verbs: where A goes tells them apart.
void Vocabulary::AddTasks(const std::vector<TaskName>& tasks) {
  std::map<std::string, std::set<std::string>> meanings;  // verb -> tasks without places
  std::set<std::string> own;
  for (const auto& task : tasks) {
    const TaskWordsSpec& words = task.spec->words;
    if (!words.places.empty()) continue;
    own.insert(words.verbs.begin(), words.verbs.end());
    for (const auto& verb : ExpandAll(words.verbs, Part::kVerb)) meanings[verb].insert(task.base);
  }
  for (const auto& task : tasks) {
    const TaskWordsSpec& words = task.spec->words;
    Words verbs{words.verbs, ExpandAll(words.verbs, Part::kVerb)};
    std::erase_if(verbs.all, [&](const std::string& verb) {
      const bool is_base = std::find(words.verbs.begin(), words.verbs.end(), verb) != words.verbs.end();
      return words.places.empty() && !is_base && (own.contains(verb) || meanings[verb].size() > 1);
    });
    verbs_.emplace(task.base, std::move(verbs));
    tasks_.push_back(task.base);
    if (words.places.empty()) continue;
    Words places{words.places, words.places};
    AddWords(places.all, OtherPrepositions(words.places));
    places_.emplace(task.base, std::move(places));
  }
}

namespace {

// Whether a sentence for `a` may be one for `b`.
const std::string* SharedVerb(const TaskSpec& a, const TaskSpec& b) {
  const auto has = [](const std::vector<std::string>& words, const std::string& word) {
    return std::find(words.begin(), words.end(), word) != words.end();
  };
  const auto& places = a.words.places;
  const bool same_place =
      places.empty() ? b.words.places.empty()
                     : std::ranges::any_of(places, [&](const auto& place) { return has(b.words.places, place); });
  if (!same_place) return nullptr;
  const auto it = std::ranges::find_if(a.words.verbs, [&](const auto& verb) { return has(b.words.verbs, verb); });
  return it == a.words.verbs.end() ? nullptr : &*it;
}

// The built-in tasks and those of `names` that are not; none of `names` sounds like another of them.
Result<std::vector<TaskName>> TasksFor(const std::vector<std::string>& names) {
  std::vector<TaskName> tasks, asked;
  for (const auto& base : BaseTasks()) {
    ETUDE_ASSIGN_OR_RETURN(TaskName task, ParseTask(base));
    tasks.push_back(std::move(task));
  }
  const auto has = [](const std::vector<TaskName>& some, const TaskName& task) {
    return std::ranges::any_of(some, [&](const auto& other) { return other.base == task.base; });
  };
  for (const auto& name : names) {
    ETUDE_ASSIGN_OR_RETURN(TaskName task, ParseTask(name));
    if (has(asked, task)) continue;
    for (const auto& other : asked)
      if (const auto* verb = SharedVerb(*task.spec, *other.spec))
        return Fail(Code::kInvalidArgument,
                    fmt::format("words of task '{}': '{}' means '{}' too; one campaign cannot have both", task.base,
                                *verb, other.base));
    if (!has(tasks, task)) tasks.push_back(task);
    asked.push_back(std::move(task));
  }
  return tasks;
}

}  // namespace

Result<Vocabulary> Vocabulary::Load(const std::vector<OwnObject>& own, const std::vector<std::string>& tasks) {
  ETUDE_ASSIGN_OR_RETURN(const std::vector<TaskName> known, TasksFor(tasks));
  Vocabulary vocabulary;
  if (auto wordnet = WordNet::Open())
    vocabulary.wordnet_ = std::move(*wordnet);
  else
    Log().warn("no synonyms in sentences: {}", wordnet.error().message);
  for (const auto* lexicon : {&ObjectLexicon(), &ClassLexicon()})
    for (const auto& words : *lexicon) vocabulary.AddObject(words);
  vocabulary.AddTasks(known);
  vocabulary.avoid_ = vocabulary.ExpandAll({ObstacleLexicon().avoid}, Part::kVerb);
  vocabulary.touch_ = vocabulary.ExpandAll({ObstacleLexicon().touch}, Part::kVerb);
  for (const auto& object : own) ETUDE_RETURN_IF_ERROR(vocabulary.AddOwn(object));
  vocabulary.ChoosePhrases();
  vocabulary.ChooseTelling(vocabulary.objects_);
  return vocabulary;
}

Result<Vocabulary> Vocabulary::LoadFor(const std::vector<std::string>& objects, const std::vector<std::string>& tasks) {
  ETUDE_ASSIGN_OR_RETURN(Vocabulary vocabulary, Load({}, tasks));
  std::vector<OwnObject> own;
  for (const auto& object : objects)
    if (!vocabulary.FindNoun(object)) own.push_back({object, {}});
  if (!own.empty()) {
    ETUDE_ASSIGN_OR_RETURN(vocabulary, Load(own, tasks));
  }
  if (!objects.empty()) vocabulary.ChooseTelling(objects);
  return vocabulary;
}

}  // namespace etude::language
