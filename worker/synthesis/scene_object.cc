// SPDX-License-Identifier: Apache-2.0
#include "worker/synthesis/scene_object.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "services/core/config.h"
#include "services/core/thread_annotations.h"
#include "services/spec/object_names.h"
#include "worker/synthesis/drawn_object.h"
#include "worker/synthesis/object_folder.h"

namespace etude::synthesis {
namespace {

/// Drawn objects, each made once a process.
Result<assets::ObjectModel> Drawn(const std::string& name, const GeneratedName& generated) {
  static Mutex mutex;
  static std::map<std::string, assets::ObjectModel> made ETUDE_GUARDED_BY(mutex);
  const MutexLock lock(mutex);
  if (const auto found = made.find(name); found != made.end()) return found->second;
  ETUDE_ASSIGN_OR_RETURN(const SolidObject object, DrawObject(generated.class_name, generated.instance, kObjectSeed));
  return made.emplace(name, ToSceneObject(object, name)).first->second;
}

Status CheckFacts(const ObjectFacts& facts, const Path& folder) {
  const auto is_finite = [](const std::vector<double>& values) {
    return std::all_of(values.begin(), values.end(), [](double value) { return std::isfinite(value); });
  };
  const bool has_sizes = facts.extent_m.size() == 3 && facts.centre_m.size() == 3 && facts.inertia.size() == 6 &&
                         is_finite(facts.extent_m) && is_finite(facts.centre_m) && is_finite(facts.inertia) &&
                         is_finite(facts.foot_m);
  if (has_sizes && facts.mass_kg > 0 && facts.rest_height_m > 0 && facts.pieces > 0 && facts.pieces <= 64) return {};
  return Fail(Code::kInvalidArgument,
              fmt::format("'{}/object.yaml': needs extent_m, centre_m and inertia, mass_kg and rest_height_m above 0, "
                          "and 1 to 64 pieces",
                          folder.string()));
}

/// The folder's files as they are: MuJoCo reads .obj and .png itself.
Result<assets::ObjectModel> Imported(const std::string& name) {
  const Path folder = ObjectFolder(name);
  ETUDE_ASSIGN_OR_RETURN(const ObjectFacts facts, ReadObjectFacts(folder));
  ETUDE_RETURN_IF_ERROR(CheckFacts(facts, folder));
  assets::ObjectModel model;
  model.name = SceneName(name);
  if (!IsPlainName(model.name))
    return Fail(Code::kInvalidArgument,
                fmt::format("object '{}': its folder's name must be made of a-z, 0-9, _ and -, at most 64", name));
  model.half_extent = Eigen::Vector3d::Map(facts.extent_m.data()) / 2;
  model.rest_height = facts.rest_height_m;
  model.mass = facts.mass_kg;
  // apart from the names of the built-in ones
  const std::string stem = "imported_" + model.name;
  model.materials = fmt::format("<material name=\"{0}\" texture=\"{0}\" specular=\"0.2\" shininess=\"0.2\"/>\n", stem);
  model.geoms = BodyElements(facts, {.stem = stem, .material = stem});
  const auto add = [&](const std::string& file, const std::string& as) -> Status {
    ETUDE_ASSIGN_OR_RETURN(auto bytes, ReadBinaryFile(folder / file, kLargestObjectFile));
    if (bytes.empty()) return Fail(Code::kCorrupt, fmt::format("{} is empty", (folder / file).string()));
    model.files.push_back({as, std::move(bytes)});
    return {};
  };
  ETUDE_RETURN_IF_ERROR(add("texture.png", stem + ".png"));
  ETUDE_RETURN_IF_ERROR(add("visual.obj", stem + "_visual.obj"));
  for (int i = 0; i < facts.pieces; ++i)
    ETUDE_RETURN_IF_ERROR(add(fmt::format("collision_{}.obj", i), fmt::format("{}_{}.obj", stem, i)));
  return model;
}

}  // namespace

Result<ObjectFacts> ReadObjectFacts(const Path& path) {
  return LoadConfig<ObjectFacts>(ObjectFolder(path) / "object.yaml");
}

Result<assets::ObjectModel> MakeSceneObject(const std::string& name) {
  if (IsDistractor(name)) {
    const std::string what = WhatDistracts(name);
    if (const auto colour = ParseBall(what)) return assets::MakeBall(name, assets::BallColour(*colour));
    return Drawn(name, *ParseGenerated(what));
  }
  if (const auto generated = ParseGenerated(name)) return Drawn(name, *generated);
  if (const auto shared = SharedObject(name)) return Imported(shared->string());
  if (IsObjectPath(name)) return Imported(name);
  ETUDE_RETURN_IF_ERROR(CheckObjectName(name));
  return assets::MakeObject(name);
}

}  // namespace etude::synthesis
