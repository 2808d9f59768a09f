// SPDX-License-Identifier: Apache-2.0
// What GET /home looks at once and makes its parts of: sources, warnings (overview_warnings.cc), tiles
// (overview_tiles.cc), the sentence (home.cc).
#pragma once

#include <cstddef>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "dashboard/server/api/context.h"

namespace etude::api {

template <class View, class State>
struct OverviewItem {
  sources::Found found;  ///< folder empty: seen on the bus only
  std::shared_ptr<const View> view;
  State state;
  std::string name;
};
using DatasetItem = OverviewItem<sources::DatasetView, CampaignState>;
using RunItem = OverviewItem<sources::RunView, RunState>;
using EvalItem = OverviewItem<sources::EvalView, std::string>;

/// What of a kind is shown before what: what runs, what is on the bus, and of these what was begun last; then what
/// changed last. Of two that run, which one changed last is no matter: it is the other one a moment later.
struct Standing {
  bool running = false, live = false;
  double time = 0;                              ///< seconds since 1970, of its begin or of its last change
  std::string id;                               ///< decides where all else is the same
  bool operator<(const Standing& other) const;  ///< before it in a list
};
Standing StandingOf(const DatasetItem& item);
Standing StandingOf(const RunItem& item);
Standing StandingOf(const EvalItem& item);

/// Everything that /home is made of, in the order of Standing.
struct Overview {
  std::shared_ptr<const live::LiveView> live;
  std::vector<DatasetItem> datasets;
  std::vector<RunItem> runs;
  std::vector<EvalItem> evals;
  std::vector<std::string> unreadable;        ///< what could not be read, and why
  std::map<sources::Kind, std::size_t> more;  ///< that were not looked at
};

Overview LookOver(Context& context);

/// The first ones. Null: there is none.
const DatasetItem* NewestDataset(const Overview& all);  ///< of demonstrations
const RunItem* NewestRun(const Overview& all);
const EvalItem* NewestEval(const Overview& all);

/// The page of a campaign's attempts; of what is only on the bus by its name there.
std::string GenerationLink(const Overview& all, const std::string& identity, const live::LiveCampaign& campaign);

OrderedJson WarningsJson(Context& context, const Overview& all);
OrderedJson TilesJson(const Overview& all);

}  // namespace etude::api
