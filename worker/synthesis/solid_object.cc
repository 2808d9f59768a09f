// SPDX-License-Identifier: Apache-2.0
#include "worker/synthesis/solid_object.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "worker/assets/geom_writer.h"
#include "worker/synthesis/mass.h"

namespace etude::synthesis {
namespace {

using Eigen::Vector3d;

constexpr double kPieceGap = 0.0008;  // m that the pieces begin above the ground

std::pair<Vector3d, Vector3d> BoxOf(const assets::Mesh& mesh) {
  Vector3d low = mesh.positions[0], high = low;
  for (const Vector3d& p : mesh.positions) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  return {low, high};
}

// Whether a body can have them. Of a mesh of several parts of which one is wound inwards, its volume is taken away.
bool ArePossible(const MassProperties& mass, const assets::Mesh& mesh) {
  if (!(mass.mass > 0)) return false;
  const auto [low, high] = BoxOf(mesh);
  if ((mass.centre.array() < low.array()).any() || (mass.centre.array() > high.array()).any()) return false;
  const Vector3d moments = Diagonalise(mass.inertia).moments;  // ascending
  return moments[0] > 0 && moments[0] + moments[1] >= moments[2];
}

MassProperties MassOf(const assets::Mesh& mesh, const std::vector<assets::Mesh>& pieces) {
  if (const MassProperties whole = Integrate(mesh); ArePossible(whole, mesh) && IsWatertight(mesh)) return whole;
  std::vector<MassProperties> parts;
  for (const auto& piece : pieces) parts.push_back(Integrate(piece));
  return Sum(parts);
}

/// The convex pieces, none lower than a little above the ground.
std::vector<assets::Mesh> RaisedPieces(const assets::Mesh& mesh, const std::optional<Hole>& hole,
                                       const PieceOptions& options) {
  assets::Mesh raised = mesh;
  const double lowest = BoxOf(mesh).first.z() + kPieceGap;
  for (Vector3d& p : raised.positions) p.z() = std::max(p.z(), lowest);
  return ConvexPieces(raised, hole, options);
}

void Move(const Vector3d& by, assets::Mesh& mesh) {
  for (Vector3d& p : mesh.positions) p += by;
}

void FillFacts(const SolidObject& object, const MassProperties& mass, const SupportPolygon& foot, ObjectFacts& facts) {
  const auto [low, high] = BoxOf(object.visual);
  const Vector3d extent = high - low;
  const Eigen::Matrix3d& I = mass.inertia;
  facts.mass_kg = mass.mass;
  facts.rest_height_m = extent.z() / 2;
  facts.extent_m = {extent.x(), extent.y(), extent.z()};
  facts.centre_m = {mass.centre.x(), mass.centre.y(), mass.centre.z()};
  facts.inertia = {I(0, 0), I(1, 1), I(2, 2), I(0, 1), I(0, 2), I(1, 2)};
  facts.foot_m = {foot.centre.x(), foot.centre.y(), foot.half.x(), foot.half.y()};
  facts.pieces = static_cast<int>(object.pieces.size());
  facts.faces = static_cast<int>(object.visual.faces.size());
}

}  // namespace

Result<SolidObject> PlaceObject(ObjectFacts facts, assets::Mesh mesh, const std::optional<Hole>& hole,
                                const PlaceOptions& options) {
  if (mesh.positions.empty() || mesh.faces.empty() || facts.size_m <= 0 || options.density <= 0)
    return Fail(Code::kInvalidArgument, fmt::format("make object '{}': {} faces, size {} m, density {} kg/m^3",
                                                    facts.name, mesh.faces.size(), facts.size_m, options.density));
  const auto [low, high] = BoxOf(mesh);
  double scale = facts.size_m / (high - low).maxCoeff();
  if (options.widest > 0) scale = std::min(scale, options.widest / (high - low).x());
  for (Vector3d& p : mesh.positions) p *= scale;
  // one that is wound inwards would be seen from inside, and weigh less than nothing
  if (IsWatertight(mesh)) {
    TurnOutward(mesh);
  } else {  // a scan with holes: as a whole, seen from its middle, since what is missing counts from the origin
    assets::Mesh centred = mesh;
    Move(-scale * (low + high) / 2, centred);
    if (Integrate(centred).mass < 0)
      for (auto& face : mesh.faces) std::swap(face[1], face[2]);
  }
  std::optional<Hole> placed = hole;
  if (placed) placed->centre *= scale;

  SupportPolygon foot = FlattenSupport(mesh, options.foot);
  const auto [least, most] = BoxOf(mesh);
  const Vector3d middle = (least + most) / 2;
  Move(-middle, mesh);
  foot.centre -= middle.head<2>();
  if (placed) placed->centre -= middle;
  ComputeNormals(mesh);

  SolidObject object{.facts = std::move(facts), .visual = std::move(mesh)};
  object.facts.size_m = (most - least).maxCoeff();
  object.pieces = RaisedPieces(object.visual, placed, options.pieces);
  const MassProperties mass = MassOf(object.visual, object.pieces).Scaled(options.density);
  if (object.pieces.empty() || mass.mass <= 0)
    return Fail(Code::kInvalidArgument, fmt::format("make object '{}': its mesh has no volume", object.facts.name));
  FillFacts(object, mass, foot, object.facts);
  return object;
}

void StandUp(HeightfieldBody& body, View view) {
  if (view == View::kTop) return;
  const auto turn = [](const Vector3d& p) { return Vector3d(p.x(), -p.z(), p.y()); };
  for (Vector3d& p : body.mesh.positions) p = turn(p);
  for (Vector3d& n : body.mesh.normals) n = turn(n);
  if (body.hole) *body.hole = {turn(body.hole->centre), turn(body.hole->axis)};
}

std::string BodyElements(const ObjectFacts& facts, const BodyNames& names) {
  const auto klass = [&](const char* name) { return names.class_prefix + name; };
  std::string text = fmt::format("<inertial pos=\"{}\" mass=\"{}\" fullinertia=\"{}\"/>\n",
                                 assets::Numbers(facts.centre_m), facts.mass_kg, assets::Numbers(facts.inertia));
  text += assets::Geom(klass("visual"), "mesh", {}, {},
                       fmt::format("mesh=\"{}_visual\" material=\"{}\"", names.stem, names.material));
  for (int i = 0; i < facts.pieces; ++i)
    text +=
        assets::Geom(klass("object_round"), "mesh", {}, {}, fmt::format("mesh=\"{}_{}\" mass=\"0\"", names.stem, i));
  const std::vector<double>& foot = facts.foot_m;
  if (foot.size() != 4 || foot[2] <= 0 || foot[3] <= 0) return text;
  const Pose X_OF{{foot[0], foot[1], kFootHeight / 2 - facts.rest_height_m}, Eigen::Quaterniond::Identity()};
  return text + assets::Geom(klass("object_foot"), "box", {foot[2], foot[3], kFootHeight / 2}, X_OF, "mass=\"0\"");
}

assets::ObjectModel ToSceneObject(const SolidObject& object, const std::string& name) {
  const ObjectFacts& facts = object.facts;
  assets::ObjectModel model;
  model.name = name;
  model.half_extent = Vector3d::Map(facts.extent_m.data()) / 2;
  model.rest_height = facts.rest_height_m;
  model.mass = facts.mass_kg;
  model.materials = fmt::format("<material name=\"{0}\" texture=\"{0}\" specular=\"0.2\" shininess=\"0.2\"/>\n", name);
  model.geoms = BodyElements(facts, {.stem = name, .material = name});
  model.files.push_back({name + ".tex", ToTexFile(object.texture)});
  model.files.push_back({name + "_visual.msh", assets::ToMsh(object.visual)});
  for (int i = 0; i < facts.pieces; ++i)
    model.files.push_back({fmt::format("{}_{}.msh", name, i), assets::ToMsh(object.pieces[i])});
  return model;
}

}  // namespace etude::synthesis
