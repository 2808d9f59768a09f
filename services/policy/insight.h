// SPDX-License-Identifier: Apache-2.0
// What a policy saw in an observation and said of it, as whoever looks into it reads it.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "services/bus/messages.h"
#include "services/core/config.h"
#include "services/core/result.h"
#include "services/episode/action.h"

namespace etude::policy {

/// The part of the camera's picture that the policy sees, px; (u, v) is its top-left pixel.
struct View {
  int u = 0, v = 0, width = 0, height = 0;
  bool operator==(const View&) const = default;
};

/// Where one head looks, or the mean of a module's heads. All weights together are 1, as bytes.
struct HeadAttention {
  std::vector<double> picture;  ///< rows * columns, row by row: a grid of tokens that covers the view
  std::vector<double> keys;     ///< one for each of ModuleAttention::keys
};

/// One module's attention.
struct ModuleAttention {
  int rows = 0, columns = 0;        ///< of the picture's grid; 0: it does not read the picture
  std::vector<std::string> keys{};  ///< what else it reads: "language", "joints", "self", modules
  HeadAttention mean{};
  std::vector<HeadAttention> heads{};  ///< at least one

  bool reads_picture() const { return rows > 0; }
  /// Of its attention that falls on the picture, 0..1.
  double share() const;
};

/// What a word of the sentence is worth.
struct WordWorth {
  std::string word;
  double moves = 0;  ///< m, the mean of how far each planned waypoint moves without it
};

struct Insight {
  std::uint64_t checkpoint_step = 0;
  OrderedJson modules = OrderedJson::object();       ///< as Answer::modules
  std::map<std::string, ModuleAttention> attention;  ///< by module
  View view;                                         ///< of no size: not said
  std::vector<Waypoint> waypoints;                   ///< kWaypoints in world, or none
  OrderedJson what_if;                               ///< as `modules`, of what was asked as well; null: nothing was
  std::vector<Waypoint> what_if_waypoints;           ///< kWaypoints, or none
  std::vector<WordWorth> words;                      ///< in the sentence's order; none: not asked, or nothing planned
  /// The same of each of Question::joints, where it would be on average in training, m.
  std::vector<double> joints;
};

/// @error kInvalidArgument: the server's own, in its words; kCorrupt: what does not parse or does not fit together
Result<Insight> ReadInsight(const bus::Insight& message);

}  // namespace etude::policy
