// SPDX-License-Identifier: Apache-2.0
#include "worker/synthesis/object_folder.h"

#include <fmt/format.h>

#include "services/core/config.h"
#include "worker/assets/object.h"
#include "worker/synthesis/mesh_file.h"
#include "worker/synthesis/picture_file.h"

namespace etude::synthesis {
namespace {

std::string PieceFile(int i) { return fmt::format("collision_{}.obj", i); }

/// A model of the object alone. All names carry the object's, so that several objects can be included in one model.
std::string ModelText(const ObjectFacts& facts) {
  const std::string& name = facts.name;
  std::string meshes;
  for (int i = 0; i < facts.pieces; ++i)
    meshes += fmt::format("    <mesh name=\"{0}_{1}\" file=\"{2}\"/>\n", name, i, PieceFile(i));
  const std::string body = BodyElements(facts, {.stem = name, .material = name, .class_prefix = name + "_"});
  return fmt::format(R"(<mujoco model="{0}">
  <default>
    <default class="{0}_visual"><geom contype="0" conaffinity="0" group="2" mass="0"/></default>
    <default class="{0}_object_round"><geom {3}/></default>
    <default class="{0}_object_foot"><geom {4}/></default>
  </default>
  <asset>
    <texture name="{0}" type="2d" file="texture.png"/>
    <material name="{0}" texture="{0}" specular="0.2" shininess="0.2"/>
    <mesh name="{0}_visual" file="visual.obj"/>
{1}  </asset>
  <worldbody>
    <body name="{0}" pos="0 0 {2}">
<freejoint name="{0}"/>
{5}    </body>
  </worldbody>
</mujoco>
)",
                     name, meshes, facts.rest_height_m, assets::kRoundObjectContact, assets::kFootContact, body);
}

}  // namespace

Status WriteObject(const SolidObject& object, const Path& folder, std::uint64_t largest) {
  // what is written over is whole no more until the end
  std::error_code error;
  std::filesystem::remove(folder / "object.yaml", error);
  if (error) return Fail(ErrnoError("remove", folder / "object.yaml", error.value()));
  ETUDE_ASSIGN_OR_RETURN(const auto texture, EncodePng(object.texture));
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(folder / "texture.png", texture));
  ETUDE_RETURN_IF_ERROR(WriteMesh(folder / "visual.obj", object.visual, "texture.png"));
  for (int i = 0; i < object.facts.pieces; ++i)
    ETUDE_RETURN_IF_ERROR(WriteMesh(folder / PieceFile(i), object.pieces[i]));
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(folder / (object.facts.name + ".xml"), ModelText(object.facts)));
  if (const auto bytes = std::filesystem::file_size(folder / "visual.obj", error); error || bytes > largest)
    return Fail(Code::kInvalidArgument,
                fmt::format("write object '{}': its mesh of {} faces takes {} MB, and scenes read {} at most: make it "
                            "coarser",
                            object.facts.name, object.facts.faces, bytes >> 20, largest >> 20));
  if (texture.size() > largest)
    return Fail(
        Code::kInvalidArgument,
        fmt::format("write object '{}': its picture of {} x {} px takes {} MB, and scenes read {} at most: make "
                    "it smaller",
                    object.facts.name, object.texture.width, object.texture.height, texture.size() >> 20,
                    largest >> 20));
  // last: a folder with object.yaml is whole
  return WriteFileAtomically(folder / "object.yaml", ToYaml(ToJson(object.facts)));
}

}  // namespace etude::synthesis
