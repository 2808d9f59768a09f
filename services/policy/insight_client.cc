// SPDX-License-Identifier: Apache-2.0
#include "services/policy/insight_client.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <utility>

#include "services/core/clock.h"
#include "services/core/stop.h"
#include "services/policy/conversation.h"
#include "services/policy/conversion.h"

namespace etude::policy {
namespace {

using namespace std::chrono_literals;

constexpr auto kTurn = 1000ms / bus::kInsightsPerSecond;
constexpr auto kMeet = 10s;  // for readers and writers to find each other

// With the server that is looked into.
struct Connection {
  Conversation<bus::Insight> talk;
  bus::Writer<bus::InsightWish> wishes;
};

}  // namespace

struct InsightClient::Impl {
  const bus::Participant* participant = nullptr;
  Selector run;
  std::string base;  // of the names
  std::string name;  // as a viewer, and of its session
  InsightClientOptions options;
  bus::Directory directory;
  std::optional<Connection> connection = {};
  std::string given_up = {};  // why nothing is asked any more
  std::uint64_t request_id = 0;
  std::string what_if = {};
  std::uint64_t what_ifs = 0;  // different ones so far
  MonotonicClock::time_point turn = {}, wish_again = {};

  ~Impl() {
    if (connection) (void)Wish(0);
  }
  Status Connect();
  bool ServerWasReplaced();
  void Suppose(const std::string& what_if_json);
  Status Wish(std::uint32_t seconds);
  Result<bus::Insight> Ask(bus::Observation observation);
  std::optional<bus::Insight> Await(std::uint64_t first);
};

Status InsightClient::Impl::Connect() {
  ETUDE_ASSIGN_OR_RETURN(auto talk,
                         Conversation<bus::Insight>::Begin(*participant, directory, run, {options.server, kMeet}));
  if (!talk)
    return Fail(Code::kUnavailable, fmt::format("look into the policy of run '{}': no policy server within {} s",
                                                run.text(), options.server.count() / 1000.0));
  const std::string partition = bus::Owner{talk->server.name, talk->server.id}.partition();
  ETUDE_ASSIGN_OR_RETURN(auto wishes, bus::Writer<bus::InsightWish>::Open(*participant, partition));
  // a wish that is written before the server's reader is found is lost
  wishes.WaitForReaders(1, kMeet);
  connection.emplace(Connection{std::move(*talk), std::move(wishes)});
  wish_again = {};
  return {};
}

// One that was started again answers only those who name it.
bool InsightClient::Impl::ServerWasReplaced() {
  const auto& known = connection->talk.server;
  const auto live = directory.Matching(bus::PresenceKind::kPolicy, {known.name, known.id});
  return !live.empty() && live.front().instance != known.instance;
}

Status InsightClient::Impl::Wish(std::uint32_t seconds) {
  bus::InsightWish wish;
  wish.run = connection->talk.server.name;
  wish.run_id = connection->talk.server.id;
  wish.viewer = wish.session = name;
  wish.seconds = seconds;
  wish.what_if_json = what_if;
  wish_again = MonotonicClock::now() + std::chrono::seconds(bus::kWishAgain);
  return connection->wishes.Write(wish);
}

// An insight does not say to which wish it belongs, and wishes and observations may overtake each other: another name
// tells them apart.
void InsightClient::Impl::Suppose(const std::string& what_if_json) {
  if (what_if_json == what_if) return;
  if (connection) (void)Wish(0);
  what_if = what_if_json;
  name = fmt::format("{}-{}", base, ++what_ifs);
  wish_again = {};
}

// An insight into this question, from whichever try since `first`: the answer to each is the same.
std::optional<bus::Insight> InsightClient::Impl::Await(std::uint64_t first) {
  return connection->talk.Await(options.again, [&](const bus::Insight& insight) {
    const bool ours = insight.viewer == name && insight.session == name;
    return ours && insight.request_id >= first && insight.request_id <= request_id;
  });
}

Result<bus::Insight> InsightClient::Impl::Ask(bus::Observation observation) {
  if (connection && ServerWasReplaced()) connection.reset();
  if (!connection) ETUDE_RETURN_IF_ERROR(Connect());
  observation.run = connection->talk.server.name;
  observation.run_id = connection->talk.server.id;
  observation.server = connection->talk.server.instance;
  observation.session = name;
  observation.host = participant->address();
  const std::uint64_t first = request_id + 1;
  const auto deadline = MonotonicClock::now() + options.patience;
  while (!StopRequested() && MonotonicClock::now() < deadline) {
    if (MonotonicClock::now() >= wish_again) ETUDE_RETURN_IF_ERROR(Wish(bus::kWishStands));
    WaitForStop(std::max<std::chrono::nanoseconds>(turn - MonotonicClock::now(), 0ns));
    observation.request_id = ++request_id;
    ETUDE_RETURN_IF_ERROR(connection->talk.observations.Write(observation));
    auto insight = Await(first);
    if (!insight) continue;
    turn = MonotonicClock::now() + kTurn;
    return std::move(*insight);
  }
  if (StopRequested()) return Fail(Code::kTimeout, "look into a policy: this process was asked to stop");
  return Fail(Code::kUnavailable, fmt::format("look into the policy of run '{}': no insight within {} s", run.text(),
                                              options.patience.count() / 1000.0));
}

InsightClient::InsightClient(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
InsightClient::InsightClient(InsightClient&&) noexcept = default;
InsightClient& InsightClient::operator=(InsightClient&&) noexcept = default;
InsightClient::~InsightClient() = default;

Result<InsightClient> InsightClient::Open(const bus::Participant& participant, const std::string& run,
                                          const InsightClientOptions& options) {
  ETUDE_ASSIGN_OR_RETURN(auto selector, ParseSelector(run, "look into the policy of run"));
  ETUDE_ASSIGN_OR_RETURN(auto directory, bus::Directory::Open(participant));
  const std::string base = "insight-" + bus::UniquePeerName();
  return InsightClient(
      std::unique_ptr<Impl>(new Impl{&participant, std::move(selector), base, base, options, std::move(directory)}));
}

Result<Insight> InsightClient::Ask(const Question& question, const std::string& what_if_json) {
  if (!impl_->given_up.empty()) return Fail(Code::kUnavailable, impl_->given_up);
  impl_->Suppose(what_if_json);
  const auto message = impl_->Ask(ObservationOf(question));
  if (!message) {
    if (!StopRequested()) impl_->given_up = message.error().message;
    return Fail(message.error());
  }
  return ReadInsight(*message);
}

}  // namespace etude::policy
