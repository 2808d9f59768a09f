// SPDX-License-Identifier: Apache-2.0
#include "worker/synthesis/object_folder.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <utility>

#include "services/core/config.h"
#include "worker/assets/geom_writer.h"
#include "worker/synthesis/mesh_file.h"

namespace etude::synthesis {
namespace {

using Eigen::Vector3d;

std::pair<Vector3d, Vector3d> BoxOf(const assets::Mesh& mesh) {
  Vector3d low = mesh.positions[0], high = low;
  for (const Vector3d& p : mesh.positions) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  return {low, high};
}

MassProperties MassOf(const assets::Mesh& mesh, const std::vector<assets::Mesh>& pieces) {
  if (const MassProperties whole = Integrate(mesh); whole.mass > 0 && IsWatertight(mesh)) return whole;
  std::vector<MassProperties> parts;
  for (const auto& piece : pieces) parts.push_back(Integrate(piece));
  return Sum(parts);
}

std::string PieceName(int i) { return fmt::format("collision_{}", i); }

std::string Inertial(const MassProperties& mass) {
  const PrincipalInertia principal = Diagonalise(mass.inertia);
  const Eigen::Quaterniond& q = principal.axes;
  return fmt::format("<inertial pos=\"{}\" quat=\"{}\" mass=\"{}\" diaginertia=\"{}\"/>", assets::Numbers(mass.centre),
                     assets::Numbers(std::vector<double>{q.w(), q.x(), q.y(), q.z()}), mass.mass,
                     assets::Numbers(principal.moments));
}

/// All names carry the object's, so that several objects can be included in one model.
std::string ModelText(const SolidObject& object) {
  const std::string& name = object.facts.name;
  std::string meshes, geoms;
  for (int i = 0; i < object.facts.pieces; ++i) {
    meshes += fmt::format("    <mesh name=\"{0}_{1}\" file=\"{1}.obj\"/>\n", name, PieceName(i));
    geoms += fmt::format(
        "      <geom name=\"{0}_{1}\" type=\"mesh\" mesh=\"{0}_{1}\" group=\"3\" condim=\"6\" "
        "friction=\"0.9 0.02 0.001\" solref=\"0.006 1\" solimp=\"0.95 0.99 0.001\" mass=\"0\" "
        "rgba=\"0.4 0.4 0.9 0.5\"/>\n",
        name, PieceName(i));
  }
  return fmt::format(R"(<mujoco model="{0}">
  <asset>
    <texture name="{0}" type="2d" file="texture.png"/>
    <material name="{0}" texture="{0}" specular="0.2" shininess="0.2"/>
    <mesh name="{0}_visual" file="visual.obj"/>
{1}  </asset>
  <worldbody>
    <body name="{0}" pos="0 0 {2}">
      <freejoint name="{0}"/>
      {3}
      <geom name="{0}_visual" type="mesh" mesh="{0}_visual" material="{0}" group="2" contype="0" conaffinity="0" mass="0"/>
{4}    </body>
  </worldbody>
</mujoco>
)",
                     name, meshes, object.facts.rest_height_m, Inertial(object.mass), geoms);
}

}  // namespace

Result<SolidObject> PlaceObject(ObjectFacts facts, assets::Mesh mesh, const std::optional<Hole>& hole, double density,
                                const PieceOptions& pieces) {
  if (mesh.positions.empty() || mesh.faces.empty() || facts.size_m <= 0 || density <= 0)
    return Fail(Code::kInvalidArgument, fmt::format("make object '{}': {} faces, size {} m, density {} kg/m^3",
                                                    facts.name, mesh.faces.size(), facts.size_m, density));
  const auto [low, high] = BoxOf(mesh);
  const Vector3d middle = (low + high) / 2;
  const double scale = facts.size_m / (high - low).maxCoeff();
  for (Vector3d& p : mesh.positions) p = scale * (p - middle);
  std::optional<Hole> placed = hole;
  if (placed) placed->centre = scale * (placed->centre - middle);

  SolidObject object{.facts = std::move(facts), .visual = std::move(mesh)};
  object.pieces = ConvexPieces(object.visual, placed, pieces);
  object.mass = MassOf(object.visual, object.pieces).Scaled(density);
  if (object.pieces.empty() || object.mass.mass <= 0)
    return Fail(Code::kInvalidArgument, fmt::format("make object '{}': its mesh has no volume", object.facts.name));
  const Vector3d extent = scale * (high - low);
  object.facts.mass_kg = object.mass.mass;
  object.facts.rest_height_m = extent.z() / 2;
  object.facts.extent_m = {extent.x(), extent.y(), extent.z()};
  object.facts.pieces = static_cast<int>(object.pieces.size());
  object.facts.faces = static_cast<int>(object.visual.faces.size());
  return object;
}

void StandUp(ReliefBody& body, View view) {
  if (view == View::kTop) return;
  const auto turn = [](const Vector3d& p) { return Vector3d(p.x(), -p.z(), p.y()); };
  for (Vector3d& p : body.mesh.positions) p = turn(p);
  for (Vector3d& n : body.mesh.normals) n = turn(n);
  if (body.hole) *body.hole = {turn(body.hole->centre), turn(body.hole->axis)};
}

Status WriteObject(const SolidObject& object, const Path& folder) {
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(folder / "texture.png", object.texture));
  ETUDE_RETURN_IF_ERROR(WriteMesh(folder / "visual.obj", object.visual, "texture.png"));
  for (int i = 0; i < object.facts.pieces; ++i)
    ETUDE_RETURN_IF_ERROR(WriteMesh(folder / (PieceName(i) + ".obj"), object.pieces[i]));
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(folder / (object.facts.name + ".xml"), ModelText(object)));
  // last: a folder with object.yaml is whole
  return WriteFileAtomically(folder / "object.yaml", ToYaml(ToJson(object.facts)));
}

Result<ObjectFacts> ReadObjectFacts(const Path& folder) { return LoadConfig<ObjectFacts>(folder / "object.yaml"); }

}  // namespace etude::synthesis
