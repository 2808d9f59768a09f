// SPDX-License-Identifier: Apache-2.0
#include "services/policy/insight_stream.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "services/bus/directory.h"
#include "services/bus/topic.h"
#include "services/core/clock.h"

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

struct InsightStream::Impl {
  const bus::Participant* participant = nullptr;
  Selector run;
  bus::InsightWish wish;
  bus::Directory directory;
  std::optional<Link> link = {};
  MonotonicClock::time_point look_again = {}, wish_again = {};

  ~Impl() {
    if (link) (void)Wish(0);
  }
  Status Meet();
  Status KeepWishing();
  Status Wish(std::uint32_t seconds) {
    wish.seconds = seconds;
    return link->wishes.Write(wish);
  }
};

// Finds the server, and again where it is another one by now. What is there is looked up and not waited for.
Status InsightStream::Impl::Meet() {
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
  wish.run = link->server.name;
  wish.run_id = link->server.id;
  wish_again = {};
  return {};
}

// A wish that is written before the server's reader is found is lost.
Status InsightStream::Impl::KeepWishing() {
  if (MonotonicClock::now() < wish_again || link->wishes.matched_readers() == 0) return {};
  wish_again = MonotonicClock::now() + std::chrono::seconds(bus::kWishAgain);
  return Wish(bus::kWishStands);
}

InsightStream::InsightStream(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
InsightStream::InsightStream(InsightStream&&) noexcept = default;
InsightStream& InsightStream::operator=(InsightStream&&) noexcept = default;
InsightStream::~InsightStream() = default;

Result<InsightStream> InsightStream::Open(const bus::Participant& participant, const Selector& run,
                                          bus::InsightWish wish) {
  ETUDE_ASSIGN_OR_RETURN(auto directory, bus::Directory::Open(participant));
  return InsightStream(std::unique_ptr<Impl>(new Impl{&participant, run, std::move(wish), std::move(directory)}));
}

Result<std::vector<bus::Insight>> InsightStream::Take() {
  ETUDE_RETURN_IF_ERROR(impl_->Meet());
  if (!impl_->link) return std::vector<bus::Insight>();
  ETUDE_RETURN_IF_ERROR(impl_->KeepWishing());
  auto insights = impl_->link->insights.Take();
  std::erase_if(insights, [&](const bus::Insight& insight) { return insight.viewer != impl_->wish.viewer; });
  return insights;
}

std::optional<bus::Presence> InsightStream::server() const {
  return impl_->link ? std::optional(impl_->link->server) : std::nullopt;
}

}  // namespace etude::policy
