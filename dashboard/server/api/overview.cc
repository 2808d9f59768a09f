// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/api/overview.h"

#include <algorithm>
#include <array>
#include <functional>
#include <tuple>
#include <utility>

namespace etude::api {
namespace {

using sources::Found;
using sources::Kind;

constexpr std::size_t kMostLooked = 40;  // of a kind: the Overview is asked for all the time

// Adds one of a kind, or why it cannot be read.
template <class Item, class Opened, class StateOfView>
void GatherOne(const Found& found, const Result<Opened>& opened, StateOfView&& state, std::vector<Item>& items,
               std::vector<std::string>& unreadable) {
  if (!opened)
    unreadable.push_back(found.shown + ": " + opened.error().message);
  else
    items.push_back({found, opened->view, state(*opened->view), found.name});
}

void GatherFiles(Context& context, Overview& all) {
  const auto of_bus = [&](const auto& view) { return StateOf(&view, LiveOf(*all.live, view)); };
  using Role = sources::Catalog::Role;
  // many evaluations, each with its rollouts, do not take the place of what was collected
  constexpr std::array<std::pair<Kind, Role>, 4> kLooked{{{Kind::kDataset, Role::kDemonstrations},
                                                          {Kind::kDataset, Role::kRollouts},
                                                          {Kind::kRun, Role::kAny},
                                                          {Kind::kEval, Role::kAny}}};
  for (const auto& [kind, role] : kLooked) {
    const auto newest = context.sources.catalog().NewestOf(kind, kMostLooked, role);
    all.more[kind] += newest.more;
    for (const auto& found : newest.found) {
      if (kind == Kind::kDataset)
        GatherOne(found, OpenDataset(context, found.id), of_bus, all.datasets, all.unreadable);
      else if (kind == Kind::kRun)
        GatherOne(found, OpenRun(context, found.id), of_bus, all.runs, all.unreadable);
      else
        GatherOne(
            found, OpenEval(context, found.id), [&](const auto& view) { return EvalState(context, found, view); },
            all.evals, all.unreadable);
    }
  }
}

Standing StandingOf(bool running, bool live, double begun, double updated, const std::string& id) {
  return {running, live, running || live ? begun : updated, id};
}

template <class Items>
void SortByStanding(Items& items) {
  std::ranges::sort(items, std::less<>(), [](const auto& item) { return StandingOf(item); });
}

}  // namespace

bool Standing::operator<(const Standing& other) const {
  return std::tie(other.running, other.live, other.time, id) < std::tie(running, live, time, other.id);
}

Standing StandingOf(const DatasetItem& item) {
  const auto& state = item.state;
  return StandingOf(state.state == "running", state.live, state.begun, state.updated, item.found.id);
}

Standing StandingOf(const RunItem& item) {
  const auto& state = item.state;
  return StandingOf(state.state == "running", state.live, state.begun, state.updated, item.found.id);
}

Standing StandingOf(const EvalItem& item) {
  const double begun = sources::NumberOf(item.view->report, "created").value_or(0);
  return StandingOf(item.state == "running", false, begun, item.view->updated, item.found.id);
}

Overview LookOver(Context& context) {
  Overview all;
  all.live = context.live();
  GatherFiles(context, all);
  for (const auto& [id, campaign] : all.live->campaigns) {
    const bool known = std::ranges::any_of(
        all.datasets, [&, &id = id](const auto& item) { return item.view && item.view->info.identity == id; });
    if (known || !campaign.present) continue;
    Found found;
    found.id = BusId(campaign.presence);
    if (AnnouncesRollouts(campaign)) found.eval = found.id;  // of its evaluation no more is known here
    all.datasets.push_back({found, nullptr, StateOf(nullptr, &campaign), campaign.presence.name});
  }
  for (const auto& [id, run] : all.live->runs) {
    const bool known = std::ranges::any_of(
        all.runs, [&, &id = id](const auto& item) { return item.view && item.view->identity == id; });
    if (known || !run.present) continue;
    Found found;
    found.kind = Kind::kRun;
    found.id = BusId(run.presence);
    all.runs.push_back({found, nullptr, StateOf(nullptr, &run), run.presence.name});
  }
  SortByStanding(all.datasets);
  SortByStanding(all.runs);
  SortByStanding(all.evals);
  return all;
}

const DatasetItem* NewestDataset(const Overview& all) {
  const auto first = std::ranges::find_if(all.datasets, [](const auto& item) { return item.found.eval.empty(); });
  return first == all.datasets.end() ? nullptr : &*first;
}

const RunItem* NewestRun(const Overview& all) { return all.runs.empty() ? nullptr : &all.runs.front(); }

const EvalItem* NewestEval(const Overview& all) { return all.evals.empty() ? nullptr : &all.evals.front(); }

std::string GenerationLink(const Overview& all, const std::string& identity, const live::LiveCampaign& campaign) {
  const auto of_folder = std::ranges::find_if(
      all.datasets, [&](const auto& item) { return item.view && item.view->info.identity == identity; });
  return "/generation?dataset=" + (of_folder == all.datasets.end() ? BusId(campaign.presence) : of_folder->found.id);
}

}  // namespace etude::api
