// SPDX-License-Identifier: Apache-2.0
#include "services/language/lexicon.h"

namespace etude::language {

// Senses of WordNet 3.0, by file offset.
namespace sense {
constexpr SynsetRef kLift{"verb", 1974080, "lift"};       // raise, lift, elevate, bring up
constexpr SynsetRef kPickUp{"verb", 1976107, "pick_up"};  // pick up, lift up, gather up
constexpr SynsetRef kTakeHold{"verb", 1439208, "take_hold_of"};
constexpr SynsetRef kSeize{"verb", 1212590, "seize"};  // seize, clutch
constexpr SynsetRef kPush{"verb", 1871997, "push"};
constexpr SynsetRef kShove{"verb", 1584719, "shove"};
constexpr SynsetRef kProd{"verb", 1231270, "nudge"};        // nudge, prod
constexpr SynsetRef kMove{"verb", 1850333, "move"};         // move, displace
constexpr SynsetRef kSetDown{"verb", 1500390, "set_down"};  // set down, put down, place down
constexpr SynsetRef kOverturn{"verb", 1909996, "overturn"};
constexpr SynsetRef kRotate{"verb", 2045808, "rotate"};
constexpr SynsetRef kRevolve{"verb", 2045061, "revolve"};
constexpr SynsetRef kSpin{"verb", 2048069, "spin"};  // whirl, spin, twirl
constexpr SynsetRef kSwivel{"verb", 2046590, "swivel"};
constexpr SynsetRef kPut{"verb", 1494328, "put"};  // put, set, place, position
constexpr SynsetRef kAvoid{"verb", 811393, "avoid"};
constexpr SynsetRef kShun{"verb", 812167, "shun"};  // shun, eschew
constexpr SynsetRef kKeepOff{"verb", 811738, "keep_off"};
constexpr SynsetRef kTouch{"verb", 1205714, "touch"};    // touch, contact
constexpr SynsetRef kDisturb{"verb", 1207545, "touch"};  // touch, disturb
constexpr SynsetRef kRed{"adj", 381097, "red"};
constexpr SynsetRef kMaroon{"adj", 377702, "maroon"};
constexpr SynsetRef kBlue{"adj", 370869, "blue"};
constexpr SynsetRef kGreen{"adj", 375969, "green"};
constexpr SynsetRef kBrown{"adj", 372111, "brown"};
constexpr SynsetRef kTan{"adj", 384533, "tan"};
constexpr SynsetRef kYellow{"adj", 385756, "yellow"};
constexpr SynsetRef kWhite{"adj", 393105, "white"};
constexpr SynsetRef kOrangeColour{"adj", 378892, "orange"};  // orange, orangish
constexpr SynsetRef kRound{"adj", 2040653, "round"};         // round, circular
constexpr SynsetRef kCan{"noun", 2946921, "can"};            // can, tin, tin can
constexpr SynsetRef kBottle{"noun", 2876657, "bottle"};
constexpr SynsetRef kCarton{"noun", 2971356, "carton"};
constexpr SynsetRef kBox{"noun", 2883344, "box"};
constexpr SynsetRef kBlock{"noun", 13914608, "cube"};         // block, cube
constexpr SynsetRef kSquareBlock{"noun", 3144592, "cube"};    // cube, square block
constexpr SynsetRef kCube{"noun", 13916721, "cube"};          // cube, regular hexahedron
constexpr SynsetRef kLoaf{"noun", 7683786, "loaf_of_bread"};  // loaf of bread, loaf
constexpr SynsetRef kBread{"noun", 7679356, "bread"};         // bread, breadstuff
constexpr SynsetRef kBall{"noun", 2779435, "ball"};
constexpr SynsetRef kBasketball{"noun", 2802426, "basketball"};
constexpr SynsetRef kApple{"noun", 7739125, "apple"};
constexpr SynsetRef kAvocado{"noun", 7764847, "avocado"};  // avocado, aguacate
constexpr SynsetRef kOrange{"noun", 7747607, "orange"};
constexpr SynsetRef kMandarin{"noun", 7747951, "mandarin"};    // mandarin, mandarin orange
constexpr SynsetRef kDoughnut{"noun", 7639069, "doughnut"};    // doughnut, donut
constexpr SynsetRef kHamburger{"noun", 7697100, "hamburger"};  // hamburger, beefburger, burger
constexpr SynsetRef kStrawberry{"noun", 7745940, "strawberry"};
constexpr SynsetRef kMug{"noun", 3797390, "mug"};
constexpr SynsetRef kCup{"noun", 3147509, "cup"};
constexpr SynsetRef kCoffeeMug{"noun", 3063599, "coffee_mug"};
constexpr SynsetRef kCoffeeCup{"noun", 3063073, "coffee_cup"};
constexpr SynsetRef kTeacup{"noun", 4397452, "teacup"};
constexpr SynsetRef kLemon{"noun", 7749582, "lemon"};
constexpr SynsetRef kPear{"noun", 7767847, "pear"};
}  // namespace sense

const std::vector<ObjectWords>& ObjectLexicon() {
  static const std::vector<ObjectWords> lexicon{
      {"cube",
       {{"red", "maroon"}, {"object", "cube", "square"}},
       {{"red", "maroon", "cherry colored", "dark red", "bright red", "red colored"},
        {"object", "cube", "square", "box shape"}},
       {sense::kRed, sense::kMaroon},
       {sense::kBlock, sense::kSquareBlock, sense::kCube}},
      {"coke",
       {{"red", "coke", "cocacola"}, {"can", "bottle"}},
       {{"red", "coke", "cocacola", "red coke", "coca", "red colored"}, {"can", "bottle", "drink can", "soda can"}},
       {sense::kRed},
       {sense::kCan}},
      {"pepsi",
       {{"blue", "pepsi", "pepsi coke"}, {"can", "bottle"}},
       {{"blue", "pepsi", "pepsi coke", "pepsi cola", "blue pepsi", "navy", "blue colored"},
        {"can", "bottle", "drink can", "soda can"}},
       {sense::kBlue},
       {sense::kCan}},
      {"milk",
       {{"milk", "white"}, {"carton", "box"}},
       {{"milk", "white", "white milk", "whitish", "white colored", "dairy"}, {"carton", "box", "container", "pack"}},
       {sense::kWhite},
       {sense::kCarton, sense::kBox}},
      {"bread",
       {{"bread", "yellow object", "brown object"}, {""}},
       {{"", "brown", "yellow", "baked", "brown colored", "yellow colored"}, {"piece of bread", "bread loaf"}},
       {sense::kBrown, sense::kYellow, sense::kTan},
       {sense::kLoaf, sense::kBread}},
      {"bottle",
       {{"green", "", "glass", "green glass"}, {"bottle"}},
       {{"green", "", "glass", "green glass", "green colored", "emerald", "tall green"},
        {"bottle", "beer bottle", "wine bottle"}},
       {sense::kGreen},
       {sense::kBottle}},
      {"basketball",
       {{"", "orange"}, {"ball", "basketball"}},
       {{"", "orange", "big orange", "orange colored"}, {"ball", "basketball", "basket ball"}},
       {sense::kOrangeColour, sense::kRound},
       {sense::kBall, sense::kBasketball}},
  };
  return lexicon;
}

// An adjective must fit every instance: of apples, donuts, hamburgers, mugs and pears there are several
// colours. "sourdough" alone is in Table 8, "bread" alone is the loaf among the six.
const std::vector<ObjectWords>& ClassLexicon() {
  static const std::vector<ObjectWords> lexicon{
      {"apple", {{""}, {"apple"}}, {{""}, {"apple", "apple fruit"}}, {}, {sense::kApple}},
      {"avocado", {{"", "green"}, {"avocado"}}, {{"", "green"}, {"avocado"}}, {sense::kGreen}, {sense::kAvocado}},
      {"orange",
       {{""}, {"orange", "mandarin"}},
       {{""}, {"orange fruit", "tangerine"}},
       {},
       {sense::kOrange, sense::kMandarin}},
      {"donut", {{""}, {"donut"}}, {{""}, {"donut", "ring donut"}}, {}, {sense::kDoughnut}},
      {"sourdough",
       {{"sourdough"}, {"bread", "loaf"}},
       {{"sourdough", "sour dough", "round sourdough", "crusty sourdough"}, {}},
       {},
       {sense::kBread, sense::kLoaf}},
      {"hamburger",
       {{"", "beef", "meat"}, {"hamburger", "burger"}},
       {{"", "beef", "meat"}, {"hamburger", "burger"}},
       {},
       {sense::kHamburger}},
      {"strawberry",
       {{"", "red"}, {"strawberry"}},
       {{"", "red", "bright red"}, {"strawberry"}},
       {sense::kRed},
       {sense::kStrawberry}},
      {"mug",
       {{""}, {"mug", "cup"}},
       {{""}, {"drinking mug"}},
       {},
       {sense::kMug, sense::kCup, sense::kCoffeeMug, sense::kCoffeeCup, sense::kTeacup}},
      {"lemon",
       {{"", "yellow"}, {"lemon"}},
       {{"", "yellow", "bright yellow"}, {"lemon", "lemon fruit"}},
       {sense::kYellow},
       {sense::kLemon}},
      {"pear", {{""}, {"pear"}}, {{""}, {"pear", "pear fruit"}}, {}, {sense::kPear}},
  };
  return lexicon;
}

const std::vector<TaskWords>& TaskLexicon() {
  static const std::vector<TaskWords> lexicon{
      {"pick",
       {"pick", "pick up", "raise", "hold"},
       {"grab", "grasp", "take", "fetch", "lift", "get hold of", "hold up"},
       {sense::kLift, sense::kPickUp, sense::kTakeHold, sense::kSeize}},
      {"push",
       {"push", "move"},
       {"nudge", "push away", "move away", "push forward", "slide"},
       {sense::kPush, sense::kShove, sense::kProd, sense::kMove}},
      {"put_down",
       {"put down", "place down"},
       {"lay down", "tip over", "knock over", "turn over", "lay", "flip over"},
       {sense::kSetDown, sense::kOverturn}},
      {"rotate",
       {"rotate", "revolve", "spin"},
       {"turn around", "spin around", "swivel around"},
       {sense::kRotate, sense::kRevolve, sense::kSpin, sense::kSwivel}},
  };
  return lexicon;
}

const TaskWords& PlacingLexicon() {
  static const TaskWords words{
      "place", {"put", "place", "move", "get"}, {"set", "bring", "position"}, {sense::kPut, sense::kMove}};
  return words;
}

const std::vector<RelationWords>& RelationLexicon() {
  static const std::vector<RelationWords> lexicon{
      {"place_left",
       {"to the left of", "left to"},
       {"left of", "on the left of", "on the left side of", "to the left side of", "at the left of"}},
      {"place_right",
       {"to the right of", "right to"},
       {"right of", "on the right of", "on the right side of", "to the right side of", "at the right of"}},
      {"place_front",
       {"in front of", "to the front of"},
       {"at the front of", "on the front side of", "to the front side of"}},
      {"place_behind",
       {"behind", "to the back of"},
       {"in back of", "at the back of", "to the rear of", "at the rear of", "on the back side of"}},
  };
  return lexicon;
}

const ObstacleWords& ObstacleLexicon() {
  static const ObstacleWords words{
      {"avoid"},
      {"without touching", "while avoiding"},
      {"keep clear of", "keep away from", "stay clear of", "stay away from", "steer clear of", "look out for"},
      {"without hitting", "without bumping into", "but do not hit", "and avoid", "but avoid", "and keep clear of",
       "but keep away from", "and stay clear of", "while staying away from", "while keeping clear of"},
      {"everything else", "all other objects", "all the other objects", "all the others", "everything around it"},
      {"anything else", "any other object", "any of the others", "another object", "anything around it"},
      {sense::kAvoid, sense::kShun, sense::kKeepOff},
      {sense::kTouch, sense::kDisturb}};
  return words;
}

const std::vector<std::string>& UnusedLemmas() {
  static const std::vector<std::string> lemmas{
      "get up",   "bring up",  "catch",          "prehend",      "force",        "poke at",
      "upset",    "bowl over", "tump over",      "circumvolve",  "go around",    "birl",
      "pose",     "lay",       "adjoin",         "meet",         "brownish red", "staff of life",
      "xanthous", "circular",  "alligator pear", "avocado pear", "sinker",       "regular hexahedron"};
  return lemmas;
}

}  // namespace etude::language
