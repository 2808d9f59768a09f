// SPDX-License-Identifier: Apache-2.0
// Tests services/policy/client.cc against policy servers by hand, over real DDS.
#include "services/policy/client.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "services/bus/topic.h"
#include "services/core/stop.h"
#include "tests/services/policy/policy_asker.h"

namespace etude::policy {
namespace client_test {

using namespace std::chrono_literals;

constexpr char kOne[] = "aaaa000000000001";
constexpr char kOther[] = "bbbb000000000002";

// Answers every observation of a run with its own checkpoint step.
class FakeServer {
 public:
  FakeServer(const bus::Participant& participant, const std::string& name, const std::string& id, std::uint64_t step)
      : presence_(AnnounceServer(participant, name, id)),
        actions_(
            bus::Writer<bus::Action>::Open(participant, bus::Owner{name, id}.address_partition(participant.address()))
                .value()),
        observations_(bus::Reader<bus::Observation>::Open(participant, bus::Owner{name, id}.partition()).value()),
        thread_([this, step](const std::stop_token& stop) {
          while (!stop.stop_requested())
            if (observations_.Wait(20ms))
              for (const auto& observation : observations_.Take()) Answer(observation, step);
        }) {}
  ~FakeServer() {
    thread_.request_stop();
    thread_.join();
  }

  std::atomic<int> asked{0};
  bus::Observation last;  // read after its answer and `asked`
  std::atomic<const char*> rotation = kRotationFormat;
  std::atomic<std::uint64_t> late{0};  // answers of this many first questions come with the next one's
  std::atomic<bus::Refusal> refusal = bus::Refusal::kNone;  // both set before the first question

 private:
  void Answer(const bus::Observation& observation, std::uint64_t step) {
    last = observation;
    ++asked;
    bus::Action action;
    action.run = observation.run;
    action.run_id = observation.run_id;
    action.session = observation.session;
    action.request_id = observation.request_id;
    action.checkpoint_step = step;
    action.rotation = rotation;
    action.server_p99_ms = 12.5f;
    action.refusal = refusal;
    if (refusal != bus::Refusal::kNone) action.error = "robot: ur5 here, panda there";
    const auto waypoint = ToVector(Waypoint{});
    for (int k = 0; k < kWaypoints; ++k)
      action.waypoints.insert(action.waypoints.end(), waypoint.begin(), waypoint.end());
    held_.push_back(action);
    if (late > 0) return void(--late);
    for (const auto& one : held_) EXPECT_TRUE(actions_.Write(one));
    held_.clear();
  }

  std::vector<bus::Action> held_;
  bus::Announcement presence_;
  bus::Writer<bus::Action> actions_;
  bus::Reader<bus::Observation> observations_;
  std::jthread thread_;
};

class PolicyClient : public PolicyAsker {
 protected:
  // `answer`: so long that on a busy machine, too, a server that is there is asked once
  Result<Client> OpenClient(const std::string& run, std::chrono::milliseconds answer = 10s) {
    return Client::Open(participant_, run, bus::UniquePeerName(), {.answer = answer, .patience = 20s});
  }
};

// Two quickstarts of one host: the second one's table came from the first one's policy.
TEST_F(PolicyClient, IsAnsweredByTheServerOfItsRunAndNoOther) {
  FakeServer one(participant_, "twins", kOne, 571), other(participant_, "twins", kOther, 396);
  for (const auto& [id, step] : {std::pair(kOne, 571u), std::pair(kOther, 396u)}) {
    auto client = OpenClient(std::string("twins@") + id);
    ASSERT_TRUE(client);
    for (int k = 0; k < 5; ++k) {
      const auto answer = client->Ask(MakeQuestion());
      ASSERT_TRUE(answer) << answer.error().message;
      EXPECT_EQ(answer->checkpoint_step, step);
    }
  }
  EXPECT_EQ(one.asked, 5);
  EXPECT_EQ(other.asked, 5);

  auto unclear = OpenClient("twins");
  ASSERT_TRUE(unclear);
  const auto answer = unclear->Ask(MakeQuestion());
  ASSERT_FALSE(answer);
  EXPECT_EQ(answer.error().code, Code::kInvalidArgument);
  for (const char* text : {kOne, kOther, "NAME@ID"})
    EXPECT_NE(answer.error().message.find(text), std::string::npos) << answer.error().message;
}

// a server that needs longer than the client's patience for one try answers the question all the same
TEST_F(PolicyClient, TakesTheAnswerToAnEarlierTry) {
  FakeServer server(participant_, "slow", kOne, 7);
  server.late = 2;
  auto client = OpenClient(std::string("slow@") + kOne, 1s);
  ASSERT_TRUE(client);
  const auto answer = client->Ask(MakeQuestion());
  ASSERT_TRUE(answer) << answer.error().message;
  EXPECT_EQ(answer->checkpoint_step, 7u);
  EXPECT_GE(server.asked, 3);
}

// two servers of one run may serve different checkpoints: a robot is not driven by both
TEST_F(PolicyClient, NamesTheServerThatItAsks) {
  FakeServer server(participant_, "named", kOne, 1);
  auto client = OpenClient(std::string("named@") + kOne);
  ASSERT_TRUE(client);
  ASSERT_TRUE(client->Ask(MakeQuestion()));
  ASSERT_EQ(server.asked, 1);
  EXPECT_EQ(server.last.server.size(), 16u);
}

TEST_F(PolicyClient, GoesOnWithTheNextServerOfItsName) {
  auto client = OpenClient("next", 1s);  // after which it looks whether the server has gone
  ASSERT_TRUE(client);
  {
    FakeServer first(participant_, "next", kOne, 1);
    const auto answer = client->Ask(MakeQuestion());
    ASSERT_TRUE(answer) << answer.error().message;
    EXPECT_EQ(answer->checkpoint_step, 1u);
  }
  FakeServer second(participant_, "next", kOther, 2);
  const auto answer = client->Ask(MakeQuestion());
  ASSERT_TRUE(answer) << answer.error().message;
  EXPECT_EQ(answer->checkpoint_step, 2u);
}

TEST_F(PolicyClient, TheObservationCarriesItsCameraAndTheAnswerItsLatency) {
  FakeServer server(participant_, "camera", kOne, 1);
  auto client = OpenClient("camera");
  ASSERT_TRUE(client);
  Question question = MakeQuestion();
  question.robot = "ur5";
  question.camera.emplace();
  question.camera->width = question.camera->height = 4;
  question.camera->X_WC.p = {0.5, 1.5, 1.0};
  const auto answer = client->Ask(question);
  ASSERT_TRUE(answer) << answer.error().message;
  EXPECT_EQ(answer->server_p99_ms, 12.5);
  ASSERT_EQ(server.asked, 1);
  const double focal = question.camera->focal();
  EXPECT_EQ(server.last.intrinsics, (std::vector<double>{focal, focal, 2, 2}));
  EXPECT_EQ(server.last.camera_pose, (std::vector<double>{0.5, 1.5, 1.0, 1, 0, 0, 0}));
  EXPECT_EQ(server.last.robot, "ur5");
  EXPECT_EQ(server.last.host, participant_.address());
  EXPECT_EQ(server.last.run_id, kOne);
}

TEST_F(PolicyClient, WhatItWasNotTrainedForIsNotAskedAgain) {
  FakeServer server(participant_, "panda", kOne, 1);
  server.refusal = bus::Refusal::kDoesNotFit;
  auto client = OpenClient("panda");
  ASSERT_TRUE(client);
  const auto answer = client->Ask(MakeQuestion());
  ASSERT_FALSE(answer);
  EXPECT_EQ(answer.error().code, Code::kInvalidArgument);
  EXPECT_NE(answer.error().message.find("ur5 here, panda there"), std::string::npos) << answer.error().message;
  EXPECT_EQ(server.asked, 1);
}

// a network whose numbers are none says so again to the same picture, however long it is asked
TEST_F(PolicyClient, WhatThePolicyHasNoAnswerToIsNotAskedAgain) {
  FakeServer server(participant_, "broken", kOne, 1);
  server.refusal = bus::Refusal::kFailed;
  auto client = OpenClient("broken");
  ASSERT_TRUE(client);
  const auto answer = client->Ask(MakeQuestion());
  ASSERT_FALSE(answer);
  EXPECT_EQ(answer.error().code, Code::kCorrupt);
  EXPECT_EQ(server.asked, 1);
}

TEST_F(PolicyClient, RotationsWrittenInAnotherWayAreRefused) {
  FakeServer server(participant_, "rotation", kOne, 1);
  server.rotation = "quaternion";
  auto client = OpenClient("rotation");
  ASSERT_TRUE(client);
  const auto answer = client->Ask(MakeQuestion());
  ASSERT_FALSE(answer);
  EXPECT_EQ(answer.error().code, Code::kInvalidArgument);
  EXPECT_NE(answer.error().message.find("'quaternion'"), std::string::npos) << answer.error().message;
}

TEST_F(PolicyClient, AWrongNameIsAnErrorAtOnce) {
  for (const char* run : {"", "Two Words", "run@", "run@xyz"}) EXPECT_FALSE(OpenClient(run)) << run;
}

}  // namespace client_test
}  // namespace etude::policy
