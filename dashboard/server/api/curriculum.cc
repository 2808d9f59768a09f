// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/api/curriculum.h"

#include <algorithm>
#include <map>

namespace etude::api {
namespace {

struct StageRow {
  std::string name, cause, reason;
  std::optional<std::uint64_t> from, to;
};

// Names of stages that no line has named yet: the modules of the level, as the trainer calls them.
std::string NameOfLevel(const OrderedJson& config, std::uint64_t level) {
  std::string name;
  for (const auto& module : sources::PartOf(sources::PartOf(config, "policy"), "modules"))
    if (sources::UnsignedOf(module, "level").value_or(1) == level)
      name += (name.empty() ? "" : "+") + sources::TextOf(module, "name");
  return name;
}

}  // namespace

OrderedJson StagesJson(const sources::RunView& view, const RunState& state) {
  std::map<std::uint64_t, StageRow> rows;
  if (state.stage > 0 || !view.curriculum.empty()) rows[1].from = 0;
  for (const auto& line : view.curriculum) {
    const auto from = sources::UnsignedOf(line, "from"), to = sources::UnsignedOf(line, "to");
    if (!from || !to || *to > 1000) continue;
    // of a run that was resumed the last word on a stage counts
    rows[*from].to = sources::UnsignedOf(line, "step");
    rows[*from].cause = sources::TextOf(line, "cause");
    rows[*from].reason = sources::TextOf(line, "reason");
    rows[*to] = StageRow{sources::TextOf(line, "name"), "", "", sources::UnsignedOf(line, "step"), std::nullopt};
    rows.erase(rows.upper_bound(*to), rows.end());  // what came after it was of the life before
  }
  for (std::uint64_t stage = 1; stage <= std::min<std::uint64_t>(state.stages, 100); ++stage) rows[stage];
  OrderedJson stages = OrderedJson::array();
  for (auto& [stage, row] : rows) {
    if (row.name.empty()) row.name = NameOfLevel(view.config, stage);
    // no line tells the end of the last one: it is the run's
    if (!row.to && state.state == "finished" && stage == state.stage) row.to = state.step;
    const bool ended = row.to.has_value();
    stages.push_back({{"stage", stage},
                      {"name", row.name},
                      {"from_step", sources::Maybe(row.from)},
                      {"to_step", sources::Maybe(row.to)},
                      {"state", ended      ? "done"
                                : row.from ? "current"
                                           : "ahead"},
                      {"cause", sources::TextOrNull(row.cause)},
                      {"reason", sources::TextOrNull(row.reason)}});
  }
  return stages;
}

}  // namespace etude::api
