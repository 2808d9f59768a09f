// SPDX-License-Identifier: Apache-2.0
#include "worker/assets/object.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <numbers>

#include "services/core/config.h"
#include "worker/assets/geom_writer.h"
#include "worker/assets/object_parts.h"

namespace etude::assets {
namespace {

using std::numbers::pi;

/// Collects the pieces of one object; mass is shared out by volume.
class Builder {
 public:
  Builder(std::string name, double mass, double rest_height, const Eigen::Vector3d& size) {
    model_.name = std::move(name);
    model_.mass = mass;
    model_.rest_height = rest_height;
    model_.half_extent = size / 2;
  }

  void Material(const std::string& name, const std::string& attributes) {
    model_.materials += fmt::format("<material name=\"{}\" {}/>\n", name, attributes);
  }
  void Texture(const std::string& name, const Canvas& canvas) {
    model_.files.push_back({name + ".tex", canvas.ToTexture()});
  }
  /// A mesh to look at.
  void Visual(const std::string& mesh, const Mesh& surface, const std::string& material) {
    model_.files.push_back({mesh + ".msh", ToMsh(surface)});
    model_.geoms += Geom("visual", "mesh", {}, {}, fmt::format("mesh=\"{}\" material=\"{}\"", mesh, material));
  }
  void Visual(const std::string& type, const std::vector<double>& size, const std::string& material) {
    model_.geoms += Geom("visual", type, size, {}, fmt::format("material=\"{}\"", material));
  }
  /// An upright cylinder between two heights above the lowest point.
  void Cylinder(double radius, double from, double to) {
    pieces_.push_back(
        {"cylinder", {radius, (to - from) / 2}, Middle(from, to), "", pi * radius * radius * (to - from)});
  }
  /// A sphere on the ground; it needs more than the usual friction to come to rest.
  void Ball(double radius) { pieces_.push_back({"sphere", {radius}, 0, "", 1, " friction=\"0.9 0.02 0.005\""}); }
  void Box(double half_x, double half_y, double from, double to) {
    pieces_.push_back(
        {"box", {half_x, half_y, (to - from) / 2}, Middle(from, to), "", 4 * half_x * half_y * (to - from)});
  }
  /// The convex hull of a mesh; `volume` in m^3.
  void Hull(const std::string& mesh, const Mesh& surface, double volume) {
    model_.files.push_back({mesh + ".msh", ToMsh(surface)});
    pieces_.push_back({"mesh", {}, 0, mesh, volume});
  }

  /// @param round  it can roll: contacts get rolling friction, too
  ObjectModel Finish(bool round) {
    double total = 0;
    for (const Piece& piece : pieces_) total += piece.volume;
    for (const Piece& piece : pieces_) {
      const double mass = model_.mass * piece.volume / total;
      const std::string extra = piece.mesh.empty() ? piece.extra : fmt::format(" mesh=\"{}\"", piece.mesh);
      model_.geoms +=
          Geom(round ? "object_round" : "object", piece.type, piece.size,
               {{0, 0, piece.z}, Eigen::Quaterniond::Identity()}, fmt::format("mass=\"{}\"{}", mass, extra));
    }
    return std::move(model_);
  }

 private:
  struct Piece {
    std::string type;
    std::vector<double> size;
    double z;
    std::string mesh;
    double volume;
    std::string extra = {};
  };
  double Middle(double from, double to) const { return (from + to) / 2 - model_.rest_height; }

  ObjectModel model_;
  std::vector<Piece> pieces_;
};

// Sizes and masses follow the original's tabletop objects; inertias follow from shape and mass.

ObjectModel Cube() {
  Builder builder("cube", 0.100, 0.05, {0.04, 0.04, 0.10});
  builder.Material("cube", "rgba=\"0.86 0.05 0.05 1\" specular=\"0.2\" shininess=\"0.3\"");
  builder.Visual("box", {0.02, 0.02, 0.05}, "cube");
  builder.Box(0.02, 0.02, 0, 0.10);
  return builder.Finish(false);
}

ObjectModel Can(const std::string& name, const Canvas& label) {
  Builder builder(name, 0.1434, kCanHeight / 2, {2 * kCanRadius, 2 * kCanRadius, kCanHeight});
  builder.Texture(name, label);
  builder.Material(name, fmt::format("texture=\"{}\" specular=\"0.4\" shininess=\"0.5\"", name));
  builder.Visual("can", CanMesh(kCanHeight / 2), name);
  builder.Cylinder(kCanRadius, 0, kCanHeight);
  return builder.Finish(true);
}

ObjectModel Milk() {
  const double rest = 0.061;
  Builder builder("milk", 0.1918, rest, {2 * kMilkHalf, 2 * kMilkHalf, kMilkHeight});
  builder.Texture("milk", MilkTexture());
  builder.Material("milk", "texture=\"milk\" specular=\"0.1\" shininess=\"0.1\"");
  builder.Visual("milk", MilkMesh(rest), "milk");
  builder.Box(kMilkHalf, kMilkHalf, 0, kMilkShoulder);
  const double roof = kMilkRidge - kMilkShoulder;
  builder.Hull("milk_gable", MilkGableHull(rest), 2 * kMilkHalf * roof * (kMilkHalf + kMilkFin));
  builder.Box(kMilkHalf, kMilkFin, kMilkRidge, kMilkHeight);
  return builder.Finish(false);
}

ObjectModel Bread() {
  const double rest = 0.0363;
  Builder builder("bread", 0.2018, rest, {2 * kBreadHalfX, 2 * kBreadHalfY, kBreadHeight});
  builder.Texture("bread", BreadTexture());
  builder.Material("bread", "texture=\"bread\" specular=\"0\" shininess=\"0\"");
  builder.Visual("bread", BreadMesh(rest), "bread");
  builder.Hull("bread", BreadMesh(rest), 1);  // the hull is the loaf itself
  ObjectModel model = builder.Finish(false);
  model.files.pop_back();
  return model;
}

ObjectModel Bottle() {
  const double rest = 0.0649;
  Builder builder("bottle", 0.257, rest, {2 * kBottleRadius, 2 * kBottleRadius, kBottleHeight});
  builder.Material("bottle_glass", "rgba=\"0.22 0.66 0.10 0.86\" specular=\"0.8\" shininess=\"0.8\"");
  builder.Material("bottle_cap", "rgba=\"0.80 0.68 0.22 1\" specular=\"0.5\" shininess=\"0.5\"");
  builder.Texture("bottle_label", BottleLabelTexture());
  builder.Material("bottle_label", "texture=\"bottle_label\" specular=\"0.1\" shininess=\"0.1\"");
  builder.Visual("bottle", BottleMesh(rest), "bottle_glass");
  builder.Visual("bottle_label", BottleLabelMesh(rest), "bottle_label");
  builder.Visual("bottle_cap", BottleCapMesh(rest), "bottle_cap");
  builder.Cylinder(kBottleRadius, 0, kBottleShoulder);
  const double r = kBottleRadius, n = kBottleNeckRadius, rise = kBottleNeck - kBottleShoulder;
  builder.Hull("bottle_shoulder", BottleShoulderHull(rest), pi * rise * (r * r + r * n + n * n) / 3);
  builder.Cylinder(n + .0008, kBottleNeck, kBottleHeight);
  return builder.Finish(true);
}

const std::map<std::string, std::function<ObjectModel()>>& Makers() {
  static const std::map<std::string, std::function<ObjectModel()>> makers{
      {"cube", Cube},
      {"coke", [] { return Can("coke", CokeTexture()); }},
      {"milk", Milk},
      {"pepsi", [] { return Can("pepsi", PepsiTexture()); }},
      {"bread", Bread},
      {"bottle", Bottle},
      {"basketball", [] {
         return MakeBall("basketball", {0.90, 0.42, 0.10});
       }}};
  return makers;
}

}  // namespace

// Leather on the outside, thick: it rests where it is put, and rolls when it is pushed.
ObjectModel MakeBall(const std::string& name, const Color& colour) {
  Builder builder(name, 0.600, kBallRadius, Eigen::Vector3d::Constant(2 * kBallRadius));
  builder.Texture(name, BallTexture(colour));
  builder.Material(name, fmt::format("texture=\"{}\" specular=\"0.15\" shininess=\"0.2\"", name));
  builder.Visual("basketball", BallMesh(), name);
  builder.Ball(kBallRadius);
  return builder.Finish(true);
}

Color BallColour(int number) {
  constexpr int kHues = 12;
  constexpr std::array<double, 2> kSaturation{0.9, 0.6}, kValue{0.9, 0.6};
  const double sector = 6.0 * (number % kHues) / kHues;
  const auto depth = static_cast<std::size_t>(number / kHues) % kValue.size();
  // of each channel: how far its own hue is round the circle (Smith 1978, HSV)
  const auto channel = [&](double own) {
    const double from = std::abs(std::remainder(sector - own, 6.0));
    return kValue[depth] * (1 - kSaturation[depth] * std::clamp(from - 1, 0.0, 1.0));
  };
  return {channel(0), channel(2), channel(4)};
}

const std::vector<std::string>& KnownObjects() {
  static const std::vector<std::string> names{"cube", "coke", "pepsi", "milk", "bread", "bottle"};
  return names;
}

Result<ObjectModel> MakeObject(const std::string& name) {
  const auto maker = Makers().find(name);
  if (maker != Makers().end()) return maker->second();
  const std::string nearest = NearestMatch(name, KnownObjects());
  return Fail(Code::kInvalidArgument, fmt::format("object '{}' is not known{}; known: {}", name,
                                                  nearest.empty() ? "" : " (did you mean '" + nearest + "'?)",
                                                  fmt::join(KnownObjects(), ", ")));
}

}  // namespace etude::assets
