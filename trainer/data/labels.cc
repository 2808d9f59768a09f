// SPDX-License-Identifier: Apache-2.0
#include "trainer/data/labels.h"

#include <algorithm>
#include <cmath>

#include "services/spec/object_names.h"

namespace etude::data {
namespace {

constexpr std::string_view kObjectPrefix = "object:";

EntityState StateOf(const ObjectTrack& object, int step) {
  const auto pose = object.pose.row(step);
  return {object.name, pose.first(3), pose.subspan(3), object.pixel.row(step)};
}

// by its name, or by its noun when a generated object is meant whatever its number
const ObjectTrack* FindObject(const Episode& episode, const std::string& name) {
  if (name.empty()) return nullptr;
  if (const ObjectTrack* exact = episode.FindObject(name)) return exact;
  const auto found = std::find_if(episode.objects.begin(), episode.objects.end(),
                                  [&](const ObjectTrack& object) { return ObjectNoun(object.name) == name; });
  return found == episode.objects.end() ? nullptr : &*found;
}

}  // namespace

std::optional<Entity> ParseEntity(std::string_view text) {
  using Kind = Entity::Kind;
  if (text.starts_with(kObjectPrefix) && text.size() > kObjectPrefix.size())
    return Entity{Kind::kObject, std::string(text.substr(kObjectPrefix.size()))};
  constexpr std::pair<std::string_view, Kind> kKinds[] = {{"target", Kind::kTarget},
                                                          {"reference", Kind::kReference},
                                                          {"obstacle", Kind::kObstacle},
                                                          {"others", Kind::kOthers},
                                                          {"ee", Kind::kEe},
                                                          {"command", Kind::kCommand}};
  for (const auto& [name, kind] : kKinds)
    if (text == name) return Entity{kind, {}};
  return std::nullopt;
}

const std::vector<std::string>& EntityNames() {
  static const std::vector<std::string> names{"target", "reference", "obstacle",   "others",
                                              "ee",     "command",   "object:NAME"};
  return names;
}

bool EntityState::finite() const {
  const auto good = [](float x) { return std::isfinite(x); };
  return std::all_of(p.begin(), p.end(), good) && std::all_of(q.begin(), q.end(), good);
}

EntityState HandState(const Episode& episode, int step) {
  return {"", episode.eef_pos.row(step), episode.eef_quat.row(step), episode.eef_pixel.row(step)};
}

std::vector<EntityState> StatesOf(const Entity& entity, const LabelContext& context) {
  const Episode& episode = context.episode;
  const auto one = [&](const std::string& name) {
    const ObjectTrack* object = FindObject(episode, name);
    return object ? std::vector{StateOf(*object, context.step)} : std::vector<EntityState>{};
  };
  switch (entity.kind) {
    case Entity::Kind::kTarget:
      return one(context.command.target);
    case Entity::Kind::kReference:
      return one(context.command.reference);
    case Entity::Kind::kObstacle:
      return one(context.command.obstacle);
    case Entity::Kind::kObject:
      return one(entity.object);
    case Entity::Kind::kEe:
      return {HandState(episode, context.step)};
    case Entity::Kind::kCommand:
      return {{context.command.task, {}, {}, {}}};
    case Entity::Kind::kOthers:
      break;
  }
  std::vector<EntityState> others;
  for (const auto& object : episode.objects)
    if (object.name != context.command.target && others.size() < kMaxOthers)
      others.push_back(StateOf(object, context.step));
  return others;
}

}  // namespace etude::data
