// SPDX-License-Identifier: Apache-2.0
// Tests services/language/grammar.cc, vocabulary.cc, lexicon.cc and held_out.cc
#include "services/language/grammar.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <set>
#include <sstream>

#include "services/language/held_out.h"
#include "services/language/lexicon.h"
#include "services/language/tokenizer.h"
#include "services/language/vocabulary.h"
#include "services/spec/object_names.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::language {
namespace grammar_test {

using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;

const std::vector<std::string> kBasicTasks{"pick", "push", "put_down"};
const std::vector<std::string> kSix{"cube", "coke", "pepsi", "milk", "bread", "bottle"};

const Grammar& TheGrammar() {
  static const Grammar grammar = Grammar::Load().value();
  return grammar;
}

const Vocabulary& TheVocabulary() {
  static const Vocabulary vocabulary = Vocabulary::Load({}, {}).value();
  return vocabulary;
}

/// Commands that together have every task, object, relation and kind of obstacle.
std::vector<Command> AllCommands() {
  const auto& objects = TheGrammar().objects();
  std::vector<Command> commands;
  for (const auto& task : TheGrammar().tasks()) {
    for (std::size_t i = 0; i < objects.size(); ++i) {
      const std::string &target = objects[i], &next = objects[(i + 1) % objects.size()];
      const std::string reference = ParseTask(task)->relation() ? objects[(i + 5) % objects.size()] : "";
      for (const std::string& obstacle : {std::string(), next, std::string(kEverythingElse)})
        commands.push_back({task, target, reference, obstacle});
    }
  }
  return commands;
}

std::string Name(const Command& command) {
  return command.task + " " + command.target + " " + command.reference + " " + command.obstacle;
}

TEST(Grammar, HasThe232SentencesOfTheOriginal) {
  std::set<std::string> sentences;
  for (const auto& task : kBasicTasks)
    for (const auto& object : kSix)
      for (const auto& sentence : TheGrammar().Templates({task, object})) sentences.insert(sentence);
  EXPECT_EQ(sentences.size(), 232u);
  EXPECT_THAT(sentences, Contains("pick up red can"));
  EXPECT_THAT(sentences, Contains("put down bottle"));
}

TEST(Grammar, KnowsAllTasksAndObjects) {
  EXPECT_EQ(TheGrammar().tasks(),
            (std::vector<std::string>{"drop_in", "pick", "place_behind", "place_front", "place_left", "place_right",
                                      "push", "put_down", "rotate", "stack"}));
  EXPECT_EQ(TheGrammar().objects().size(), 17u);
  EXPECT_EQ(ObjectNoun("apple_03"), "apple");
  EXPECT_EQ(ObjectNoun("apple_"), "apple_");
  EXPECT_EQ(ObjectNoun("coke_03"), "coke_03");
  EXPECT_EQ(ObjectNoun("put_down"), "put_down");
  EXPECT_TRUE(TheGrammar().Check({"rotate", "lemon_07"}));
}

TEST(Grammar, TemplateSamplesAreExactlyTheTemplates) {
  Rng rng(3);
  for (const Command& command :
       {Command{"push", "pepsi"}, Command{"rotate", "mug_09"}, Command{"place_left", "lemon_00", "apple_01"},
        Command{"pick", "milk", "", "basketball"}, Command{"put_down", "bread", "", kEverythingElse}}) {
    const auto templates = TheGrammar().Templates(command);
    std::set<std::string> drawn;
    for (int i = 0; i < 3000; ++i) drawn.insert(TheGrammar().Sample(command, Style::kTemplate, rng));
    EXPECT_EQ(drawn, std::set<std::string>(templates.begin(), templates.end())) << Name(command);
    EXPECT_EQ(drawn.size(), templates.size()) << Name(command) << ": a template stands twice";
  }
}

TEST(Grammar, WritesTemplatesOfTheNewTasks) {
  const auto has = [](const Command& command, const std::string& sentence) {
    EXPECT_THAT(TheGrammar().Templates(command), Contains(sentence));
  };
  has({"rotate", "pear_04"}, "revolve pear");
  has({"place_right", "coke", "milk"}, "put red can right to milk carton");
  has({"place_left", "coke", "milk"}, "to the left of milk carton place red can");
  has({"place_behind", "bread", "bottle"}, "move bread behind green bottle");
  has({"pick", "coke", "", "basketball"}, "pick up red can without touching ball");
  has({"push", "cube", "", kEverythingElse}, "avoid everything else and push red cube");
  has({"push", "cube", "", kEverythingElse}, "push red cube without touching anything else");
}

TEST(Grammar, VariedSentencesAreMany) {
  Rng rng(13);
  for (const Command& command : AllCommands()) {
    std::set<std::string> sentences;
    for (int i = 0; sentences.size() < 200 && i < 1500; ++i)
      sentences.insert(TheGrammar().Sample(command, Style::kVaried, rng));
    EXPECT_GE(sentences.size(), 200u) << Name(command);
  }
}

TEST(Grammar, NeverMeetsTheHeldOutTables) {
  ASSERT_EQ(HeldOutSentences().size(), 30u);
  ASSERT_EQ(HeldOutNounPhrases().size(), 50u);
  for (const auto& sentence : HeldOutSentences())
    EXPECT_TRUE(TheGrammar().Check({sentence.task, sentence.object})) << sentence.text;
  std::set<std::string> phrases;
  for (const auto& held_out : HeldOutNounPhrases()) phrases.insert(held_out.text);
  for (const auto& object : TheGrammar().objects())
    for (const auto& phrase : TheGrammar().NounPhrases(object)) EXPECT_FALSE(phrases.contains(phrase)) << phrase;
  std::vector<std::string> forbidden;
  for (const auto& sentence : HeldOutSentences()) forbidden.push_back(" " + sentence.text + " ");
  for (const auto& phrase : phrases) {
    forbidden.push_back(" the " + phrase + " please ");  // a single word may be part of another phrase
    if (phrase.find(' ') != std::string::npos) forbidden.push_back(" " + phrase + " ");
  }
  Rng rng(5);
  for (const Command& command : AllCommands()) {
    for (int i = 0; i < 160; ++i) {
      const Style style = i % 4 == 0 ? Style::kTemplate : i % 4 == 1 ? Style::kNoisy : Style::kVaried;
      const auto text = " " + Normalize(TheGrammar().Sample(command, style, rng)) + " ";
      for (const auto& words : forbidden) ASSERT_EQ(text.find(words), std::string::npos) << text;
    }
  }
}

TEST(Grammar, NoPhraseMeansTwoObjects) {
  std::map<std::string, std::string> meaning;
  for (const auto& object : TheGrammar().objects()) {
    const auto phrases = TheGrammar().NounPhrases(object);
    EXPECT_FALSE(phrases.empty()) << object;
    for (const auto& phrase : phrases) {
      const auto [it, fresh] = meaning.emplace(phrase, object);
      EXPECT_TRUE(fresh) << "'" << phrase << "' is " << object << " and " << it->second;
    }
  }
}

TEST(Grammar, SaysWhatTheRuleMakesOfOneWordOfAPhrase) {
  const auto phrases = [](const char* object) { return TheGrammar().NounPhrases(object); };
  EXPECT_THAT(phrases("bottle"), testing::IsSupersetOf({"bottle", "carafe", "green vessel", "green flask"}));
  EXPECT_THAT(phrases("bottle"), Not(Contains("flask"))) << "it is held out";
  EXPECT_THAT(phrases("coke"), testing::IsSupersetOf({"red can", "crimson can", "red beer can"}));
  EXPECT_THAT(phrases("coke"), Not(Contains("crimson beer can"))) << "one word at a time";
  EXPECT_THAT(phrases("coke"), Not(Contains("red soda can"))) << "\"red soda\" is held out";
  for (const char* object : {"coke", "pepsi"})
    EXPECT_THAT(phrases(object), Not(Contains("cola can"))) << "it may be the other one";
}

// However many words the rule knows for it, a base word is said as often as those beside it.
TEST(Grammar, HalfOfThePhrasesAreOfBaseWords) {
  Rng rng(33);
  int plain = 0, bare = 0;
  const int draws = 4000;
  for (int i = 0; i < draws; ++i) {
    const std::string text = TheGrammar().Sample({"push", "bottle"}, Style::kVaried, rng);
    plain += HasWords(text, "bottle");
    bare += !HasWords(text, "green") && !HasWords(text, "glass") && HasWords(text, "carafe");
  }
  EXPECT_GT(plain, draws / 2);
  EXPECT_GT(bare, draws / 1000);
}

TEST(Grammar, NoVerbMeansTwoTasks) {
  std::map<std::string, std::string> meaning;
  Rng rng(17);
  for (const auto& task : {"pick", "push", "put_down", "rotate"}) {
    for (int i = 0; i < 20000; ++i) {
      std::string text = TheGrammar().Sample({task, "pear_01"}, Style::kVaried, rng);
      const auto [it, fresh] = meaning.emplace(text, task);
      ASSERT_EQ(it->second, task) << text;
    }
  }
}

/// Reads a varied relation back: the one direction in it, and the object named right after that.
struct Reading {
  std::set<std::string> directions;
  std::string reference;
};

// the object whose phrase stands at the beginning of `text`, the longest one
std::string ObjectAt(std::string text) {
  for (const char* article : {"the ", "that "})
    if (text.starts_with(article)) text = text.substr(std::string(article).size());
  static const auto meaning = [] {
    std::map<std::string, std::string> all;
    for (const auto& name : TheGrammar().objects())
      for (const auto& phrase : TheGrammar().NounPhrases(name)) all.emplace(phrase, name);
    return all;
  }();
  for (std::size_t end = text.size(); end != std::string::npos; end = end ? text.rfind(' ', end - 1) : end - 1)
    if (const auto found = meaning.find(text.substr(0, end)); found != meaning.end()) return found->second;
  return "";
}

Reading Read(const std::string& text) {
  Reading reading;
  std::size_t longest = 0;
  for (const char* task : {"place_left", "place_right", "place_front", "place_behind"}) {
    for (const auto& place : TheVocabulary().place(task).all) {
      const std::size_t at = (" " + text).find(" " + place + " ");
      if (at == std::string::npos) continue;
      if (place.size() <= longest) continue;  // "on the back of" is not "on"
      longest = place.size();
      reading.directions = {task};
      reading.reference = ObjectAt(text.substr(at + place.size() + 1));
    }
  }
  return reading;
}

TEST(Grammar, ARelationNamesItsReferenceAfterTheDirection) {
  Rng rng(19);
  for (const Command& command : AllCommands()) {
    for (int i = 0; i < 40; ++i) {
      if (command.task == "stack" || command.task == "drop_in")
        continue;  // "on" and "in" stand in other sentences, too
      const std::string text = TheGrammar().Sample(command, Style::kVaried, rng);
      const Reading reading = Read(text);
      if (!ParseTask(command.task)->relation()) {
        EXPECT_TRUE(reading.directions.empty()) << text;
        continue;
      }
      EXPECT_EQ(reading.directions, std::set<std::string>{command.task}) << text;
      EXPECT_EQ(reading.reference, command.reference) << text;
    }
  }
}

TEST(Grammar, EverySentenceNamesTargetAndObstacle) {
  std::vector<std::string> signs{"avoiding", "without", "not", "never"};
  for (const auto& verb : TheVocabulary().avoid()) signs.push_back(verb);
  Rng rng(23);
  for (const Command& command : AllCommands()) {
    for (int i = 0; i < 40; ++i) {
      const std::string text = TheGrammar().Sample(command, Style::kVaried, rng);
      for (const std::string& object : {command.target, command.obstacle}) {
        if (object.empty() || object == kEverythingElse) continue;
        const auto phrases = TheGrammar().NounPhrases(object);
        EXPECT_TRUE(std::any_of(phrases.begin(), phrases.end(), [&](auto& phrase) { return HasWords(text, phrase); }))
            << text << " without " << object;
      }
      const bool keeps_off = std::any_of(signs.begin(), signs.end(), [&](auto& sign) { return HasWords(text, sign); });
      EXPECT_EQ(keeps_off, !command.obstacle.empty()) << text;
    }
  }
}

TEST(Grammar, RefusesWhatItCannotSay) {
  const auto message = [](const Command& command) {
    const Status status = TheGrammar().Check(command);
    EXPECT_FALSE(status) << Name(command);
    if (status) return std::string();
    EXPECT_EQ(status.error().code, Code::kInvalidArgument);
    return status.error().message;
  };
  EXPECT_THAT(message({"pik", "coke"}), HasSubstr("did you mean 'pick'"));
  EXPECT_THAT(message({"pick", "cokee"}), HasSubstr("did you mean 'coke'"));
  EXPECT_THAT(message({"pick", ""}), HasSubstr("no words for object ''"));
  EXPECT_THAT(message({"pick", "others"}), HasSubstr("no words for object"));
  EXPECT_THAT(message({"place_left", "coke"}), HasSubstr("needs a reference"));
  EXPECT_THAT(message({"place_left", "coke", "others"}), HasSubstr("reference"));
  EXPECT_THAT(message({"push", "coke", "milk"}), HasSubstr("has no reference"));
  EXPECT_THAT(message({"place_left", "pear_01", "pear_02"}), HasSubstr("two objects are called 'pear'"));
  EXPECT_THAT(message({"pick", "coke", "", "coke"}), HasSubstr("two objects are called 'coke'"));
  EXPECT_THAT(message({"pick", "coke", "", "balls"}), HasSubstr("no words for object 'balls'"));
}

// A task file NAME.yaml with these words; with places it is about a second object.
std::string WriteTask(const TemporaryFolder& folder, const std::string& name, const std::string& verbs,
                      const std::string& places = "") {
  const std::string text = "{name: " + name + ", words: {verbs: [" + verbs + "], places: [" + places +
                           "]}, reference: {needed: " + (places.empty() ? "false" : "true") +
                           "}, stages: [approach, reach, grasp, lift, hold], success: risen}";
  const Path file = folder / (name + ".yaml");
  EXPECT_THAT(WriteFileAtomically(file, text), IsOk());
  return file.string();
}

TEST(Grammar, SaysATaskOfTheUsersInItsOwnWords) {
  const TemporaryFolder folder;
  const std::string fetch = WriteTask(folder, "fetch", "fetch, bring over"),
                    lean = WriteTask(folder, "lean", "lean", "against, to the side of");
  const auto grammar = Grammar::Load({}, {"pick", fetch, lean});
  ASSERT_THAT(grammar, IsOk());
  EXPECT_THAT(grammar->Templates({fetch, "pear_01"}), testing::UnorderedElementsAre("fetch pear", "bring over pear"));
  EXPECT_THAT(grammar->Templates({lean, "pear_01", "mug_00"}), Contains("against cup lean pear"));
  const auto words = grammar->Words({lean, "pear_01", "mug_00"});
  EXPECT_THAT(words, testing::IsSupersetOf({"lean", "against", "on", "at", "side"})) << "with other prepositions";
  EXPECT_FALSE(grammar->Check({lean, "pear_01"}));
  EXPECT_FALSE(TheGrammar().Check({fetch, "pear_01"})) << "only who names a file knows it";
}

TEST(Grammar, TwoTasksOfACampaignNeverSoundTheSame) {
  const TemporaryFolder folder;
  const std::string take = WriteTask(folder, "take", "take, raise"), on = WriteTask(folder, "on", "put", "on"),
                    above = WriteTask(folder, "above", "put", "above");
  EXPECT_THAT(Grammar::Load({}, {"pick", take}), MessageHas("'raise' means 'pick' too; one campaign cannot have both"));
  EXPECT_THAT(Grammar::Load({}, {"push", take}), IsOk()) << "a built-in task that is not asked for is no matter";
  EXPECT_THAT(Grammar::Load({}, {above, on}), IsOk()) << "where it goes tells them apart";
  EXPECT_THAT(Grammar::Load({}, {"stack", on}), MessageHas("'stack' too"));
  EXPECT_THAT(Grammar::Load({}, {"pick", "pick+obstacle", take + "+others"}), HasCode(Code::kInvalidArgument));
}

TEST(Vocabulary, TasksWithoutPlacesShareNoVerb) {
  std::map<std::string, std::string> meaning;
  for (const auto& task : TheVocabulary().tasks()) {
    if (TheVocabulary().needs_reference(task)) continue;
    for (const auto& verb : TheVocabulary().verb(task).all) {
      const auto [it, is_new] = meaning.emplace(verb, task);
      EXPECT_TRUE(is_new || it->second == task) << verb << ": " << task << " and " << it->second;
    }
    for (const auto& verb : ParseTask(task)->spec->words.verbs)
      EXPECT_THAT(TheVocabulary().verb(task).all, Contains(verb)) << "its own are always said";
  }
}

TEST(Vocabulary, ASynonymThatIsAnothersOwnVerbIsSaidOfThatAlone) {
  const TemporaryFolder folder;
  const std::string up = WriteTask(folder, "up", "elevate");
  ASSERT_THAT(TheVocabulary().verb("pick").all, Contains("elevate")) << "for it means to raise";
  const auto vocabulary = Vocabulary::Load({}, {"pick", up});
  ASSERT_THAT(vocabulary, IsOk());
  EXPECT_THAT(vocabulary->verb("pick").all, Not(Contains("elevate")));
  EXPECT_THAT(vocabulary->verb("pick").all, Contains("raise"));
  EXPECT_THAT(vocabulary->verb(up).all, Contains("elevate"));
  EXPECT_THAT(vocabulary->verb(up).all, Not(Contains("raise")));
}

TEST(HasWords, LooksForWholeWords) {
  for (const char* text : {"red can", "the red can now", "red canister red can"})
    EXPECT_TRUE(HasWords(text, "red can"));
  for (const char* text : {"", "red", "red canister", "tired can", "red  can"}) EXPECT_FALSE(HasWords(text, "red can"));
}

TEST(ClauseWords, AreThoseThatTasksAloneNeverSay) {
  const std::vector<std::string> tasks{"pick", "push"}, objects{"cube", "coke", "milk"};
  const auto seen = SeenWords(TheGrammar(), tasks, objects);
  const auto clauses = ClauseWords(TheGrammar(), tasks, objects);
  ASSERT_TRUE(seen && clauses);
  for (const char* word : {"avoid", "touching", "basketball", "left"}) {
    EXPECT_FALSE(seen->contains(word)) << word;
    EXPECT_TRUE(clauses->contains(word)) << word;
  }
  EXPECT_FALSE(clauses->contains("bread")) << "no object of theirs";
}

TEST(CommandFor, SaysWhatIsToBeKeptOff) {
  const auto obstacle = [](const char* task) { return CommandFor(*ParseTask(task), "coke", "").obstacle; };
  EXPECT_EQ(obstacle("pick"), "");
  EXPECT_EQ(obstacle("pick+obstacle"), "basketball");
  EXPECT_EQ(obstacle("pick+others"), kEverythingElse);
}

TEST(Grammar, NoisySentencesAreWrittenAsPeopleWrite) {
  Rng rng(41);
  constexpr int kDraws = 4000;
  int upper = 0, stops = 0, typos = 0;
  const auto words = TheGrammar().Words({"pick", "coke"});
  for (int i = 0; i < kDraws; ++i) {
    const std::string text = TheGrammar().Sample({"pick", "coke"}, Style::kNoisy, rng);
    upper += text[0] >= 'A' && text[0] <= 'Z';
    stops += text.ends_with('.') || text.ends_with('!');
    typos += !UnseenWords(Normalize(text), words).empty();
  }
  EXPECT_NEAR(upper, 0.3 * kDraws, 130);
  EXPECT_NEAR(stops, 0.3 * kDraws, 130);
  EXPECT_GT(typos, 0.25 * kDraws);
  EXPECT_LT(typos, 0.75 * kDraws) << "a third have none, some make another word";
}

TEST(Grammar, TakesObjectsOfTheUsersOwn) {
  const auto grammar = Grammar::Load({{"rubber_duck", {}}, {"bear", {"Teddy bear", "plush bear"}}});
  ASSERT_TRUE(grammar) << grammar.error().message;
  EXPECT_THAT(grammar->Templates({"pick", "rubber_duck"}), Contains("pick up rubber duck"));
  EXPECT_THAT(grammar->Templates({"place_left", "bear", "rubber_duck"}),
              Contains("put plush bear to the left of rubber duck"));
  const auto refusal = [](const OwnObject& object) { return Grammar::Load({object}).error().message; };
  EXPECT_THAT(refusal({"tin", {"red can"}}), HasSubstr("'red can' means coke"));
  EXPECT_THAT(refusal({"naan", {}}), HasSubstr("held out"));
  EXPECT_THAT(refusal({"coke", {"fizz"}}), HasSubstr("words already"));
  const auto jug = Grammar::Load({{"jug", {}}});
  ASSERT_TRUE(jug) << jug.error().message;
  EXPECT_THAT(TheGrammar().NounPhrases("bottle"), Contains("jug")) << "a kind of bottle";
  EXPECT_THAT(jug->NounPhrases("jug"), Contains("jug"));
  EXPECT_THAT(jug->NounPhrases("bottle"), Not(Contains("jug"))) << "what somebody calls it so comes first";

  const auto scene = Grammar::LoadFor({"coke", "apple_02", "toy_car"});
  ASSERT_TRUE(scene) << scene.error().message;
  EXPECT_THAT(scene->NounPhrases("toy_car"), Contains("toy car"));
  EXPECT_EQ(scene->NounPhrases("coke"), TheGrammar().NounPhrases("coke"));
}

TEST(Grammar, DrawsEveryVerbOfItsTask) {
  Rng rng(29);
  std::map<std::string, int> counts;
  const int draws = 8000;
  for (int i = 0; i < draws; ++i) {
    const std::string text = TheGrammar().Sample({"rotate", "mug_02"}, Style::kVaried, rng);
    for (const char* verb : {"rotate", "revolve", "spin", "go", "orbit", "whirl", "reel", "gyrate"})
      counts[verb] += HasWords(text, verb);
  }
  // half of the draws are from the three templates, the rest from all
  for (const char* verb : {"rotate", "revolve", "spin"}) EXPECT_GT(counts[verb], draws / 7) << verb;
  for (const char* verb : {"go", "orbit", "whirl", "reel", "gyrate"}) EXPECT_GT(counts[verb], draws / 60) << verb;
}

TEST(Grammar, IsAPureFunctionOfTheGenerator) {
  for (const Command& command : {Command{"put_down", "milk"}, Command{"place_front", "cube", "coke", "basketball"}}) {
    Rng a(11), b(11);
    for (int i = 0; i < 200; ++i)
      EXPECT_EQ(TheGrammar().Sample(command, Style::kNoisy, a), TheGrammar().Sample(command, Style::kNoisy, b));
  }
}

// facts.md's C.1 and C.2 as printed there, and what the project adds to them for what they have no words for
const std::set<std::string> kBaseWords{
    "red",   "maroon",  "object",    "cube",   "square",  "coke",  "cocacola",  "can",    "bottle",     "blue",
    "pepsi", "milk",    "white",     "carton", "box",     "bread", "yellow",    "brown",  "green",      "glass",
    "apple", "avocado", "orange",    "donut",  "beef",    "meat",  "hamburger", "burger", "strawberry", "mug",
    "cup",   "lemon",   "sourdough", "pear",   "pick",    "up",    "raise",     "hold",   "push",       "move",
    "put",   "down",    "place",     "rotate", "revolve", "spin",  "get",       "left",   "right",      "mandarin"};
const std::set<std::string> kOurWords{"ball",  "basketball", "front", "behind", "back", "avoid",
                                      "touch", "stack",      "drop",  "top",    "into", "inside"};

TEST(Lexicon, HasTheBaseWordsOfTheSourceAndNoOthers) {
  std::set<std::string> words;
  const auto add = [&](const std::vector<std::string>& phrases) {
    for (const auto& phrase : phrases)
      for (const auto& word : UnseenWords(phrase, {})) words.insert(word);
  };
  for (const auto* lexicon : {&ObjectLexicon(), &ClassLexicon()})
    for (const auto& object : *lexicon) {
      add(object.base.adjectives);
      add(object.base.nouns);
    }
  for (const auto& name : BaseTasks()) {
    const TaskWordsSpec task = ParseTask(name)->spec->words;
    add(task.verbs);
    add(task.places);
  }
  // with what stack and drop_in say, ours
  const std::set<std::string> function_words{"to",   "the",    "of",    "in",   "on",   "top",
                                             "into", "inside", "stack", "drop", "throw"};
  for (const auto& word : words)
    EXPECT_TRUE(kBaseWords.contains(word) || kOurWords.contains(word) || function_words.contains(word)) << word;
}

// What varied sentences say beyond base words is what the rule gives for them, nothing else.
TEST(Lexicon, EveryOtherWordComesFromTheRule) {
  const auto wordnet = WordNet::Open();
  ASSERT_TRUE(wordnet) << wordnet.error().message;
  std::set<std::string> allowed{"physical"};  // "physical object"
  for (const auto& bases : {kBaseWords, kOurWords, std::set<std::string>{"pick up", "put down", "place down", "throw"}})
    for (const auto& word : bases) {
      for (const auto& part : UnseenWords(word, {})) allowed.insert(part);
      for (const Part part : {Part::kNoun, Part::kVerb, Part::kAdjective})
        for (const auto& other : wordnet->Related(word, part))
          for (const auto& single : UnseenWords(other, {})) allowed.insert(single);
    }
  const std::set<std::string> function_words{
      "a",     "an",     "the",  "that",       "this",    "please", "could",    "can",      "would",    "you",
      "now",   "and",    "for",  "me",         "us",      "but",    "do",       "not",      "never",    "to",
      "of",    "on",     "at",   "in",         "it",      "while",  "without",  "any",      "anything", "all",
      "other", "others", "else", "everything", "another", "around", "touching", "avoiding", "objects"};
  for (const Command& command : AllCommands())
    for (const auto& word : TheGrammar().Words(command))
      EXPECT_TRUE(allowed.contains(word) || function_words.contains(word)) << word << ": " << Name(command);
}

TEST(Grammar, WordsAreThoseOfItsSentences) {
  Rng rng(31);
  for (const Command& command : AllCommands()) {
    const auto words = TheGrammar().Words(command);
    for (int i = 0; i < 60; ++i) {
      const std::string text = TheGrammar().Sample(command, i % 2 ? Style::kVaried : Style::kTemplate, rng);
      EXPECT_TRUE(UnseenWords(text, words).empty()) << text;
    }
  }
}

TEST(HeldOut, NamesTheWordsThatTrainingNeverSaw) {
  std::set<std::string> seen;
  for (const auto& task : kBasicTasks)
    for (const auto& object : kSix) seen.merge(TheGrammar().Words({task, object}));
  const auto unseen = [&](const std::string& text) { return UnseenWords(text, seen); };
  EXPECT_EQ(unseen("grab the loafs"), (std::vector<std::string>{"grab", "loafs"}));
  EXPECT_EQ(unseen("nudge that green bottle"), (std::vector<std::string>{"nudge"}));
  EXPECT_EQ(unseen("knock over the pastry"), (std::vector<std::string>{"knock", "over", "pastry"}));
  EXPECT_TRUE(unseen("lift the white box").empty());  // "lift": the second sense of "raise"
  EXPECT_EQ(HeldOutNounPhrases().size(), 50u);
  EXPECT_EQ(HeldOutNounPhrases()[0].object, "milk");
}

}  // namespace grammar_test
}  // namespace etude::language
