// SPDX-License-Identifier: Apache-2.0
// A task as data: its words, its stages out of a small set of typed primitives, where it may start and when it is done.
// Read from a YAML file; deploy/tasks has the built-in ones and a README with every key. What a primitive does is C++
// in worker/task/primitives, what a predicate means in worker/task/predicates.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "services/core/config.h"
#include "services/core/result.h"
#include "services/spec/predicate_spec.h"

namespace etude {

/// Where the target is brought: where the hand is, or at a side of the reference as the picture shows it.
enum class Whereto { kHere, kLeft, kRight, kFront, kBehind, kOnTop, kInside };

/// The hand comes to where it can reach for the target, or push it.
struct ApproachSpec {
  static constexpr std::string_view kName = "approach";
  std::string to = "grasp";  ///< grasp | push

  bool pushes() const { return to == "push"; }
  void Visit(auto& v) { v("to", to, "", "grasp | push"); }
};

/// The open fingers go round the target.
struct ReachSpec {
  static constexpr std::string_view kName = "reach";
  void Visit(auto&) {}
};

/// The fingers close until the target is held.
struct GraspSpec {
  static constexpr std::string_view kName = "grasp";
  int min_steps = 12;  ///< control steps at least,
  int max_steps = 80;  ///< and at most

  void Visit(auto& v) {
    v("min_steps", min_steps, "control steps", "at least");
    v("max_steps", max_steps, "control steps", "at most, until the target is held");
  }
};

/// Straight up with the target.
struct LiftSpec {
  static constexpr std::string_view kName = "lift";
  double room = 0.10;  ///< m under the target

  void Visit(auto& v) { v("room", room, "m", "under the lifted target"); }
};

/// The held target is turned over by 90 degrees.
struct TurnSpec {
  static constexpr std::string_view kName = "turn";
  double lean = 0;  ///< rad short of the quarter, for hands that come from above: room for the palm

  void Visit(auto& v) {
    v("lean", lean, "rad", "short of the quarter, for hands that come from above: room for the palm");
  }
};

/// The held target is brought above its place.
struct CarrySpec {
  static constexpr std::string_view kName = "carry";
  std::string to = "here";  ///< here | left | right | front | behind | on_top | inside
  double room = 0.19;       ///< m under the target, and over a reference that it goes on or into

  Whereto whereto() const;
  void Visit(auto& v) {
    v("to", to, "", "left | right | front | behind | on_top | inside, seen from the reference");
    v("room", room, "m", "under the target, and over a reference that it goes on or into");
  }
};

/// Closed fingers push the target away from the robot.
struct PushSpec {
  static constexpr std::string_view kName = "push";
  double distance = 0.11;  ///< m
  double least = 0.06;     ///< m, where something is in the way further on

  void Visit(auto& v) {
    v("distance", distance, "m", "that the target is pushed");
    v("least", least, "m", "the same where something is in the way further on");
  }
};

/// The held target goes straight down to its place.
struct PlaceSpec {
  static constexpr std::string_view kName = "place";
  std::string to = "here";  ///< as of carry
  double gap = 0.002;       ///< m between the target and what it is put on when it is released

  Whereto whereto() const;
  void Visit(auto& v) {
    v("to", to, "", "here | left | right | front | behind | on_top | inside: as of carry");
    v("gap", gap, "m", "between the target and what it is put on when it is released");
  }
};

/// The fingers open.
struct ReleaseSpec {
  static constexpr std::string_view kName = "release";
  int steps = 14;  ///< control steps

  void Visit(auto& v) { v("steps", steps, "control steps", "that the fingers get to open"); }
};

/// The open hand leaves.
struct RetreatSpec {
  static constexpr std::string_view kName = "retreat";
  std::string along = "up";  ///< up | approach: back the way it came
  double distance = 0.12;    ///< m, for hands that come from above

  bool back() const { return along == "approach"; }
  void Visit(auto& v) {
    v("along", along, "", "up | approach: back the way it came");
    v("distance", distance, "m", "that a hand from above leaves by");
  }
};

/// The hand stays where it is.
struct HoldSpec {
  static constexpr std::string_view kName = "hold";
  int steps = 20;  ///< control steps

  void Visit(auto& v) { v("steps", steps, "control steps", "that the hand stays"); }
};

using StageSpec = std::variant<ApproachSpec, ReachSpec, GraspSpec, LiftSpec, TurnSpec, CarrySpec, PushSpec, PlaceSpec,
                               ReleaseSpec, RetreatSpec, HoldSpec>;

/// "approach"
std::string_view NameOf(const StageSpec& stage);
/// All of them.
const std::vector<std::string>& PrimitiveNames();

/// The words of its sentences.
struct TaskWordsSpec {
  std::vector<std::string> verbs;   ///< "pick up"
  std::vector<std::string> places;  ///< with a reference: where the target goes, "to the left of"

  void Visit(auto& v) {
    v("verbs", verbs, "", "of its sentences: pick up");
    v("places", places, "", "with a reference: where the target goes, as to the left of");
  }
};

/// The second object that it is about.
struct ReferenceSpec {
  bool needed = false;
  std::vector<std::string> only;  ///< objects or classes that it may be; none: any but the target

  void Visit(auto& v) {
    v("needed", needed, "", "whether it is about a second object");
    v("only", only, "", "objects or classes that this may be; none: any but the target");
  }
};

/// The scenes in which it starts.
struct StartSpec {
  std::string boxes = "standard";               ///< standard | roomy: space before and behind every object
  std::optional<PredicateSpec> not_already;     ///< what must not hold at the start
  std::vector<std::vector<double>> keep_clear;  ///< m, x and y from the target: no obstacle stands there

  bool roomy() const { return boxes == "roomy"; }
};

struct TaskSpec {
  std::string name;     ///< plain name
  std::string summary;  ///< one sentence for people
  TaskWordsSpec words;
  ReferenceSpec reference;
  std::vector<std::string> avoid;  ///< variants besides the plain one: obstacle, others
  StartSpec start;
  std::vector<StageSpec> stages;
  PredicateSpec success;                 ///< done, strictly
  std::optional<PredicateSpec> latched;  ///< done once, as the paper's authors count; none: `success` once
  std::string sha256;                    ///< of its meaning: comments, order of keys, stages' defaults do not count

  bool Has(std::string_view primitive) const;
  /// Whether an object may be the reference of a target, as campaigns or as scenes name them.
  bool MayRefer(const std::string& target, const std::string& object) const;
  /// Whether the target is brought somewhere else through the air, so that the hand has to come from above.
  bool carries() const { return Has(CarrySpec::kName); }
};

/// @param origin  names the source in messages
/// @error kInvalidArgument: all that is wrong with it at once; unknown keys and primitives with the nearest known one
Result<TaskSpec> ParseTaskSpec(const OrderedJson& json, const std::string& origin);
/// @error kNotFound; as ParseTaskSpec
Result<TaskSpec> LoadTaskSpec(const Path& file);

}  // namespace etude
