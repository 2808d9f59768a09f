// SPDX-License-Identifier: Apache-2.0
// Names of the objects that a campaign may ask for. Strings only: what they look like is in worker/assets and
// worker/synthesis.
//   cube, coke, pepsi, milk, bread, bottle   the six of the tabletop
//   basketball                               the obstacle
//   apple_00 .. apple_09, mug_00 ..          generated: ten classes of ten instances, drawn from a fixed seed
//   open_box                                 with the programs as files: a folder in deploy/objects
//   distractor_apple_00                      a generated one that no sentence names; not for a campaign to ask for
//   distractor_ball_00 .. distractor_ball_23 a ball that no sentence names: the obstacle's shape in some colour
//   objects/duck, ./duck/object.yaml         imported: the folder that `etude object import` wrote
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "services/core/file.h"
#include "services/core/result.h"

namespace etude {

/// The instances of each generated class; the first kTrainInstances of them are for training, the others for tests.
inline constexpr int kInstancesPerClass = 10;
inline constexpr int kTrainInstances = 3;
inline constexpr int kBallColours = 24;

/// cube, coke, pepsi, milk, bread, bottle
const std::vector<std::string>& TabletopObjects();
/// apple, avocado, donut, hamburger, lemon, mug, orange, pear, sourdough, strawberry
const std::vector<std::string>& GeneratedClasses();

/// "apple_03" as its class and instance; nothing for any other name.
struct GeneratedName {
  std::string class_name;
  int instance = 0;
};
std::optional<GeneratedName> ParseGenerated(const std::string& name);
std::string GeneratedObject(const std::string& class_name, int instance);

/// train | test
std::string SplitOfInstance(int instance);

std::vector<std::string> TrainObjects();  ///< the 30 generated ones for training, class by class
std::vector<std::string> TestObjects();   ///< the 70 for tests
std::vector<std::string> GeneratedObjects();

/// True for a path to an imported object: it has a slash.
bool IsObjectPath(const std::string& name);

/// The folder that an object's path means: itself, or where its object.yaml is.
Path ObjectFolder(const Path& object);

/// The folder of an object that comes with the programs as files (FindShared("objects")); nothing for other names.
std::optional<Path> SharedObject(const std::string& name);

/// What a scene calls an object, a plain name: of a path the last folder, "duck"; else the name itself.
std::string SceneName(const std::string& name);
std::vector<std::string> SceneNames(const std::vector<std::string>& names);
/// What a sentence calls it: the class of a generated one, else its scene's name.
std::string ObjectNoun(const std::string& name);

/// "ball_07". @pre 0 <= colour < kBallColours
std::string BallName(int colour);
/// The colour of "ball_07", 7; nothing for any other name.
std::optional<int> ParseBall(const std::string& name);

/// A scene's name for a generated object or a ball that only stands there, "distractor_apple_00": by its name everyone
/// who meets it in a scene or an episode knows that no sentence is about it.
std::string DistractorName(const std::string& what);
bool IsDistractor(const std::string& name);
/// "apple_00" of "distractor_apple_00". @pre IsDistractor(name)
std::string WhatDistracts(const std::string& name);

/// Replaces "generated:train", "generated:test" and "generated:all" by the names they stand for, in place.
/// @error kInvalidArgument: another word after "generated:"
Result<std::vector<std::string>> ExpandObjects(const std::vector<std::string>& names);

/// @error kInvalidArgument: no such object; the message has the nearest known name. Paths pass: whether there is a
/// file is known where the scene is built.
Status CheckObjectName(const std::string& name);

}  // namespace etude
