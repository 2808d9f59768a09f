// SPDX-License-Identifier: Apache-2.0
#include "worker/assets/shifted_world.h"

#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <set>
#include <sstream>

#include "services/core/check.h"
#include "worker/assets/geom_writer.h"
#include "worker/assets/object_parts.h"

namespace etude::assets {
namespace {

using Change = std::function<void(std::vector<double>&)>;

std::vector<double> ReadNumbers(const std::string& text) {
  std::istringstream stream(text);
  std::vector<double> values;
  for (double value; stream >> value;) values.push_back(value);
  return values;
}

/// Rewrites the numbers of `attribute` in every element that begins with `opening` ("<light ").
void Rewrite(std::string& xml, const std::string& opening, const std::string& attribute, const Change& change) {
  const std::string key = " " + attribute + "=\"";
  for (std::size_t at = xml.find(opening); at != std::string::npos; at = xml.find(opening, at + 1)) {
    const std::size_t begin = xml.find(key, at);
    if (begin == std::string::npos || begin > xml.find('>', at)) continue;
    const std::size_t value = begin + key.size(), end = xml.find('"', value);
    std::vector<double> numbers = ReadNumbers(xml.substr(value, end - value));
    change(numbers);
    xml.replace(value, end - value, Numbers(numbers));
  }
}

void Replace(std::string& text, const std::string& what, const std::string& by) {
  for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + by.size()))
    text.replace(at, what.size(), by);
}

Change Gain(const std::vector<double>& gain) {
  return [gain](std::vector<double>& values) {
    for (std::size_t i = 0; i < std::min(values.size(), gain.size()); ++i) values[i] *= gain[i];
  };
}

void ShiftLight(const WorldSpec& world, std::string& mjcf) {
  std::vector<double> gain = world.light_colour;
  for (double& channel : gain) channel *= world.light_brightness;
  for (const char* light : {"<light ", "<headlight "})
    for (const char* part : {"ambient", "diffuse", "specular"}) Rewrite(mjcf, light, part, Gain(gain));
  Rewrite(mjcf, "<light ", "dir", [&](std::vector<double>& values) { values = world.light_direction; });
}

Canvas TableTexture(const std::string& table) {
  if (table == "cloth") return ClothTexture();
  if (table == "stone") return StoneTexture();
  if (table == "plain") return Canvas(16, 16, {0.74, 0.73, 0.71});
  return WoodTexture();
}

Canvas ColouredTable(const std::string& table, const std::vector<double>& colour) {
  Canvas picture = TableTexture(table);
  const Color gain = Color::Map(colour.data());
  for (int y = 0; y < picture.height(); ++y)
    for (int x = 0; x < picture.width(); ++x) picture.at(x, y) = picture.at(x, y).cwiseProduct(gain).cwiseMin(1);
  return picture;
}

void ShiftTable(const WorldSpec& world, SceneDescription& scene) {
  const Canvas picture = ColouredTable(world.table, world.table_colour);
  const auto file = std::find_if(scene.files.begin(), scene.files.end(),
                                 [](const AssetFile& candidate) { return candidate.name == "wood.tex"; });
  ETUDE_CHECK(file != scene.files.end());
  *file = {world.table + ".tex", picture.ToTexture()};
  // an object may be called "wood", too
  Replace(scene.mjcf, "<texture name=\"wood\"", "<texture name=\"" + world.table + "\"");
  Replace(scene.mjcf, " texture=\"wood\"", " texture=\"" + world.table + "\"");
  Replace(scene.mjcf, "\"wood.tex\"", "\"" + world.table + ".tex\"");
}

/// A material's colour multiplies its texture; without one it is white.
void ShiftObjects(const WorldSpec& world, SceneDescription& scene) {
  for (const ObjectModel& object : scene.objects) {
    const std::size_t at = scene.mjcf.find(object.materials);
    if (object.materials.empty() || at == std::string::npos) continue;
    std::string shifted;
    std::istringstream lines(object.materials);
    for (std::string line; std::getline(lines, line);) {
      if (line.find(" rgba=\"") == std::string::npos) Replace(line, "<material ", "<material rgba=\"1 1 1 1\" ");
      shifted += line + "\n";
    }
    Rewrite(shifted, "<material ", "rgba", Gain(world.object_colour));
    scene.mjcf.replace(at, object.materials.size(), shifted);
  }
}

void AddAsset(const std::string& element, SceneDescription& scene) {
  Replace(scene.mjcf, "<asset>\n", "<asset>\n" + element);
}

void AddBackground(const std::vector<double>& colour, SceneDescription& scene) {
  AddAsset(fmt::format("<texture name=\"{1}\" type=\"skybox\" builtin=\"flat\" rgb1=\"{0}\" "
                       "rgb2=\"{0}\" width=\"8\" height=\"48\"/>\n",
                       Numbers(colour), kBackgroundTexture),
           scene);
}

}  // namespace

void ShiftWorld(const WorldSpec& world, SceneDescription& scene) {
  const WorldSpec nominal;
  if (world.light_brightness != nominal.light_brightness || world.light_colour != nominal.light_colour ||
      world.light_direction != nominal.light_direction)
    ShiftLight(world, scene.mjcf);
  if (world.table != nominal.table || world.table_colour != nominal.table_colour) ShiftTable(world, scene);
  if (world.object_colour != nominal.object_colour) ShiftObjects(world, scene);
  if (world.friction != nominal.friction) Rewrite(scene.mjcf, "<geom ", "friction", Gain({world.friction}));
  if (world.background != nominal.background) AddBackground(world.background, scene);
}

void AddChoices(const SceneSpec& spec, SceneDescription& scene) {
  std::set<std::string> there{spec.world.table};
  for (const std::string& table : spec.tables) {
    if (!there.insert(table).second) continue;
    scene.files.push_back({table + ".tex", ColouredTable(table, spec.world.table_colour).ToTexture()});
    AddAsset(fmt::format("<texture name=\"{0}\" type=\"2d\" file=\"{0}.tex\"/>\n", table), scene);
  }
  if (spec.backdrop && spec.world.background == WorldSpec().background) AddBackground(spec.world.background, scene);
}

}  // namespace etude::assets
