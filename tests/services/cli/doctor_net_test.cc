// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/doctor_net.cc: what is advised, and the profile that is written.
#include "services/cli/doctor_net.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "services/core/file.h"
#include "tests/support/matchers.h"

namespace etude::cli {
namespace doctor_net_test {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

// Two hosts that find each other, all well.
NetworkReport GoodReport() {
  NetworkReport report{.domain = 3, .profile = "star.xml", .seconds = 3};
  report.peers = {{.participant = "aa", .host = "one", .process = "etude", .pid = 1, .is_self = true},
                  {.participant = "bb", .host = "two", .process = "etude-worker", .pid = 2}};
  report.clocks = {{"bb", "two", 0.002}};
  report.sockets = {{"0.0.0.0", 8160, 4u << 20, 1u << 20}};
  report.rmem_max = 4u << 20;
  NetworkReport::Interface ethernet;
  ethernet.name = "eth0";
  ethernet.address = "10.0.0.1";
  ethernet.mtu = 1500;
  ethernet.multicast = true;
  report.interfaces = {ethernet};
  return report;
}

TEST(DoctorNet, HasNoAdviceWhereAllIsWell) { EXPECT_THAT(Advice(GoodReport()), IsEmpty()); }

TEST(DoctorNet, NamesThePortsWhereNobodyElseIsSeen) {
  NetworkReport report = GoodReport();
  report.peers.pop_back();
  EXPECT_THAT(Advice(report), ElementsAre(HasSubstr("ports 8150 to 8399 must be open")));
  report.local_only = true;
  EXPECT_THAT(Advice(report), ElementsAre(HasSubstr("--write-profile")));
}

TEST(DoctorNet, ComparesBuffersWithWhatIsWanted) {
  NetworkReport report = GoodReport();
  report.rmem_max = 212992;
  EXPECT_THAT(Advice(report), ElementsAre(HasSubstr("net.core.rmem_max=4194304 (it is 212992)")));
  report.rmem_max = 4u << 20;
  report.sockets[0].receive_buffer = 100'000;
  EXPECT_THAT(Advice(report), ElementsAre(HasSubstr("SocketReceiveBufferSize")));
}

TEST(DoctorNet, TellsOfAClockThatIsOff) {
  NetworkReport report = GoodReport();
  report.clocks[0].seconds = -7.25;
  EXPECT_THAT(Advice(report), ElementsAre(HasSubstr("the clock of two is 7.2 s behind this one's")));
}

TEST(DoctorNet, TellsOfTrafficThatNobodyTakes) {
  NetworkReport report = GoodReport();
  report.closed_ports_per_second = 2384;
  report.overflows_per_second = 3;
  EXPECT_THAT(Advice(report), ElementsAre(HasSubstr("2384 datagrams a second"), HasSubstr("buffer is full")));
}

TEST(DoctorNet, TellsOfATunnelAndOfMulticastThatIsNeededAndDoesNotWork) {
  NetworkReport report = GoodReport();
  report.interfaces[0].mtu = 1400;
  report.interfaces[0].multicast_problem = "send: Network is unreachable";
  EXPECT_THAT(Advice(report), ElementsAre(HasSubstr("MaxRexmitMessageSize to 1356B")));  // nobody needs multicast
  report.interfaces[0].discovery = true;
  EXPECT_THAT(Advice(report), Contains(HasSubstr("AllowMulticast to false")));
}

TEST(DoctorNet, TextAndJsonHaveTheSamePeers) {
  const NetworkReport report = GoodReport();
  EXPECT_THAT(ToText(report), HasSubstr("two etude-worker 2"));
  EXPECT_THAT(ToText(report), HasSubstr("1 other participants, 1 other hosts"));
  const auto json = ToJson(report);
  EXPECT_EQ(json["peers"][1]["host"], "two");
  EXPECT_EQ(json["peers"][1]["clock_offset_s"], 0.002);
  EXPECT_TRUE(json["peers"][0]["clock_offset_s"].is_null());
  EXPECT_EQ(json["domain"], 3);
}

class StarProfileTest : public ::testing::Test {
 protected:
  const std::string cloud_ = ReadTextFile("deploy/dds/cloud.xml").value_or("");
};

TEST_F(StarProfileTest, ListsTheHubsAndNobodyElse) {
  const auto star = StarProfile(cloud_, {"10.0.0.1", "hub.internal", "10.0.0.1", "fd00::7"}, 24);
  ASSERT_THAT(star, IsOk());
  EXPECT_THAT(*star, HasSubstr("<Peers>\n        <Peer address=\"10.0.0.1\"/>\n        <Peer "
                               "address=\"hub.internal\"/>\n        <Peer address=\"fd00::7\"/>\n      </Peers>"));
  EXPECT_THAT(*star, Not(HasSubstr("127.0.0.1")));
  EXPECT_THAT(*star, HasSubstr("<MaxAutoParticipantIndex>24</MaxAutoParticipantIndex>"));
  EXPECT_THAT(*star, HasSubstr("<AllowMulticast>false</AllowMulticast>"));
}

TEST_F(StarProfileTest, ASecondTimeIsTheSame) {
  const auto star = StarProfile(cloud_, {"hub"}, 16);
  ASSERT_THAT(star, IsOk());
  EXPECT_EQ(StarProfile(*star, {"hub"}, 16).value_or(""), *star);
}

TEST_F(StarProfileTest, CycloneOpensIt) {
  const auto star = StarProfile(cloud_, {"127.0.0.1"}, 16);
  ASSERT_THAT(star, IsOk());
  EXPECT_THAT(bus::Participant::Open({109, *star}), IsOk());
}

TEST_F(StarProfileTest, RefusesWhatIsNoHost) {
  for (const char* hub : {"", "a b", "\"/>", "<!--"}) EXPECT_THAT(StarProfile(cloud_, {hub}, 16), Not(IsOk())) << hub;
  EXPECT_THAT(StarProfile(cloud_, {}, 16), Not(IsOk()));
  EXPECT_THAT(StarProfile("<CycloneDDS/>", {"hub"}, 16), Not(IsOk()));
}

}  // namespace doctor_net_test
}  // namespace etude::cli
