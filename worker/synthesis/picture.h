// SPDX-License-Identifier: Apache-2.0
// A colour picture of one object with its relief: what a body is made from.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace etude::synthesis {

/// From where the picture looks at the object as it rests on a table.
enum class View {
  kFront,  ///< horizontally: the picture's up is the object's up
  kTop     ///< from above: the relief is the object's upper half
};

/// Row by row, first row on top. All lists have width * height entries (rgb three times as many).
struct Picture {
  int width = 0;
  int height = 0;
  std::vector<std::uint8_t> rgb;
  std::vector<float> depth;        ///< 0..1 over the object, larger is nearer to the viewer
  std::vector<std::uint8_t> mask;  ///< 1 on the object, else 0
  double relief = 0.4;             ///< height of depth 1 above depth 0, in widths of the picture
  View view = View::kFront;

  std::size_t pixels() const { return static_cast<std::size_t>(width) * height; }
};

}  // namespace etude::synthesis
