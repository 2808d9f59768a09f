// SPDX-License-Identifier: Apache-2.0
#include "services/language/meaning.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "services/language/held_out.h"
#include "services/language/lexicon.h"
#include "services/language/tokenizer.h"
#include "services/language/vocabulary.h"
#include "services/spec/object_names.h"

namespace etude::language {
namespace {

using Strings = std::vector<std::string>;

// Where `phrase` stands in `words` from `from` on, as it is.
std::optional<std::size_t> Find(const Strings& words, const Strings& phrase, std::size_t from = 0) {
  const auto it = std::search(words.begin() + static_cast<std::ptrdiff_t>(std::min(from, words.size())), words.end(),
                              phrase.begin(), phrase.end());
  if (phrase.empty() || it == words.end()) return std::nullopt;
  return static_cast<std::size_t>(it - words.begin());
}

bool IsArticle(const std::string& word) {
  return word == "the" || word == "a" || word == "an" || word == "that" || word == "this";
}

// Words that were understood; what is left is understood otherwise.
void Take(Strings& words, std::size_t at, std::size_t count) {
  const auto first = words.begin() + static_cast<std::ptrdiff_t>(at);
  words.erase(first, first + static_cast<std::ptrdiff_t>(std::min(count, words.size() - at)));
}

// One of the things that a phrase may stand for, and where it does.
struct Found {
  std::string name;
  std::size_t at = 0, words = 0;
};

// The longest phrase wins; of equal ones the first. Names that share it stand beside each other.
struct Best {
  std::vector<Found> found;

  void Offer(Found one) {
    const std::size_t length = found.empty() ? 0 : found.front().words;
    if (one.words < length) return;
    if (one.words > length) found.clear();
    const bool known = std::ranges::any_of(found, [&](const Found& other) { return other.name == one.name; });
    if (!known) found.push_back(std::move(one));
  }
  bool empty() const { return found.empty(); }
  bool one() const { return found.size() == 1; }
  std::string names() const {
    Strings texts;
    for (const auto& one : found) texts.push_back(one.name);
    return fmt::format("{}", fmt::join(texts, " or "));
  }
};

// Whether it is what another one of `objects` is called in base words: then it is that one's, whatever the rule makes
// of this one's words.
bool IsAnothers(const Vocabulary& vocabulary, const Strings& objects, const std::string& object,
                const std::string& phrase) {
  return std::ranges::any_of(objects, [&](const std::string& other) {
    const Vocabulary::Noun* const noun = other == object ? nullptr : vocabulary.FindNoun(other);
    return noun != nullptr && std::ranges::count(BasePhrases(noun->base), phrase) > 0;
  });
}

// Every phrase for an object, held out ones too: those are what a person tries.
Strings PhrasesOf(const Vocabulary& vocabulary, const std::string& object) {
  Strings phrases;
  if (const Vocabulary::Noun* noun = vocabulary.FindNoun(object))
    for (const auto& phrase : AllPhrases(*noun)) phrases.push_back(phrase);
  for (const auto& held_out : HeldOutNounPhrases())
    if (held_out.object == object) phrases.push_back(held_out.text);
  return phrases;
}

// By its phrases; where there is none by its name, which the grammar itself may never say alone.
Best FindObject(const Vocabulary& vocabulary, const Strings& objects, const Strings& words) {
  Best best, by_name;
  for (const auto& object : objects) {
    for (const auto& phrase : PhrasesOf(vocabulary, object)) {
      const Strings split = SplitWords(phrase);
      const auto at = Find(words, split);
      if (at && !IsAnothers(vocabulary, objects, object, phrase)) best.Offer({object, *at, split.size()});
    }
    const Strings name = SplitWords(Normalize(ObjectNoun(object)));
    if (const auto at = Find(words, name)) by_name.Offer({object, *at, name.size()});
  }
  return best.empty() ? by_name : best;
}

// The object whose phrase begins at `at`, an article aside.
Best ObjectAt(const Vocabulary& vocabulary, const Strings& objects, const Strings& words, std::size_t at) {
  if (at < words.size() && IsArticle(words[at])) ++at;
  Best best, by_name;
  for (const auto& object : objects) {
    for (const auto& phrase : PhrasesOf(vocabulary, object)) {
      const Strings split = SplitWords(phrase);
      if (Find(words, split, at) == at && !IsAnothers(vocabulary, objects, object, phrase))
        best.Offer({object, at, split.size()});
    }
    const Strings name = SplitWords(Normalize(ObjectNoun(object)));
    if (Find(words, name, at) == at) by_name.Offer({object, at, name.size()});
  }
  return best.empty() ? by_name : best;
}

// Whether the verb's words all stand in `words`, in order. Others may stand between them.
bool HasVerb(const Strings& words, const std::string& verb) {
  std::size_t at = 0;
  for (const auto& word : SplitWords(verb)) {
    const auto it = std::find(words.begin() + static_cast<std::ptrdiff_t>(at), words.end(), word);
    if (it == words.end()) return false;
    at = static_cast<std::size_t>(it - words.begin()) + 1;
  }
  return true;
}

// "without touching the ball" and what it keeps off; taken out of `words`.
Strings KeepingWords(const Vocabulary& vocabulary) {
  Strings all;
  const ObstacleWords& lexicon = ObstacleLexicon();
  for (const auto* texts : {&lexicon.before, &lexicon.after, &vocabulary.avoid()})
    all.insert(all.end(), texts->begin(), texts->end());
  for (const auto& verb : vocabulary.touch())
    for (const char* negation : {"do not ", "never ", "without "}) all.push_back(negation + verb);
  return all;
}

struct KeptOff {
  std::string obstacle;  // as Command has it
  std::string why;       // it is something that no task is judged by
};
KeptOff TakeObstacle(const Vocabulary& vocabulary, const Strings& objects, Strings& words) {
  const ObstacleWords& lexicon = ObstacleLexicon();
  Found keep;
  for (const auto& text : KeepingWords(vocabulary)) {
    const Strings split = SplitWords(text);
    const auto at = Find(words, split);
    if (at && split.size() > keep.words) keep = {text, *at, split.size()};
  }
  if (keep.words == 0) return {};
  const std::size_t after = keep.at + keep.words;
  for (const auto* texts : {&lexicon.others, &lexicon.any_other})
    for (const auto& text : *texts) {
      const Strings split = SplitWords(text);
      if (Find(words, split, after) != after) continue;
      Take(words, keep.at, keep.words + split.size());
      return {.obstacle = std::string(kEverythingElse), .why = ""};
    }
  const Best ball = ObjectAt(vocabulary, {kObstacleObject}, words, after);
  if (ball.one()) {
    Take(words, keep.at, ball.found.front().at + ball.found.front().words - keep.at);
    return {.obstacle = std::string(kObstacleObject), .why = ""};
  }
  // the policy may keep off it; it is not what is to be moved
  const Best thing = ObjectAt(vocabulary, objects, words, after);
  if (thing.empty()) return {};
  return {.obstacle = "", .why = fmt::format("no task is judged by keeping off {}", thing.names())};
}

// "to the left of the milk": the task that goes there, and beside what; taken out of `words`. It may also say which
// thing is meant, as in "pick up the bottle behind the coke".
struct Place {
  std::string task, reference, why;
};
Place TakePlace(const Vocabulary& vocabulary, const Strings& objects, Strings& words) {
  Best best;
  for (const auto& task : vocabulary.tasks()) {
    if (!vocabulary.needs_reference(task)) continue;
    for (const auto& place : vocabulary.place(task).all) {
      const Strings split = SplitWords(place);
      if (const auto at = Find(words, split)) best.Offer({task, *at, split.size()});
    }
  }
  if (!best.one()) return {};
  const Found& place = best.found.front();
  const Best reference = ObjectAt(vocabulary, objects, words, place.at + place.words);
  if (reference.empty()) return {.task = place.name, .reference = "", .why = "beside what is not said"};
  if (!reference.one()) return {.task = place.name, .reference = "", .why = "beside " + reference.names()};
  const Found& beside = reference.found.front();
  Take(words, place.at, beside.at + beside.words - place.at);
  return {.task = place.name, .reference = beside.name, .why = ""};
}

// A task without a place, by its verb.
Best TaskOf(const Vocabulary& vocabulary, const Strings& words) {
  Best best;
  for (const auto& task : vocabulary.tasks()) {
    if (vocabulary.needs_reference(task)) continue;
    for (const auto& verb : vocabulary.verb(task).all)
      if (HasVerb(words, verb)) best.Offer({task, 0, SplitWords(verb).size()});
  }
  return best;
}

bool HasVerbOf(const Vocabulary& vocabulary, const std::string& task, const Strings& words) {
  return !task.empty() &&
         std::ranges::any_of(vocabulary.verb(task).all, [&](const std::string& verb) { return HasVerb(words, verb); });
}

void Understand(const Vocabulary& vocabulary, const Strings& objects, Meaning& meaning) {
  Strings words = SplitWords(meaning.sentence);
  if (words.empty()) return void(meaning.why = "nothing is said");
  for (const auto& held_out : HeldOutSentences())
    if (held_out.text == meaning.sentence && std::ranges::find(objects, held_out.object) != objects.end())
      return void(meaning.command = Command{.task = held_out.task, .target = held_out.object});
  Command command;
  const KeptOff kept_off = TakeObstacle(vocabulary, objects, words);
  if (!kept_off.why.empty()) return void(meaning.why = kept_off.why);
  command.obstacle = kept_off.obstacle;
  const Place place = TakePlace(vocabulary, objects, words);
  const Best task = TaskOf(vocabulary, words);
  const bool goes_there = task.empty() || HasVerbOf(vocabulary, place.task, words);
  if (!place.task.empty() && goes_there) {
    if (!place.why.empty() && task.empty()) return void(meaning.why = place.why);
    command.task = place.why.empty() ? place.task : "";
    command.reference = place.why.empty() ? place.reference : "";
  }
  if (command.task.empty()) {
    if (task.empty()) return void(meaning.why = "no verb of a task that is known");
    if (!task.one()) return void(meaning.why = "it could be " + task.names());
    command.task = task.found.front().name;
  }
  const Best target = FindObject(vocabulary, objects, words);
  if (target.empty()) return void(meaning.why = "no object of the table is named");
  if (!target.one()) return void(meaning.why = "it could be " + target.names());
  command.target = target.found.front().name;
  meaning.command = std::move(command);
}

}  // namespace

std::string Meaning::task() const {
  if (!command) return "";
  if (command->obstacle.empty()) return command->task;
  return command->task + (command->obstacle == kEverythingElse ? "+others" : "+obstacle");
}

std::vector<std::string> Meaning::unseen() const {
  Strings list;
  for (const auto& word : words)
    if (!word.seen) list.push_back(word.text);
  return list;
}

void MarkSeen(Meaning& meaning, const std::set<std::string>& seen) {
  for (auto& word : meaning.words) word.seen = seen.contains(word.text);
}

OrderedJson ToJson(const Meaning& meaning) {
  OrderedJson words = OrderedJson::array();
  for (const auto& word : meaning.words) words.push_back({{"text", word.text}, {"seen", word.seen}});
  return {{"sentence", meaning.sentence},
          {"words", std::move(words)},
          {"task", meaning.task()},
          {"target", meaning.command ? meaning.command->target : ""},
          {"reference", meaning.command ? meaning.command->reference : ""},
          {"why", meaning.why}};
}

Result<MeaningParser> MeaningParser::Load(const std::vector<std::string>& tasks,
                                          const std::vector<std::string>& objects) {
  MeaningParser parser;
  parser.objects_ = SceneNames(objects);
  ETUDE_ASSIGN_OR_RETURN(const Grammar grammar, Grammar::LoadFor(parser.objects_, tasks));
  ETUDE_ASSIGN_OR_RETURN(parser.seen_, SeenWords(grammar, tasks, parser.objects_));
  ETUDE_ASSIGN_OR_RETURN(auto vocabulary, Vocabulary::LoadFor(parser.objects_, tasks));
  parser.vocabulary_ = std::make_shared<const Vocabulary>(std::move(vocabulary));
  return parser;
}

Meaning MeaningParser::Parse(const std::string& sentence, const std::vector<std::string>& on_table) const {
  Meaning meaning;
  meaning.sentence = Normalize(sentence.substr(0, 1000));
  for (auto& word : SplitWords(meaning.sentence)) {
    const bool seen = seen_.contains(word);
    meaning.words.push_back({std::move(word), seen});
  }
  Understand(*vocabulary_, on_table.empty() ? objects_ : on_table, meaning);
  return meaning;
}

}  // namespace etude::language
