// SPDX-License-Identifier: Apache-2.0
#include "services/policy/insight_viewer.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "services/bus/directory.h"
#include "services/bus/topic.h"
#include "services/core/clock.h"
#include "services/policy/insight_wish.h"

namespace etude::policy {
namespace {

using namespace std::chrono_literals;

constexpr auto kLook = 500ms;  // between two looks for a server

// With the server of the run.
struct Link {
  bus::Presence server;
  bus::Writer<bus::InsightWish> wishes;
  bus::Reader<bus::Insight> insights;
};

}  // namespace

struct InsightViewer::Impl {
  const bus::Participant* participant = nullptr;
  Selector run;
  std::string session;
  bus::Directory directory;
  std::string viewer = "viewer-" + bus::UniquePeerName();
  std::optional<Link> link = {};
  MonotonicClock::time_point look_again = {}, wish_again = {};

  ~Impl() {
    if (link) (void)link->wishes.Write(WishFor(link->server, viewer, session, 0));
  }
  Status Meet();
  Status KeepWishing();
  std::optional<bus::Insight> Newest();
};

// Finds the server, and again where it is another one by now. What is there is looked up and not waited for.
Status InsightViewer::Impl::Meet() {
  if (MonotonicClock::now() < look_again) return {};
  look_again = MonotonicClock::now() + kLook;
  const auto servers = directory.Matching(bus::PresenceKind::kPolicy, run);
  const auto is_known = [this](const bus::Presence& server) { return link && link->server.id == server.id; };
  if (std::ranges::any_of(servers, is_known)) return {};
  link.reset();
  if (servers.empty()) return {};
  if (servers.size() > 1)
    return Fail(Code::kInvalidArgument,
                fmt::format("look into the policy of run '{}': that is {} servers: say which by "
                            "NAME@ID{}",
                            run.text(), servers.size(), bus::ListText(servers)));
  const std::string partition = bus::Owner{servers.front().name, servers.front().id}.partition();
  ETUDE_ASSIGN_OR_RETURN(auto wishes, bus::Writer<bus::InsightWish>::Open(*participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto insights, bus::Reader<bus::Insight>::Open(*participant, partition));
  link.emplace(Link{servers.front(), std::move(wishes), std::move(insights)});
  wish_again = {};
  return {};
}

// A wish that is written before the server's reader is found is lost.
Status InsightViewer::Impl::KeepWishing() {
  if (MonotonicClock::now() < wish_again || link->wishes.matched_readers() == 0) return {};
  wish_again = MonotonicClock::now() + std::chrono::seconds(bus::kWishAgain);
  return link->wishes.Write(WishFor(link->server, viewer, session, bus::kWishStands));
}

std::optional<bus::Insight> InsightViewer::Impl::Newest() {
  std::optional<bus::Insight> newest;
  for (auto& insight : link->insights.Take())
    if (insight.viewer == viewer && insight.session == session) newest = std::move(insight);
  return newest;
}

InsightViewer::InsightViewer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
InsightViewer::InsightViewer(InsightViewer&&) noexcept = default;
InsightViewer& InsightViewer::operator=(InsightViewer&&) noexcept = default;
InsightViewer::~InsightViewer() = default;

Result<InsightViewer> InsightViewer::Open(const bus::Participant& participant, const std::string& run,
                                          const std::string& session) {
  ETUDE_ASSIGN_OR_RETURN(auto selector, ParseSelector(run, "look into the policy of run"));
  ETUDE_ASSIGN_OR_RETURN(auto directory, bus::Directory::Open(participant));
  return InsightViewer(
      std::unique_ptr<Impl>(new Impl{&participant, std::move(selector), session, std::move(directory)}));
}

Result<std::optional<Insight>> InsightViewer::Take() {
  ETUDE_RETURN_IF_ERROR(impl_->Meet());
  if (!impl_->link) return std::optional<Insight>();
  ETUDE_RETURN_IF_ERROR(impl_->KeepWishing());
  const auto message = impl_->Newest();
  if (!message) return std::optional<Insight>();
  ETUDE_ASSIGN_OR_RETURN(auto insight, ReadInsight(*message));
  return std::optional<Insight>(std::move(insight));
}

}  // namespace etude::policy
