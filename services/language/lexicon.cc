// SPDX-License-Identifier: Apache-2.0
#include "services/language/lexicon.h"

namespace etude::language {

const std::vector<ObjectWords>& ObjectLexicon() {
  // Table 9; the basketball's are ours
  static const std::vector<ObjectWords> lexicon{
      {"cube", {{"red", "maroon"}, {"object", "cube", "square"}}},
      {"coke", {{"red", "coke", "cocacola"}, {"can", "bottle"}}},
      {"pepsi", {{"blue", "pepsi", "pepsi coke"}, {"can", "bottle"}}},
      {"milk", {{"milk", "white"}, {"carton", "box"}}},
      {"bread", {{"bread", "yellow object", "brown object"}, {""}}},
      {"bottle", {{"green", "", "glass", "green glass"}, {"bottle"}}},
      {"basketball", {{"", "orange"}, {"ball", "basketball"}}},
  };
  return lexicon;
}

// The authors' code, but for what means something else beside the six ("bread" alone is the loaf, "red can" a
// coke): "sourdough" alone is in Table 8, so it is said with "bread".
const std::vector<ObjectWords>& ClassLexicon() {
  static const std::vector<ObjectWords> lexicon{
      {"apple", {{""}, {"apple"}}},
      {"avocado", {{"", "green"}, {"avocado"}}},
      {"orange", {{""}, {"orange", "mandarin"}}},
      {"donut", {{""}, {"donut"}}},
      {"sourdough", {{"sourdough"}, {"bread"}}},
      {"hamburger", {{"", "beef", "meat"}, {"hamburger", "burger"}}},
      {"strawberry", {{"", "red"}, {"strawberry"}}},
      {"mug", {{""}, {"mug", "cup"}}},
      {"lemon", {{"", "yellow"}, {"lemon"}}},
      {"pear", {{""}, {"pear"}}},
  };
  return lexicon;
}

const ObstacleWords& ObstacleLexicon() {
  static const ObstacleWords words{
      {"avoid"},
      {"without touching", "while avoiding"},
      "avoid",
      "touch",
      {"everything else", "all other objects", "all the other objects", "all the others", "everything around it"},
      {"anything else", "any other object", "any of the others", "another object", "anything around it"}};
  return words;
}

}  // namespace etude::language
