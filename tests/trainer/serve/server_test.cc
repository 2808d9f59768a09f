// SPDX-License-Identifier: Apache-2.0
// Tests trainer/serve/server.cc, server_checkpoints.cc and server_desk.cc: published, subscribed, swapped and answered
// over real DDS.
#include "trainer/serve/server.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <limits>
#include <set>
#include <thread>

#include "services/bus/directory.h"
#include "services/bus/topic.h"
#include "services/episode/action.h"
#include "services/relay/kept_checkpoints.h"
#include "services/relay/relay_thread.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/wait_until.h"
#include "tests/trainer/policy/fixtures.h"
#include "tests/trainer/serve/example_observation.h"
#include "trainer/policy/parts.h"
#include "trainer/publish/sink.h"

namespace etude::serve {
namespace server_test {

using namespace std::chrono_literals;
constexpr std::uint32_t kDomain = 76;
constexpr char kId[] = "aaaa000000000001";

/// A robot that asks and waits for the answer.
class Client {
 public:
  static Client Open(const bus::Participant& participant, const Selector& run) {
    const bus::Owner owner{run.name, run.id};
    return {bus::Writer<bus::Observation>::Open(participant, owner.partition()).value(),
            bus::Reader<bus::Action>::Open(participant, owner.address_partition(participant.address())).value(),
            participant.address()};
  }
  bool WaitForServer() { return writer.WaitForReaders(1, 30s); }
  bus::Action Ask(bus::Observation observation) {
    observation.host = host;
    EXPECT_TRUE(writer.Write(observation));
    const auto deadline = std::chrono::steady_clock::now() + 20s;
    while (std::chrono::steady_clock::now() < deadline) {
      reader.Wait(500ms);
      for (auto& action : reader.Take())
        if (action.session == observation.session && action.request_id == observation.request_id) return action;
    }
    ADD_FAILURE() << "no answer to " << observation.session;
    return {};
  }

  bus::Writer<bus::Observation> writer;
  bus::Reader<bus::Action> reader;
  std::string host;
};

/// A run, a server that follows its checkpoints, and a robot that asks it.
class FollowedRun {
 public:
  FollowedRun(const std::string& name, int threads)
      : name_(name),
        server(PolicyServer::Open(participant, {.run = {name, kId}, .threads = threads}, nullptr).value()),
        sink(publish::CheckpointSink::Open(folder_.path(), {name, kId, 1}, &participant).value()),
        client(Client::Open(participant, {name, kId})) {
    EXPECT_TRUE(server.Follow());
    serving_ = std::thread([this] { EXPECT_TRUE(server.Run()); });
  }
  ~FollowedRun() {
    server.Stop();
    serving_.join();
  }
  bus::Observation Observe(std::uint64_t request) const { return ExampleObservation(request, name_, kId); }
  /// The first answer of that checkpoint, or the last one at the deadline.
  bus::Action AskUntil(std::uint64_t step) {
    bus::Action answer;
    for (std::uint64_t id = 10; answer.checkpoint_step != step && std::chrono::steady_clock::now() < deadline_; ++id)
      answer = AskAgain(id);
    return answer;
  }
  bus::Action AskAgain(std::uint64_t id) {
    auto observation = Observe(1);
    observation.request_id = id;
    return client.Ask(observation);
  }
  /// What the server says of itself once it serves that checkpoint.
  bus::PolicyStatus StatusOf(std::uint64_t step) {
    auto statuses = bus::Reader<bus::PolicyStatus>::Open(participant, bus::Owner{name_, kId}.partition());
    EXPECT_TRUE(statuses);
    bus::PolicyStatus status;
    while (status.step != step && statuses->Wait(20s))
      for (auto& taken : statuses->Take()) status = std::move(taken);
    return status;
  }
  void WaitForRefusals(std::uint64_t count) {
    WaitUntil([&] { return server.refused_checkpoints() >= count; });
    EXPECT_EQ(server.refused_checkpoints(), count);
  }

 private:
  const TemporaryFolder folder_;
  const std::string name_;
  const std::chrono::steady_clock::time_point deadline_ = std::chrono::steady_clock::now() + 60s;
  std::thread serving_;

 public:
  bus::Participant participant = bus::Participant::Open({kDomain, ""}).value();
  PolicyServer server;
  publish::CheckpointSink sink;
  Client client;
};

TEST(PolicyServer, TakesOverNewCheckpointsAndKeepsTheLastGoodOne) {
  const auto config = policy::TinyConfig();
  FollowedRun run("serve-demo", 2);

  // the first checkpoint
  ASSERT_TRUE(run.sink.Save(checkpoint::ExampleCheckpoint(config, 100, 1)));
  ASSERT_TRUE(run.client.WaitForServer());
  const auto first = run.client.Ask(run.Observe(1));
  EXPECT_EQ(first.error, "");
  EXPECT_EQ(first.checkpoint_step, 100u);
  EXPECT_EQ(first.waypoints.size(), static_cast<std::size_t>(kWaypoints * kWaypointSize));

  // a malformed observation is answered, and the next one too
  auto odd = run.Observe(2);
  odd.joints.clear();
  EXPECT_NE(run.client.Ask(odd).error, "");

  // one that does not fit is refused; the first serves on
  auto publisher = bus::BlobPublisher::Open(run.participant, {"serve-demo", kId}).value();
  const std::vector<std::uint8_t> nonsense(1000, 7);
  ASSERT_TRUE(publisher.Publish("latest", std::uint64_t{1} << 60, nonsense, "{}"));
  run.WaitForRefusals(1);
  EXPECT_EQ(run.AskAgain(9).checkpoint_step, 100u);

  // a newer one takes over, with other answers
  const auto bytes = checkpoint::Encode(checkpoint::ExampleCheckpoint(config, 200, 2)).value();
  ASSERT_TRUE(publisher.Publish("latest", (std::uint64_t{1} << 60) + 1, bytes, "{}"));
  const auto later = run.AskUntil(200);
  EXPECT_EQ(later.checkpoint_step, 200u);
  EXPECT_NE(later.waypoints, first.waypoints);

  // everyone can see which weights drive, and what was answered until then
  const bus::PolicyStatus status = run.StatusOf(200);
  EXPECT_GE(run.server.answered(), 4u);
  EXPECT_EQ(status.step, 200u);
  EXPECT_EQ(status.sha256, later.checkpoint_sha256);
  EXPECT_EQ(status.run_id, kId);
  EXPECT_EQ(status.channel, "latest");
  EXPECT_TRUE(status.control_trained);
  EXPECT_GE(status.answered, 4u);
  EXPECT_EQ(status.refused, 2u) << "a checkpoint and an observation";
  EXPECT_EQ(status.last_refusal, "") << "of the checkpoint before it: over";
  EXPECT_GE(status.sessions, 1u);
  EXPECT_GT(status.p95_ms, 0);
  EXPECT_GT(status.since, 0u);
}

TEST(PolicyServer, DrivesNothingWithWhatIsNotTrained) {
  const auto config = policy::TinyConfig();
  FollowedRun run("serve-early", 1);
  auto early = checkpoint::ExampleCheckpoint(config, 50);
  early.metadata.modules["CTRL"] = {};

  // nothing else is there: observations are answered with the refusal
  ASSERT_TRUE(run.sink.Save(early));
  ASSERT_TRUE(run.client.WaitForServer());
  const auto refusal = run.client.Ask(run.Observe(1));
  EXPECT_NE(refusal.error.find("CTRL has 0 trained steps"), std::string::npos) << refusal.error;
  EXPECT_EQ(refusal.refusal, bus::Refusal::kNotTrained);
  EXPECT_TRUE(refusal.waypoints.empty());

  // a trained one takes over, and another that is not does not
  ASSERT_TRUE(run.sink.Save(checkpoint::ExampleCheckpoint(config, 100)));
  const auto answer = run.AskUntil(100);
  EXPECT_EQ(answer.error, "");
  EXPECT_GT(run.server.latency().p99_ms, 0);
  EXPECT_GT(answer.server_p99_ms, 0);
  EXPECT_GE(answer.server_p99_ms, answer.server_p50_ms);
  early.metadata.step = 150;
  const auto refused = run.server.refused_checkpoints();
  ASSERT_TRUE(run.sink.Save(early));
  run.WaitForRefusals(refused + 1);
  EXPECT_EQ(run.AskAgain(1'000'000).checkpoint_step, 100u);
  // nor does one whose answers are no numbers
  auto broken = checkpoint::ExampleCheckpoint(config, 200);
  for (auto& [name, tensor] : broken.tensors)
    if (policy::PartOfTensor(name) == "CTRL")
      tensor = torch::full_like(tensor, std::numeric_limits<float>::quiet_NaN());
  ASSERT_TRUE(run.sink.Save(broken));
  run.WaitForRefusals(refused + 2);
  EXPECT_EQ(run.AskAgain(2'000'000).checkpoint_step, 100u);
}

TEST(PolicyServer, AnswersManyClientsAsIfEachWereAlone) {
  const auto config = policy::TinyConfig();
  const std::string run = "serve-many";
  auto participant = bus::Participant::Open({kDomain, ""}).value();
  const auto model = Model::FromBytes(checkpoint::Encode(checkpoint::ExampleCheckpoint(config)).value()).value();
  EXPECT_FALSE(PolicyServer::Open(participant, {.run = {run, ""}}, model)) << "which of that name?";
  const Selector many{run, kId};
  auto server = PolicyServer::Open(participant, {.run = many, .threads = 2}, model).value();
  std::thread serving([&] { EXPECT_TRUE(server.Run()); });

  std::vector<std::thread> clients;
  for (std::uint64_t c = 0; c < 4; ++c) {
    clients.emplace_back([&, c] {
      Client client = Client::Open(participant, many);
      ASSERT_TRUE(client.WaitForServer());
      for (std::uint64_t i = 0; i < 5; ++i) {
        auto observation = ExampleObservation(100 * c + i, run, kId);
        observation.session = "client-" + std::to_string(c);
        EXPECT_EQ(client.Ask(observation).waypoints, model->Answer(observation).waypoints);
      }
    });
  }
  for (auto& client : clients) client.join();
  server.Stop();
  serving.join();
}

// Two robots that name their sessions alike, on two hosts.
TEST(PolicyServer, AnswersEachHostInItsOwnPartition) {
  const auto config = policy::TinyConfig();
  const Selector run{"serve-hosts", kId};
  auto one = bus::Participant::Open({kDomain, "", "", {}, "rack-1"}).value();
  auto two = bus::Participant::Open({kDomain, "", "", {}, "rack-2"}).value();
  const auto model = Model::FromBytes(checkpoint::Encode(checkpoint::ExampleCheckpoint(config)).value()).value();
  auto server = PolicyServer::Open(one, {.run = run}, model).value();
  std::thread serving([&] { EXPECT_TRUE(server.Run()); });
  Client here = Client::Open(one, run), there = Client::Open(two, run);
  ASSERT_TRUE(here.WaitForServer() && there.WaitForServer());
  constexpr std::uint64_t kQuestions = 5;
  for (std::uint64_t i = 0; i < kQuestions; ++i)
    EXPECT_EQ(here.Ask(ExampleObservation(i, run.name, kId)).error, "") << i;
  EXPECT_TRUE(there.reader.Take().empty()) << "what the other host was told";
  EXPECT_EQ(there.Ask(ExampleObservation(1, run.name, kId)).error, "");
  EXPECT_TRUE(here.reader.Take().empty());
  server.Stop();
  serving.join();
}

// Two servers of one run may serve different checkpoints (latest and best): a robot is not driven by both.
TEST(PolicyServer, AnswersWhoAskedItAndNotAnotherServerOfTheRun) {
  const auto config = policy::TinyConfig();
  const Selector run{"serve-two", kId};
  auto participant = bus::Participant::Open({kDomain, ""}).value();
  const auto serve = [&](std::uint64_t step) {
    const auto bytes = checkpoint::Encode(checkpoint::ExampleCheckpoint(config, step)).value();
    return PolicyServer::Open(participant, {.run = run}, Model::FromBytes(bytes).value()).value();
  };
  auto one = serve(1), two = serve(2);
  std::thread serving_one([&] { EXPECT_TRUE(one.Run()); }), serving_two([&] { EXPECT_TRUE(two.Run()); });
  Client client = Client::Open(participant, run);
  ASSERT_TRUE(client.writer.WaitForReaders(2, 30s));
  auto directory = bus::Directory::Open(participant).value();
  std::vector<bus::Presence> servers;
  const auto both = [&] {
    servers = directory.Live();
    std::erase_if(servers, [&](const auto& presence) { return presence.name != run.name; });
    return servers.size() == 2;
  };
  EXPECT_TRUE(WaitUntil(both));

  std::set<std::uint64_t> steps;
  std::uint64_t request = 0;
  for (const auto& server : servers) {
    std::set<std::uint64_t> of_server;
    for (int i = 0; i < 5; ++i) {
      auto observation = ExampleObservation(++request, run.name, kId);
      observation.server = server.instance;
      of_server.insert(client.Ask(observation).checkpoint_step);
    }
    EXPECT_EQ(of_server.size(), 1u);
    steps.merge(of_server);
  }
  EXPECT_EQ(steps, (std::set<std::uint64_t>{1, 2}));
  one.Stop();
  two.Stop();
  serving_one.join();
  serving_two.join();
  EXPECT_EQ(one.answered(), 5u);
  EXPECT_EQ(two.answered(), 5u);
}

// A run that was begun anew counts its versions from the start; its subscribers used to take them for old.
TEST(PolicyServer, FollowsARunThatWasBegunAnew) {
  const TemporaryFolder folder;
  const auto config = policy::TinyConfig();
  const std::string run = "serve-anew";
  auto participant = bus::Participant::Open({kDomain, ""}).value();
  const auto begin = [&](const std::string& id, const char* where, std::uint64_t step) {
    auto presence = bus::Announcement::Open(
        participant, bus::MakePresence(bus::PresenceKind::kRun, run, id, folder / where), Claim::kRefuse);
    EXPECT_TRUE(presence) << presence.error().message;
    auto sink = publish::CheckpointSink::Open(folder / where, {run, id, step}, &participant).value();
    EXPECT_TRUE(sink.Save(checkpoint::ExampleCheckpoint(config, step)));
    return std::pair(std::move(*presence), std::move(sink));
  };
  auto server = PolicyServer::Open(participant, {.run = {run, ""}}, nullptr).value();
  ASSERT_TRUE(server.Follow());
  std::thread serving([&] { EXPECT_TRUE(server.Run()); });
  const auto wait_for = [&](std::uint64_t step) {
    EXPECT_TRUE(WaitUntil([&] { return server.checkpoint_step() == step; })) << server.checkpoint_step();
  };
  {
    const auto before = begin("aaaa000000000001", "before", 3);
    wait_for(3);
  }
  const auto anew = begin("bbbb000000000002", "anew", 1);
  wait_for(1);

  Client client = Client::Open(participant, {run, "bbbb000000000002"});
  ASSERT_TRUE(client.WaitForServer());
  const auto observation = ExampleObservation(1, run, "bbbb000000000002");
  const auto action = client.Ask(observation);
  EXPECT_EQ(action.checkpoint_step, 1u);
  EXPECT_EQ(action.run_id, "bbbb000000000002");
  server.Stop();
  serving.join();
}

// before, a run that had only begun took the robots from a trained policy when that one's run ended
TEST(PolicyServer, ARunThatMayNotDriveYetTakesNoPlaceOfAnotherRunThatMay) {
  const TemporaryFolder folder;
  const auto config = policy::TinyConfig();
  const std::string run = "serve-young";
  auto participant = bus::Participant::Open({kDomain, ""}).value();
  const auto begin = [&](const std::string& id, const char* where, const checkpoint::Checkpoint& made) {
    auto presence = bus::Announcement::Open(
        participant, bus::MakePresence(bus::PresenceKind::kRun, run, id, folder / where), Claim::kRefuse);
    EXPECT_TRUE(presence) << presence.error().message;
    auto sink = publish::CheckpointSink::Open(folder / where, {run, id, 1}, &participant).value();
    EXPECT_TRUE(sink.Save(made));
    return std::pair(std::move(*presence), std::move(sink));
  };
  auto server = PolicyServer::Open(participant, {.run = {run, ""}}, nullptr).value();
  ASSERT_TRUE(server.Follow());
  std::thread serving([&] { EXPECT_TRUE(server.Run()); });
  {
    const auto trained = begin("aaaa000000000001", "trained", checkpoint::ExampleCheckpoint(config, 3));
    EXPECT_TRUE(WaitUntil([&] { return server.checkpoint_step() == 3; }));
  }
  auto early = checkpoint::ExampleCheckpoint(config, 1);
  early.metadata.modules["CTRL"] = {};
  const auto young = begin("bbbb000000000002", "young", early);
  WaitUntil([&] { return server.refused_checkpoints() > 0; });

  EXPECT_EQ(server.refused_checkpoints(), 1u);
  EXPECT_EQ(server.checkpoint_step(), 3u);
  Client client = Client::Open(participant, {run, "aaaa000000000001"});
  ASSERT_TRUE(client.WaitForServer());
  EXPECT_EQ(client.Ask(ExampleObservation(1, run, "aaaa000000000001")).checkpoint_step, 3u);
  server.Stop();
  serving.join();
}

// As `etude up --keep-running` after training: whoever starts its policy server again finds a run that has ended.
TEST(PolicyServer, StartedAfterTheRunHasEndedItServesWhatARelayHas) {
  const TemporaryFolder folder;
  const std::string run = "serve-outlived";
  auto participant = bus::Participant::Open({kDomain, ""}).value();
  const relay::RelayThread relay(participant, {run, kId}, {.folder = folder / "relay", .patience = 50ms});
  {
    auto sink = publish::CheckpointSink::Open(folder / "run", {run, kId, 1}, &participant).value();
    ASSERT_TRUE(sink.Save(checkpoint::ExampleCheckpoint(policy::TinyConfig(), 7)));
    ASSERT_TRUE(WaitUntil([&] { return std::filesystem::exists(folder / "relay" / "kept.json"); }));
  }
  for (const char* id : {kId, ""}) {  // by its whole id, and by its name, which the relay has in the directory
    auto server = PolicyServer::Open(participant, {.run = {run, id}}, nullptr).value();
    ASSERT_TRUE(server.Follow());
    std::thread serving([&] { EXPECT_TRUE(server.Run()); });
    EXPECT_TRUE(WaitUntil([&] { return server.checkpoint_step() == 7; })) << id << ": " << server.checkpoint_step();
    server.Stop();
    serving.join();
  }
}

// started again, it took the other user's run of the name for the one that it had served
TEST(PolicyServer, StartedAgainItDoesNotGoOnWithAnotherUsersRun) {
  const TemporaryFolder folder;
  const std::string run = "serve-shared", theirs = "bbbb000000000002";
  auto participant = bus::Participant::Open({kDomain, ""}).value();
  const relay::RelayThread relay(participant, {run, kId}, {.folder = folder / "relay", .patience = 50ms});
  {
    const auto mine = bus::Announcement::Open(
        participant, bus::MakePresence(bus::PresenceKind::kRun, run, kId, folder / "run"), Claim::kRefuse);
    ASSERT_TRUE(mine) << mine.error().message;
    auto sink = publish::CheckpointSink::Open(folder / "run", {run, kId, 1}, &participant).value();
    ASSERT_TRUE(sink.Save(checkpoint::ExampleCheckpoint(policy::TinyConfig(), 7)));
    ASSERT_TRUE(WaitUntil([&] { return std::filesystem::exists(folder / "relay" / "kept.json"); }));
  }
  auto presence = bus::MakePresence(bus::PresenceKind::kRun, run, theirs, folder / "theirs");
  presence.user = "somebody-else";
  const auto there = bus::Announcement::Open(participant, presence, Claim::kRefuse);
  ASSERT_TRUE(there) << there.error().message;
  auto sink = publish::CheckpointSink::Open(folder / "theirs", {run, theirs, 1}, &participant).value();
  ASSERT_TRUE(sink.Save(checkpoint::ExampleCheckpoint(policy::TinyConfig(), 9)));

  const auto before = relay::KeptRun(folder / "relay");
  ASSERT_TRUE(before && *before);
  auto server = PolicyServer::Open(participant, {.run = {run, ""}, .before = *before}, nullptr).value();
  ASSERT_TRUE(server.Follow());
  std::thread serving([&] { EXPECT_TRUE(server.Run()); });
  WaitUntil([&] { return server.checkpoint_step() != 0; });
  EXPECT_EQ(server.checkpoint_step(), 7u);
  server.Stop();
  serving.join();
}

}  // namespace server_test
}  // namespace etude::serve
