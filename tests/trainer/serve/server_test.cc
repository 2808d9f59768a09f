// SPDX-License-Identifier: Apache-2.0
// Tests trainer/serve/server.cc: published, subscribed, swapped and answered over real DDS.
#include "trainer/serve/server.h"

#include <gtest/gtest.h>

#include <thread>

#include "services/bus/topic.h"
#include "services/episode/action.h"
#include "tests/trainer/serve/example_observation.h"
#include "trainer/publish/sink.h"

namespace etude::serve {
namespace {

using namespace std::chrono_literals;
constexpr std::uint32_t kDomain = 76;

/// A robot that asks and waits for the answer.
class Client {
 public:
  static Client Open(const bus::Participant& participant, const std::string& run) {
    return {bus::Writer<bus::Observation>::Open(participant, run).value(),
            bus::Reader<bus::Action>::Open(participant, run).value()};
  }
  bool WaitForServer() { return writer.WaitForReaders(1, 30s); }
  bus::Action Ask(const bus::Observation& observation) {
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
};

TEST(PolicyServer, TakesOverNewCheckpointsAndKeepsTheLastGoodOne) {
  const TemporaryFolder folder;
  const auto config = learn::TinyConfig();
  const std::string run = "serve-demo";
  auto participant = bus::Participant::Open({kDomain, ""}).value();
  auto sink = publish::CheckpointSink::Open(folder.path(), run, &participant).value();
  auto server = PolicyServer::Open(participant, {run, "latest", 2}, nullptr).value();
  ASSERT_TRUE(server.Follow());
  std::thread serving([&] { EXPECT_TRUE(server.Run()); });
  Client client = Client::Open(participant, run);

  // the first checkpoint
  ASSERT_TRUE(sink.Save(publish::ExampleRequest(config, 100, 1)));
  ASSERT_TRUE(client.WaitForServer());
  auto observation = ExampleObservation(1, run);
  const auto first = client.Ask(observation);
  EXPECT_EQ(first.error, "");
  EXPECT_EQ(first.checkpoint_step, 100u);
  EXPECT_EQ(first.waypoints.size(), static_cast<std::size_t>(kWaypoints * kWaypointSize));

  // a malformed observation is answered, and the next one too
  auto odd = ExampleObservation(2, run);
  odd.joints.clear();
  EXPECT_NE(client.Ask(odd).error, "");

  // one that does not fit is refused; the first serves on
  auto publisher = bus::ObjectPublisher::Open(participant, run).value();
  const std::vector<std::uint8_t> nonsense(1000, 7);
  ASSERT_TRUE(publisher.Publish("latest", std::uint64_t{1} << 60, nonsense, "{}"));
  const auto deadline = std::chrono::steady_clock::now() + 20s;
  while (server.refused_checkpoints() == 0 && std::chrono::steady_clock::now() < deadline) std::this_thread::yield();
  EXPECT_EQ(server.refused_checkpoints(), 1u);
  observation.request_id = 10;
  EXPECT_EQ(client.Ask(observation).checkpoint_step, 100u);

  // a newer one takes over, with other answers
  const auto bytes = publish::EncodeCheckpoint(publish::ExampleRequest(config, 200, 2), run).value();
  ASSERT_TRUE(publisher.Publish("latest", (std::uint64_t{1} << 60) + 1, bytes, "{}"));
  bus::Action later;
  for (std::uint64_t id = 11; later.checkpoint_step != 200 && std::chrono::steady_clock::now() < deadline; ++id) {
    observation.request_id = id;
    later = client.Ask(observation);
  }
  EXPECT_EQ(later.checkpoint_step, 200u);
  EXPECT_NE(later.waypoints, first.waypoints);

  server.Stop();
  serving.join();
  EXPECT_GE(server.answered(), 4u);
}

TEST(PolicyServer, AnswersManyClientsAsIfEachWereAlone) {
  const auto config = learn::TinyConfig();
  const std::string run = "serve-many";
  auto participant = bus::Participant::Open({kDomain, ""}).value();
  const auto model = Model::FromBytes(publish::EncodeCheckpoint(publish::ExampleRequest(config), run).value()).value();
  auto server = PolicyServer::Open(participant, {run, "latest", 2}, model).value();
  std::thread serving([&] { EXPECT_TRUE(server.Run()); });

  std::vector<std::thread> clients;
  for (std::uint64_t c = 0; c < 4; ++c) {
    clients.emplace_back([&, c] {
      Client client = Client::Open(participant, run);
      ASSERT_TRUE(client.WaitForServer());
      for (std::uint64_t i = 0; i < 5; ++i) {
        auto observation = ExampleObservation(100 * c + i, run);
        observation.session = "client-" + std::to_string(c);
        EXPECT_EQ(client.Ask(observation).waypoints, model->Answer(observation).waypoints);
      }
    });
  }
  for (auto& client : clients) client.join();
  server.Stop();
  serving.join();
}

}  // namespace
}  // namespace etude::serve
