// SPDX-License-Identifier: Apache-2.0
// A label is an entity x a quantity, "target.position". Entities and where they are belong here; how a quantity turns
// that into numbers is a LabelRule, of which trainer/policy/quantities has one for each quantity.
//
// S sentences an image; target, reference, obstacle, others and command depend on the sentence: (B, S, ...), the rest
// (B, 1, ...). `others` are a set: (B, S, kMaxOthers, ...), of which as many are valid as there are.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "services/codec/crop.h"
#include "services/episode/episode.h"
#include "services/language/grammar.h"

namespace etude::data {

using codec::Region;

/// Objects of a scene that `others` can hold.
inline constexpr int kMaxOthers = 8;

/// What a label is about.
struct Entity {
  enum class Kind {
    kTarget,     ///< what the sentence's verb is about
    kReference,  ///< "... to the left of B"
    kObstacle,   ///< what the sentence says to keep away from
    kOthers,     ///< every object but the target
    kEe,         ///< the end-effector
    kObject,     ///< "object:coke": that one, whatever the sentence says
    kCommand,    ///< no thing: what the sentence says to do
  };
  Kind kind = Kind::kTarget;
  std::string object;  ///< kObject

  bool per_sentence() const { return kind != Kind::kEe && kind != Kind::kObject; }
  bool is_set() const { return kind == Kind::kOthers; }
  bool is_thing() const { return kind != Kind::kOthers && kind != Kind::kCommand; }  ///< one, with a place
};

/// "target", "reference", "obstacle", "others", "ee", "command", "object:NAME". Nothing for another text.
std::optional<Entity> ParseEntity(std::string_view text);
/// For messages.
const std::vector<std::string>& EntityNames();

/// One thing of a picture at its control step. Spans are into the episode.
struct EntityState {
  std::string_view name;         ///< the object's; the task's of a command, which has nothing else; "" of the hand
  std::span<const float> p;      ///< (3) m, world
  std::span<const float> q;      ///< (4) w, x, y, z
  std::span<const float> pixel;  ///< (2) px in the camera's picture; NaN behind the camera

  bool finite() const;
};

/// What labels are computed from.
struct LabelContext {
  const Episode& episode;
  int step = 0;                             ///< control step, in [0, episode.steps())
  const language::Command& command;         ///< what the sentence means
  const std::vector<std::string>& classes;  ///< nouns that the policy's class heads know
  Region view;                              ///< what the policy sees of the camera's picture
  std::span<const std::string> tasks{};     ///< that its task heads know
};

/// One state; several (at most kMaxOthers) of a set; none where the scene or the sentence has no such thing.
std::vector<EntityState> StatesOf(const Entity& entity, const LabelContext& context);
EntityState HandState(const Episode& episode, int step);

/// How a quantity is read off an entity. Thread-safe.
class LabelRule {
 public:
  virtual ~LabelRule() = default;
  /// Of one label: {2}, {12, 10}; {} is one number.
  virtual std::vector<std::int64_t> label_shape() const = 0;
  /// Parts of a label that are masked on their own (waypoints); 1: the whole.
  virtual int label_parts() const { return 1; }
  /// `values` and `valid` (one byte a part) come zeroed; what is not valid stays so.
  virtual void FillLabel(const LabelContext& context, const EntityState& state, std::span<float> values,
                         std::span<std::uint8_t> valid) const = 0;
};

/// One label of a batch.
struct LabelColumn {
  std::string name;  ///< "target.position", the key in Batch::labels
  Entity entity;
  const LabelRule* rule = nullptr;
};

}  // namespace etude::data
