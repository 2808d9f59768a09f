// SPDX-License-Identifier: Apache-2.0
// Tests trainer/serve/robots.cc and server.cc: robots in a DDS domain of their own, with another authority than workers
// and trainers have; over real DDS.
#include "trainer/serve/robots.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <thread>

#include "services/bus/directory.h"
#include "services/bus/owner.h"
#include "services/bus/topic.h"
#include "services/core/identity.h"
#include "services/policy/client.h"
#include "tests/services/bus/two_processes.h"
#include "tests/support/authority.h"
#include "tests/support/matchers.h"
#include "tests/support/wait_until.h"
#include "tests/trainer/policy/fixtures.h"
#include "tests/trainer/serve/example_question.h"
#include "trainer/serve/server.h"

namespace etude::serve {
namespace robots_test {

using namespace std::chrono_literals;
using security::Role;

// What they are called outside of this process (two_processes.h).
constexpr std::uint32_t kRun = 79, kRobots = 89;
constexpr char kId[] = "eeee000000000005";

std::string ProfileOf(std::uint32_t outside) {
  return bus::LocalProfileWith("<ExternalDomainId>" + std::to_string(outside) + "</ExternalDomainId>");
}

// As a process of its own: each has another number inside.
bus::Participant Join(std::uint32_t inside, std::uint32_t outside, const std::string& identity = {},
                      const std::string& host = {}) {
  auto participant = bus::Participant::Open({inside, ProfileOf(outside), identity, {}, host});
  EXPECT_THAT(participant, IsOk());
  return std::move(*participant);
}

// Of a policy that is asked once; the longer it may take, the longer nobody answers.
Status AskOnce(const bus::Participant& participant, const std::string& run, std::chrono::milliseconds patience) {
  const policy::ClientOptions options{.answer = 500ms, .patience = patience};
  ETUDE_ASSIGN_OR_RETURN(auto client, policy::Client::Open(participant, run, "asks", options));
  std::vector<std::uint8_t> picture;
  ETUDE_RETURN_IF_ERROR(client.Ask(ExampleQuestion(1, picture)));
  return {};
}

// A server in both domains.
class Serving {
 public:
  Serving(const bus::Participant& run, const bus::Participant& robots, const Selector& selector)
      : server_(PolicyServer::Open(
                    run, {.run = selector, .robots = &robots},
                    Model::FromBytes(checkpoint::Encode(checkpoint::ExampleCheckpoint(policy::TinyConfig())).value())
                        .value())
                    .value()),
        thread_([this] { EXPECT_THAT(server_.Run(), IsOk()); }) {}
  ~Serving() {
    server_.Stop();
    thread_.join();
  }
  const PolicyServer& server() const { return server_; }

 private:
  PolicyServer server_;
  std::thread thread_;
};

// An answer is counted after it was sent: its asker may have it before.
bool WaitForAnswered(const PolicyServer& server, std::uint64_t count) {
  return WaitUntil([&] { return server.answered() >= count; });
}

// Once nobody asks any more: the answer to a question that was asked twice may be counted long after the first one.
std::uint64_t AnsweredAtRest(const PolicyServer& server) {
  std::uint64_t before = 0, answered = server.answered();
  do {
    before = answered;
    std::this_thread::sleep_for(1s);
    answered = server.answered();
  } while (answered != before);
  return answered;
}

TEST(RobotDomain, IsAnsweredBesideTheRunsOwn) {
  const auto of_run = Join(150, kRun), of_robots = Join(151, kRobots);
  const auto worker = Join(152, kRun, "", "worker"), robot = Join(153, kRobots, "", "robot");
  const Selector run{"robots", kId};
  const auto trains =
      bus::Announcement::Open(of_run, bus::MakePresence(bus::PresenceKind::kRun, run.name, kId, ""), Claim::kRefuse);
  ASSERT_THAT(trains, IsOk());
  const Serving serving(of_run, of_robots, run);

  EXPECT_THAT(AskOnce(robot, run.name, 30s), IsOk());
  EXPECT_THAT(AskOnce(worker, run.name, 30s), IsOk());
  EXPECT_TRUE(WaitForAnswered(serving.server(), 2)) << serving.server().answered();

  // of what is in the run's domain the robots see the policy server alone
  auto directory = bus::Directory::Open(robot);
  ASSERT_THAT(directory, IsOk());
  const auto policy = directory->Find(bus::PresenceKind::kPolicy, run, 20s);
  ASSERT_THAT(policy, IsOk());
  EXPECT_TRUE(*policy);
  EXPECT_TRUE(directory->Matching(bus::PresenceKind::kRun, run).empty());
}

TEST(RobotDomain, IsNotTheRunsOwn) {
  const auto participant = Join(150, kRun);
  const auto model =
      Model::FromBytes(checkpoint::Encode(checkpoint::ExampleCheckpoint(policy::TinyConfig())).value()).value();
  EXPECT_THAT(PolicyServer::Open(participant, {.run = {"robots", kId}, .robots = &participant}, model),
              HasCode(Code::kInvalidArgument));
}

// Who has an identity of the one authority gets no further in the other one's domain than a stranger.
TEST(RobotDomain, WithAnAuthorityOfItsOwnLetsNobodyElseIn) {
  const Authority ours, robots;
  const auto of_run = Join(150, kRun, ours.Issue("policy", Role::kPolicy));
  const auto of_robots = Join(151, kRobots, robots.Issue("policy", Role::kPolicy));
  const Selector run{"apart", kId};
  const Serving serving(of_run, of_robots, run);

  const auto robot = Join(152, kRobots, robots.Issue("arm-1", Role::kRobot));
  ASSERT_THAT(AskOnce(robot, run.name, 30s), IsOk());
  const auto worker = Join(153, kRun, ours.Issue("rack-1", Role::kWorker));
  ASSERT_THAT(AskOnce(worker, run.name, 30s), IsOk());
  const auto answered = AnsweredAtRest(serving.server());

  const auto stolen_worker = Join(154, kRobots, ours.Issue("rack-2", Role::kWorker));
  const auto false_policy = Join(155, kRobots, ours.Issue("policy-2", Role::kPolicy));
  const auto stolen_robot = Join(156, kRun, robots.Issue("arm-2", Role::kRobot));
  EXPECT_THAT(AskOnce(stolen_worker, run.name, 3s), HasCode(Code::kUnavailable));
  EXPECT_THAT(AskOnce(stolen_robot, run.name, 3s), HasCode(Code::kUnavailable));
  EXPECT_EQ(serving.server().answered(), answered);
  // nor can it answer a robot in the policy server's place
  auto actions =
      bus::Writer<bus::Action>::Open(false_policy, bus::Owner{run.name, run.id}.address_partition(robot.address()));
  ASSERT_THAT(actions, IsOk());
  const auto told =
      bus::Reader<bus::Action>::Open(robot, bus::Owner{run.name, run.id}.address_partition(robot.address()));
  ASSERT_THAT(told, IsOk());
  EXPECT_FALSE(actions->WaitForReaders(1, 1500ms));
}

TEST(RobotDomain, IsCheckedBeforeItIsJoined) {
  const Authority ours, theirs;
  const std::string policy = ours.Issue("policy", Role::kPolicy), again = ours.Issue("again", Role::kPolicy);
  const std::string among_robots = theirs.Issue("policy", Role::kPolicy);

  EXPECT_THAT(CheckRobotDomain({}, {}), IsOk());
  EXPECT_THAT(CheckRobotDomain({.domain = 9}, {}), IsOk());
  EXPECT_THAT(CheckRobotDomain({.domain = 9, .security = among_robots}, {.security = policy}), IsOk());
  EXPECT_THAT(CheckRobotDomain({.domain = 9, .security = among_robots}, {.verifies = true}), IsOk());

  EXPECT_THAT(CheckRobotDomain({.domain = 9}, {.domain = 9}), MessageHas("the run's own"));
  EXPECT_THAT(CheckRobotDomain({.security = among_robots}, {}), MessageHas("--robot-domain"));
  EXPECT_THAT(CheckRobotDomain({.domain = 9}, {.security = policy}), MessageHas("without --robot-security"));
  EXPECT_THAT(CheckRobotDomain({.domain = 9, .security = again}, {.security = policy}),
              MessageHas("are of one authority"));
  EXPECT_THAT(CheckRobotDomain({.domain = 9, .security = "nowhere"}, {.security = policy}), MessageHas("nowhere"));
  const auto other_role = JoinRobotDomain({.domain = 84, .security = theirs.Issue("arm", Role::kRobot)}, "");
  ASSERT_FALSE(other_role);
  EXPECT_NE(other_role.error().message.find("policy"), std::string::npos) << other_role.error().message;
}

}  // namespace robots_test
}  // namespace etude::serve
