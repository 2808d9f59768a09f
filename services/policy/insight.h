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

/// One module's attention to the picture: a grid of tokens that covers the view.
struct PictureAttention {
  int rows = 0, columns = 0;
  /// rows * columns, row by row, the mean of its heads. What they lack to 1 is on the module's other keys.
  std::vector<double> weights;

  /// Of its attention that falls on the picture, 0..1.
  double share() const;
};

struct Insight {
  std::uint64_t checkpoint_step = 0;
  OrderedJson modules = OrderedJson::object();        ///< as Answer::modules
  std::map<std::string, PictureAttention> attention;  ///< by module, of those that read the picture
  View view;                                          ///< of no size: not said
  std::vector<Waypoint> waypoints;                    ///< kWaypoints in world, or none
  OrderedJson what_if;                                ///< as `modules`, of what was asked as well; null: nothing was
};

/// @error kInvalidArgument: the server's own, in its words; kCorrupt: what does not parse or does not fit together
Result<Insight> ReadInsight(const bus::Insight& message);

}  // namespace etude::policy
