// SPDX-License-Identifier: Apache-2.0
#include "services/language/lexicon.h"

namespace etude::language {

// Senses of WordNet 3.0, by file offset.
namespace sense {
constexpr SynsetRef kLift{"verb", 1974080, "lift"};       // raise, lift, elevate, get up, bring up
constexpr SynsetRef kPickUp{"verb", 1976107, "pick_up"};  // pick up, lift up, gather up
constexpr SynsetRef kPush{"verb", 1871997, "push"};       // push, force
constexpr SynsetRef kShove{"verb", 1584719, "shove"};
constexpr SynsetRef kMove{"verb", 1850333, "move"};         // move, displace
constexpr SynsetRef kSetDown{"verb", 1500390, "set_down"};  // set down, put down, place down
constexpr SynsetRef kRed{"adj", 381097, "red"};
constexpr SynsetRef kMaroon{"adj", 377702, "maroon"};
constexpr SynsetRef kBlue{"adj", 370869, "blue"};
constexpr SynsetRef kGreen{"adj", 375969, "green"};
constexpr SynsetRef kBrown{"adj", 372111, "brown"};
constexpr SynsetRef kYellow{"adj", 385756, "yellow"};
constexpr SynsetRef kCan{"noun", 2946921, "can"};  // can, tin, tin can
constexpr SynsetRef kBottle{"noun", 2876657, "bottle"};
constexpr SynsetRef kCarton{"noun", 2971356, "carton"};
constexpr SynsetRef kBox{"noun", 2883344, "box"};
constexpr SynsetRef kBlock{"noun", 13914608, "cube"};         // block, cube
constexpr SynsetRef kCube{"noun", 13916721, "cube"};          // cube, regular hexahedron
constexpr SynsetRef kLoaf{"noun", 7683786, "loaf_of_bread"};  // loaf of bread, loaf
constexpr SynsetRef kBread{"noun", 7679356, "bread"};         // bread, breadstuff, staff of life
}  // namespace sense

const std::vector<ObjectWords>& ObjectLexicon() {
  static const std::vector<ObjectWords> lexicon{
      {"cube",
       {{"red", "maroon"}, {"object", "cube", "square"}},
       {"cherry colored", "dark red", "bright red", "red colored"},
       {"box shape"},
       {sense::kRed, sense::kMaroon},
       {sense::kBlock, sense::kCube}},
      {"coke",
       {{"red", "coke", "cocacola"}, {"can", "bottle"}},
       {"red coke", "coca", "red colored"},
       {"drink can", "soda can"},
       {sense::kRed},
       {sense::kCan}},
      {"pepsi",
       {{"blue", "pepsi", "pepsi coke"}, {"can", "bottle"}},
       {"pepsi cola", "blue pepsi", "navy", "blue colored"},
       {"drink can", "soda can"},
       {sense::kBlue},
       {sense::kCan}},
      {"milk",
       {{"milk", "white"}, {"carton", "box"}},
       {"white milk", "whitish", "white colored", "dairy"},
       {"container", "pack"},
       {},
       {sense::kCarton, sense::kBox}},
      {"bread",
       {{"bread", "yellow object", "brown object"}, {""}},
       {"brown", "yellow", "baked", "tan"},
       {"piece of bread"},
       {sense::kBrown, sense::kYellow},
       {sense::kLoaf, sense::kBread}},
      {"bottle",
       {{"green", "", "glass", "green glass"}, {"bottle"}},
       {"green colored", "emerald", "tall green"},
       {"glass", "beer bottle", "wine bottle"},
       {sense::kGreen},
       {sense::kBottle}},
  };
  return lexicon;
}

const std::vector<TaskWords>& TaskLexicon() {
  static const std::vector<TaskWords> lexicon{
      {"pick",
       {"pick", "pick up", "raise", "hold"},
       {"grab", "grasp", "take", "fetch", "lift", "get hold of", "hold up"},
       {sense::kLift, sense::kPickUp}},
      {"push",
       {"push", "move"},
       {"nudge", "push away", "move away", "push forward", "slide"},
       {sense::kPush, sense::kShove, sense::kMove}},
      {"put_down",
       {"put down", "place down"},
       {"lay down", "tip over", "knock over", "turn over", "lay", "flip over"},
       {sense::kSetDown}},
  };
  return lexicon;
}

const std::vector<std::string>& HeldOutNounPhrases() {
  // Table 8: five objects, ten phrases each
  static const std::vector<std::string> phrases{"skimmed milk package",
                                                "goat milk carton",
                                                "milk case",
                                                "white packet",
                                                "milk parcel",
                                                "cream carton",
                                                "cream package",
                                                "heavy milk carton",
                                                "almond milk box",
                                                "goat milk packs",
                                                "soda",
                                                "perrier",
                                                "tonic",
                                                "flask",
                                                "pitcher",
                                                "container",
                                                "decanter",
                                                "vial",
                                                "vessel",
                                                "cruet",
                                                "coke zero",
                                                "round container",
                                                "can",
                                                "coca cola",
                                                "red soda",
                                                "cola",
                                                "metal container",
                                                "small soft drink",
                                                "fizzy drink",
                                                "diet coke",
                                                "brick",
                                                "block",
                                                "cuboid",
                                                "bar",
                                                "solid lump",
                                                "rectangular object",
                                                "solid piece",
                                                "slab",
                                                "cuboidal slice",
                                                "square object",
                                                "cinnamon roll",
                                                "sourdough",
                                                "brown bread",
                                                "loaf",
                                                "naan",
                                                "rye bread",
                                                "toast",
                                                "gluten free food",
                                                "light bread",
                                                "food"};
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

}  // namespace etude::language
