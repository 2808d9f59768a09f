// SPDX-License-Identifier: Apache-2.0
#include "worker/synthesis/generator.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "services/core/config.h"
#include "services/core/rng.h"
#include "worker/synthesis/drawings.h"

namespace etude::synthesis {
namespace {

using Eigen::Vector2d;

struct Entry {
  ClassFacts facts;
  Drawing (*draw)(Rng&);
};

// Sizes: what a hand of 8.5 cm, level and 6 cm above the table, can close around. Densities are of the whole body: a
// mug is hollow, bread full of air.
const std::vector<Entry>& Entries() {
  static const std::vector<Entry> entries{
      {{"apple", 0.080, 0.092, 800}, DrawApple},         {{"avocado", 0.082, 0.094, 980}, DrawAvocado},
      {{"donut", 0.074, 0.082, 400}, DrawDonut},         {{"hamburger", 0.074, 0.084, 550}, DrawHamburger},
      {{"lemon", 0.080, 0.090, 950}, DrawLemon},         {{"mug", 0.082, 0.094, 650}, DrawMug},
      {{"orange", 0.071, 0.076, 880}, DrawOrange},       {{"pear", 0.088, 0.102, 960}, DrawPear},
      {{"sourdough", 0.080, 0.090, 350}, DrawSourdough}, {{"strawberry", 0.074, 0.086, 700}, DrawStrawberry},
  };
  return entries;
}

Result<Entry> FindEntry(const std::string& name) {
  std::vector<std::string> names;
  for (const Entry& entry : Entries()) {
    if (entry.facts.name == name) return entry;
    names.push_back(entry.facts.name);
  }
  return Fail(Code::kInvalidArgument, fmt::format("there is no class '{}'{}; there are {}", name,
                                                  Suggestion(name, names), fmt::join(names, ", ")));
}

/// The mean colour of four points within a pixel, over white; on the object when its middle is.
Texel SamplePixel(const Drawing& drawing, int x, int y) {
  const double pixel = 2.0 / kPictureSize;
  const auto at = [&](double dx, double dy) { return drawing({(x + dx) * pixel - 1, 1 - (y + dy) * pixel}); };
  Texel sum;
  sum.height = at(0.5, 0.5).height;
  for (const double dx : {0.25, 0.75})
    for (const double dy : {0.25, 0.75}) {
      const Texel part = at(dx, dy);
      sum.color += (part.height > 0 ? part.color : Color::Ones()) / 4;
    }
  return sum;
}

/// Front and back are a little flat, so that what is laid down does not roll.
float Pressed(float depth) {
  constexpr float kFlat = 0.93f;
  return depth < kFlat ? depth : kFlat + 0.05f * (depth - kFlat);
}

}  // namespace

const std::vector<ClassFacts>& KnownClasses() {
  static const std::vector<ClassFacts> classes = [] {
    std::vector<ClassFacts> facts;
    for (const Entry& entry : Entries()) facts.push_back(entry.facts);
    return facts;
  }();
  return classes;
}

Result<ClassFacts> FindClass(const std::string& name) {
  ETUDE_ASSIGN_OR_RETURN(const Entry entry, FindEntry(name));
  return entry.facts;
}

Result<Picture> Draw(const std::string& class_name, std::uint64_t seed) {
  ETUDE_ASSIGN_OR_RETURN(const Entry entry, FindEntry(class_name));
  Rng rng(MixSeed({seed}, class_name));
  const Drawing drawing = entry.draw(rng);

  Picture picture{.width = kPictureSize, .height = kPictureSize, .view = View::kFront};
  picture.rgb.reserve(3 * picture.pixels());
  for (int y = 0; y < kPictureSize; ++y)
    for (int x = 0; x < kPictureSize; ++x) {
      const Texel texel = SamplePixel(drawing, x, y);
      for (int k = 0; k < 3; ++k)
        picture.rgb.push_back(static_cast<std::uint8_t>(std::lround(255 * std::clamp(texel.color[k], 0.0, 1.0))));
      picture.depth.push_back(static_cast<float>(std::max(texel.height, 0.0)));
      picture.mask.push_back(texel.height > 0);
    }

  // heights are in half widths of the picture, relief in widths
  const float highest = *std::max_element(picture.depth.begin(), picture.depth.end());
  for (float& depth : picture.depth) depth = Pressed(depth / highest) / Pressed(1);
  picture.relief = highest * Pressed(1) / 2.0;
  return picture;
}

}  // namespace etude::synthesis
