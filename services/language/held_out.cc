// SPDX-License-Identifier: Apache-2.0
#include "services/language/held_out.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <iterator>
#include <sstream>
#include <utility>

#include "services/spec/object_names.h"

namespace etude::language {

const std::vector<HeldOutPhrase>& HeldOutNounPhrases() {
  // Table 8: five objects, ten phrases each
  static const std::vector<HeldOutPhrase> phrases = [] {
    const std::vector<std::pair<const char*, std::vector<const char*>>> table{
        {"milk",
         {"skimmed milk package", "goat milk carton", "milk case", "white packet", "milk parcel", "cream carton",
          "cream package", "heavy milk carton", "almond milk box", "goat milk packs"}},
        {"bottle",
         {"soda", "perrier", "tonic", "flask", "pitcher", "container", "decanter", "vial", "vessel", "cruet"}},
        {"coke",
         {"coke zero", "round container", "can", "coca cola", "red soda", "cola", "metal container", "small soft drink",
          "fizzy drink", "diet coke"}},
        {"cube",
         {"brick", "block", "cuboid", "bar", "solid lump", "rectangular object", "solid piece", "slab",
          "cuboidal slice", "square object"}},
        {"bread",
         {"cinnamon roll", "sourdough", "brown bread", "loaf", "naan", "rye bread", "toast", "gluten free food",
          "light bread", "food"}}};
    std::vector<HeldOutPhrase> list;
    for (const auto& [object, texts] : table)
      for (const char* text : texts) list.push_back({text, object});
    return list;
  }();
  return phrases;
}

const std::vector<HeldOutSentence>& HeldOutSentences() {
  // Table 11; what is meant is our reading
  static const std::vector<HeldOutSentence> sentences{
      {"grab the loafs", "pick", "bread"},
      {"put down the lime soda", "put_down", "bottle"},
      {"lay down the red block", "put_down", "cube"},
      {"tip over the azure can", "put_down", "pepsi"},
      {"lift the white carton", "pick", "milk"},
      {"knock over the pastry", "put_down", "bread"},
      {"lift the coke can", "pick", "coke"},
      {"put down the sprite", "put_down", "bottle"},
      {"grab the pepsi", "pick", "pepsi"},
      {"elevate the red cube", "pick", "cube"},
      {"pick up the red cube", "pick", "cube"},
      {"lift up the blue cylinder", "pick", "pepsi"},
      {"move away the brown object", "push", "bread"},
      {"push away the white object", "push", "milk"},
      {"lift the blue object", "pick", "pepsi"},
      {"put down the green sprite", "put_down", "bottle"},
      {"push the green sprite", "push", "bottle"},
      {"push the reddish can", "push", "coke"},
      {"pick up the milk container", "pick", "milk"},
      {"hold up the milk carton", "pick", "milk"},
      {"please pick up the green thing", "pick", "bottle"},
      {"lift the red colored coke can", "pick", "coke"},
      {"push the yellow bread", "push", "bread"},
      {"grab the blue colored can", "pick", "pepsi"},
      {"nudge that green bottle", "push", "bottle"},
      {"put down the red colored cuboid", "put_down", "cube"},
      {"lift the white box", "pick", "milk"},
      {"take the pepsi off the table", "pick", "pepsi"},
      {"push the green object forward", "push", "bottle"},
      {"put down the zero coke on the desk", "put_down", "coke"},
  };
  return sentences;
}

namespace {

// the next object that a sentence can tell from the one at `i`
const std::string& NextOther(const std::vector<std::string>& objects, std::size_t i) {
  for (std::size_t k = 1; k < objects.size(); ++k)
    if (const auto& object = objects[(i + k) % objects.size()]; ObjectNoun(object) != ObjectNoun(objects[i]))
      return object;
  return objects[i];
}

}  // namespace

Result<std::set<std::string>> SeenWords(const Grammar& grammar, const std::vector<std::string>& tasks,
                                        const std::vector<std::string>& objects) {
  std::set<std::string> seen;
  for (const auto& name : tasks) {
    ETUDE_ASSIGN_OR_RETURN(const TaskName task, ParseTask(name));
    for (std::size_t i = 0; i < objects.size(); ++i) {
      const auto command = CommandFor(task, objects[i], task.relation() ? NextOther(objects, i) : "");
      ETUDE_RETURN_IF_ERROR(grammar.Check(command));
      seen.merge(grammar.Words(command));
    }
  }
  return seen;
}

Result<std::set<std::string>> ClauseWords(const Grammar& grammar, const std::vector<std::string>& tasks,
                                          const std::vector<std::string>& objects) {
  std::set<std::string> words;
  const auto say = [&](const Command& command) -> Status {
    for (const auto& other : {command.reference, command.obstacle})
      if (!other.empty() && ObjectNoun(other) == ObjectNoun(command.target)) return {};  // no sentence tells them apart
    ETUDE_RETURN_IF_ERROR(grammar.Check(command));
    words.merge(grammar.Words(command));
    return {};
  };
  bool plain = false;  // whether any sentence is without a clause of its own
  for (const auto& name : tasks) {
    ETUDE_ASSIGN_OR_RETURN(const TaskName task, ParseTask(name));
    if (task.relation() || !task.avoid.empty() || objects.empty()) continue;
    plain = true;
    for (std::size_t i = 0; i < objects.size(); ++i)
      ETUDE_RETURN_IF_ERROR(say({task.base, NextOther(objects, i), "", objects[i]}));
    for (const char* avoided : {kObstacleObject, kEverythingElse})
      ETUDE_RETURN_IF_ERROR(say({task.base, objects.front(), "", avoided}));
    break;  // what is kept off is said alike of every task
  }
  for (const auto& name : grammar.tasks()) {
    ETUDE_ASSIGN_OR_RETURN(const TaskName task, ParseTask(name));
    for (std::size_t i = 0; i < objects.size() && plain && task.relation(); ++i)
      ETUDE_RETURN_IF_ERROR(say({task.base, objects[i], NextOther(objects, i), ""}));
  }
  return words;
}

std::string WordsText(const std::set<std::string>& words) { return fmt::format("{}", fmt::join(words, " ")); }

std::set<std::string> WordsIn(const std::string& text) {
  std::istringstream words(text);
  return {std::istream_iterator<std::string>(words), std::istream_iterator<std::string>()};
}

std::vector<std::string> UnseenWords(const std::string& text, const std::set<std::string>& seen) {
  std::vector<std::string> unseen;
  std::istringstream words(text);
  for (std::string word; words >> word;)
    if (!seen.contains(word)) unseen.push_back(word);
  return unseen;
}

}  // namespace etude::language
