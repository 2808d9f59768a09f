// SPDX-License-Identifier: Apache-2.0
#include "services/language/sentence.h"

#include <algorithm>

namespace etude::language {
namespace {

using Strings = std::vector<std::string>;

// Function words: all that a sentence says beside base words and their synonyms.
const Strings& Articles() {
  static const Strings words{"the", "that", "this", "a"};
  return words;
}
const Strings& Openings() {
  static const Strings words{"please", "could you", "can you", "would you", "now", "and now"};
  return words;
}
const Strings& Closings() {
  static const Strings words{"please", "for me", "now", "for us"};
  return words;
}

const std::string& Pick(const Strings& items, Rng& rng) { return items[rng.Below(items.size())]; }

// "spin around the can" would be a path
bool MustSplit(const std::string& verb) { return verb.ends_with(" around"); }

// "pick up" + "red can" -> "pick red can up" for verbs with a particle.
std::string SplitParticle(const std::string& verb, const std::string& noun) {
  static const Strings particles{"up", "down", "over", "away", "forward", "around"};
  const auto space = verb.rfind(' ');
  const std::string particle = space == std::string::npos ? "" : verb.substr(space + 1);
  const bool splits = std::find(particles.begin(), particles.end(), particle) != particles.end();
  return splits ? verb.substr(0, space) + " " + noun + " " + particle : verb + " " + noun;
}

// "without touching B pick ..."
bool IsAdverbial(const std::string& words) { return words.starts_with("without ") || words.starts_with("while "); }

// What keeps off B: "avoid B and ..." or "... without touching B". Ahead of the rest, a clause with a verb
// of its own needs "and".
std::string Keeping(const std::string& words, const std::string& noun, const std::string& action, bool ahead) {
  if (!ahead) return action + " " + words + " " + noun;
  return words + " " + noun + (IsAdverbial(words) ? " " : " and ") + action;
}

// "everything else" after "avoid" is "anything else" after "without touching"
const Strings& Others(const std::string& words) {
  const bool negative = HasWords(words, "without") || HasWords(words, "not") || HasWords(words, "never");
  return negative ? ObstacleLexicon().any_other : ObstacleLexicon().others;
}

// The phrase of `adjective` and `head` with one of them a word of random letters, where the other tells the object.
std::string Masked(const Vocabulary::Noun& noun, const std::string& adjective, const std::string& head, Rng& rng) {
  const bool without_adjective = !adjective.empty() && noun.telling.contains(head);
  const bool without_head = !head.empty() && noun.telling.contains(adjective);
  if (!without_adjective && !without_head) return JoinWords(adjective, head);
  const bool first = without_adjective && (!without_head || rng.Bernoulli(0.5));
  const std::string strange = StrangeWord(rng);
  return first ? JoinWords(strange, head) : JoinWords(adjective, strange);
}

// Half of them of base words, each as often as the others however much the rule makes of it.
std::string DrawPhrase(const Vocabulary::Noun& noun, double masked, Rng& rng) {
  while (true) {
    std::string adjective = Pick(noun.base.adjectives, rng), head = Pick(noun.base.nouns, rng);
    const Strings &adjectives = noun.adjectives.at(adjective), &heads = noun.nouns.at(head);
    if (rng.Bernoulli(0.5)) {
      const bool first = !adjectives.empty() && (heads.empty() || rng.Bernoulli(0.5));
      if (first)
        adjective = Pick(adjectives, rng);
      else if (!heads.empty())
        head = Pick(heads, rng);
    }
    std::string phrase = JoinWords(adjective, head);
    if (!noun.phrases.contains(phrase)) continue;
    if (masked > 0 && rng.Bernoulli(masked)) phrase = Masked(noun, adjective, head, rng);
    return phrase;
  }
}

std::string DrawBasePhrase(const Vocabulary::Noun& noun, Rng& rng) {
  const std::string& adjective = Pick(noun.base.adjectives, rng);
  return JoinWords(adjective, Pick(noun.base.nouns, rng));
}

// "put A behind B", not "behind B put A"
bool StartsWithVerb(const Vocabulary& vocabulary, const Command& command, const std::string& action) {
  const auto& verbs = vocabulary.verb(command.task).base;
  return std::any_of(verbs.begin(), verbs.end(), [&](const auto& verb) { return action.starts_with(verb + " "); });
}

Strings BaseObstacles(const Vocabulary& vocabulary, const std::string& obstacle, const std::string& words) {
  if (obstacle == kEverythingElse) return {Others(words).front()};
  return BasePhrases(vocabulary.FindNoun(obstacle)->base);
}

// the object next to which, or of which to keep clear
std::string DrawReference(const Vocabulary& vocabulary, const std::string& object, double masked, Rng& rng) {
  const std::string article = rng.Bernoulli(0.75) ? "the" : rng.Bernoulli(0.5) ? "that" : "";
  return JoinWords(article, DrawPhrase(*vocabulary.FindNoun(object), masked, rng));
}

// verb and object, and where to put it; `verb_first` says whether it begins with the verb
std::string DrawAction(const Vocabulary& vocabulary, const Command& command, double masked, Rng& rng,
                       bool& verb_first) {
  std::string noun = DrawPhrase(*vocabulary.FindNoun(command.target), masked, rng);
  if (rng.Bernoulli(0.6)) {
    const std::string article = rng.Bernoulli(0.5) ? "the" : Pick(Articles(), rng);
    const bool vowel = std::string("aeiou").find(noun[0]) != std::string::npos;
    noun = (article == "a" && vowel ? "an" : article) + " " + noun;
  }
  const auto& verbs = vocabulary.verb(command.task);
  const std::string& verb = Pick(rng.Bernoulli(0.5) ? verbs.base : verbs.all, rng);
  const std::string action = rng.Bernoulli(0.25) || MustSplit(verb) ? SplitParticle(verb, noun) : JoinWords(verb, noun);
  verb_first = true;
  if (command.reference.empty()) return action;

  const auto& places = vocabulary.place(command.task);
  const std::string& place = Pick(rng.Bernoulli(0.5) ? places.base : places.all, rng);
  const std::string there = place + " " + DrawReference(vocabulary, command.reference, masked, rng);
  verb_first = rng.Bernoulli(0.7);
  return verb_first ? action + " " + there : there + " " + action;
}

// how a varied sentence says "keep off"
std::string DrawKeeping(const Vocabulary& vocabulary, bool ahead, Rng& rng) {
  const ObstacleWords& words = ObstacleLexicon();
  if (ahead) return rng.Bernoulli(0.35) ? Pick(words.after, rng) : Pick(vocabulary.avoid(), rng);
  if (rng.Bernoulli(0.4)) return Pick(words.after, rng);
  const std::string joint = rng.Bernoulli(0.5) ? "and " : "but ";
  if (rng.Bernoulli(0.5)) return joint + Pick(vocabulary.avoid(), rng);
  return joint + (rng.Bernoulli(0.5) ? "do not " : "never ") + Pick(vocabulary.touch(), rng);
}

std::string AddObstacle(const Vocabulary& vocabulary, const Command& command, const std::string& action, bool ahead,
                        double masked, Rng& rng) {
  const std::string words = DrawKeeping(vocabulary, ahead, rng);
  const std::string obstacle = command.obstacle == kEverythingElse
                                   ? Pick(Others(words), rng)
                                   : DrawReference(vocabulary, command.obstacle, masked, rng);
  return Keeping(words, obstacle, action, ahead);
}

template <class Texts>
void AddWordsOf(const Texts& texts, std::set<std::string>& words) {
  for (const auto& text : texts)
    for (auto& word : SplitWords(text)) words.insert(std::move(word));
}

}  // namespace

std::set<std::string> AllWords(const Vocabulary& vocabulary, const Command& command) {
  std::set<std::string> words{"an"};
  for (const auto* texts : {&Articles(), &Openings(), &Closings(), &vocabulary.verb(command.task).all})
    AddWordsOf(*texts, words);
  for (const auto& object : {command.target, command.reference, command.obstacle})
    if (const auto* noun = vocabulary.FindNoun(object)) AddWordsOf(noun->phrases, words);
  if (!command.reference.empty()) AddWordsOf(vocabulary.place(command.task).all, words);
  if (command.obstacle.empty()) return words;
  const ObstacleWords& obstacle = ObstacleLexicon();
  for (const auto* texts : {&obstacle.before, &obstacle.after, &vocabulary.avoid(), &vocabulary.touch()})
    AddWordsOf(*texts, words);
  AddWordsOf(Strings{"and but do not never"}, words);
  if (command.obstacle == kEverythingElse)
    for (const auto* texts : {&obstacle.others, &obstacle.any_other}) AddWordsOf(*texts, words);
  return words;
}

std::string DrawTemplate(const Vocabulary& vocabulary, const Command& command, Rng& rng) {
  const std::string& verb = Pick(vocabulary.verb(command.task).base, rng);
  bool verb_first = true;
  std::string sentence = JoinWords(verb, DrawBasePhrase(*vocabulary.FindNoun(command.target), rng));
  if (!command.reference.empty()) {
    const std::string& place = Pick(vocabulary.place(command.task).base, rng);
    const std::string there = place + " " + DrawBasePhrase(*vocabulary.FindNoun(command.reference), rng);
    verb_first = rng.Bernoulli(0.5);
    sentence = verb_first ? sentence + " " + there : there + " " + sentence;
  }
  if (command.obstacle.empty()) return sentence;

  const ObstacleWords& words = ObstacleLexicon();
  const bool ahead = verb_first && rng.Bernoulli(0.4);
  const std::string& keep = Pick(ahead ? words.before : words.after, rng);
  const std::string obstacle = command.obstacle == kEverythingElse
                                   ? Others(keep).front()
                                   : DrawBasePhrase(*vocabulary.FindNoun(command.obstacle), rng);
  return Keeping(keep, obstacle, sentence, ahead);
}

std::vector<std::string> AllTemplates(const Vocabulary& vocabulary, const Command& command) {
  Strings sentences;
  for (const auto& verb : vocabulary.verb(command.task).base)
    for (const auto& noun : BasePhrases(vocabulary.FindNoun(command.target)->base))
      sentences.push_back(JoinWords(verb, noun));

  if (!command.reference.empty()) {
    Strings placed;
    for (const auto& action : sentences)
      for (const auto& place : vocabulary.place(command.task).base)
        for (const auto& noun : BasePhrases(vocabulary.FindNoun(command.reference)->base)) {
          placed.push_back(action + " " + place + " " + noun);
          placed.push_back(place + " " + noun + " " + action);
        }
    sentences = std::move(placed);
  }
  if (command.obstacle.empty()) return sentences;

  Strings kept;
  for (const auto& action : sentences)
    for (const bool ahead : {true, false}) {
      if (ahead && !StartsWithVerb(vocabulary, command, action)) continue;
      for (const auto& words : ahead ? ObstacleLexicon().before : ObstacleLexicon().after)
        for (const auto& noun : BaseObstacles(vocabulary, command.obstacle, words))
          kept.push_back(Keeping(words, noun, action, ahead));
    }
  return kept;
}

std::string DrawVaried(const Vocabulary& vocabulary, const Command& command, double masked, Rng& rng) {
  bool verb_first = true;
  std::string sentence = DrawAction(vocabulary, command, masked, rng, verb_first);
  if (!command.obstacle.empty()) {
    const bool ahead = verb_first && rng.Bernoulli(0.4);
    sentence = AddObstacle(vocabulary, command, sentence, ahead, masked, rng);
    verb_first = verb_first && !IsAdverbial(sentence);
  }
  if (verb_first && rng.Bernoulli(0.15)) sentence = JoinWords(Pick(Openings(), rng), sentence);
  if (rng.Bernoulli(0.15)) sentence = JoinWords(sentence, Pick(Closings(), rng));
  return sentence;
}

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

std::string StrangeWord(Rng& rng) {
  std::string word;
  for (std::uint64_t letters = 3 + rng.Below(7); letters > 0; --letters) word += static_cast<char>('a' + rng.Below(26));
  return word;
}

void AddStrangeWord(std::string& text, Rng& rng) {
  std::vector<std::size_t> starts{0};
  for (std::size_t at = text.find(' '); at != std::string::npos; at = text.find(' ', at + 1)) starts.push_back(at + 1);
  const std::string word = StrangeWord(rng);
  const std::uint64_t place = rng.Below(starts.size() + 1);
  if (place == starts.size())
    text += " " + word;
  else
    text.insert(starts[place], word + " ");
}

}  // namespace etude::language
