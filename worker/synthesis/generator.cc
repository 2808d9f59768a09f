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
  View view;
  Drawing (*draw)(Rng&);
};

// densities of the whole body: a mug is hollow, bread full of air
const std::vector<Entry>& Entries() {
  static const std::vector<Entry> entries{
      {{"apple", 0.070, 0.085, 800}, View::kFront, DrawApple},
      {{"avocado", 0.090, 0.110, 980}, View::kTop, DrawAvocado},
      {{"donut", 0.080, 0.095, 350}, View::kTop, DrawDonut},
      {{"hamburger", 0.085, 0.105, 550}, View::kFront, DrawHamburger},
      {{"lemon", 0.070, 0.085, 950}, View::kTop, DrawLemon},
      {{"mug", 0.105, 0.120, 650}, View::kFront, DrawMug},
      {{"orange", 0.068, 0.082, 880}, View::kFront, DrawOrange},
      {{"pear", 0.090, 0.110, 960}, View::kFront, DrawPear},
      {{"sourdough", 0.110, 0.140, 300}, View::kTop, DrawSourdough},
      {{"strawberry", 0.040, 0.052, 850}, View::kTop, DrawStrawberry},
  };
  return entries;
}

Result<Entry> FindEntry(const std::string& name) {
  std::vector<std::string> names;
  for (const Entry& entry : Entries()) {
    if (entry.facts.name == name) return entry;
    names.push_back(entry.facts.name);
  }
  const std::string near = NearestMatch(name, names);
  return Fail(Code::kInvalidArgument,
              fmt::format("there is no class '{}'{}; there are {}", name,
                          near.empty() ? "" : fmt::format(", did you mean '{}'?", near), fmt::join(names, ", ")));
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

  Picture picture{.width = kPictureSize, .height = kPictureSize, .view = entry.view};
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
  for (float& depth : picture.depth) depth /= highest;
  picture.relief = highest / 2.0;
  return picture;
}

}  // namespace etude::synthesis
