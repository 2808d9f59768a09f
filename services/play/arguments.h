// SPDX-License-Identifier: Apache-2.0
// What the commands of a play session say beside their action (bus::PlayCommand::arguments_json).
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "services/core/config.h"
#include "services/core/result.h"

namespace etude::play {

/// An upright object: its origin (m, world), turned about the vertical (rad).
struct ObjectPlace {
  std::string name;
  double x = 0, y = 0, yaw = 0;

  void Visit(auto& v) {
    v("name", name, "", "as the scene calls it");
    v("x", x, "m", "of its origin, world");
    v("y", y, "m", "of its origin, world");
    v("yaw", yaw, "rad", "that it is turned about the vertical");
  }
};

/// PlayAction::kScene
struct SceneArguments {
  std::uint64_t index = 0;           ///< episode of the session's campaign
  std::vector<ObjectPlace> objects;  ///< that stand elsewhere than there
  bool keep = false;  ///< the scene as it is now, of which only `objects` are moved; `index` says nothing

  void Visit(auto& v) {
    v("index", index, "-", "episode of the session's campaign");
    v("objects", objects, "", "that stand elsewhere than there");
    v("keep", keep, "", "the scene as it is now, of which only the objects are moved");
  }
};

/// PlayAction::kSay
struct SayArguments {
  std::string sentence;
  std::string task, target, reference;  ///< what it means, for the judge; task "": not judged
  int max_steps = 0;                    ///< control steps; 0: the campaign's
  bool home = true;                     ///< the arm first comes back to where the scene began

  void Visit(auto& v) {
    v("sentence", sentence, "", "for the policy");
    v("task", task, "", "that it means; none: it is not judged");
    v("target", target, "", "object that it is about");
    v("reference", reference, "", "object beside which, of a relation");
    v("max_steps", max_steps, "steps of 8 ms", "until it counts as a failure; 0: the campaign's");
    v("home", home, "", "whether the arm first comes back to where the scene began");
  }
};

/// PlayAction::kNudge
struct NudgeArguments {
  std::string object;
  double dx = 0, dy = 0;

  void Visit(auto& v) {
    v("object", object, "", "to slide over the table");
    v("dx", dx, "m", "along x, world");
    v("dy", dy, "m", "along y, world");
  }
};

/// PlayAction::kHide and kShow
struct ObjectArguments {
  std::string object;

  void Visit(auto& v) { v("object", object, "", "as the scene calls it"); }
};

/// Arguments off the wire. @error kInvalidArgument: no JSON object, unknown keys, other types
template <class Arguments>
Result<Arguments> ReadArguments(const OrderedJson& json) {
  return FromJson<Arguments>(json, "play command");
}

}  // namespace etude::play
