// SPDX-License-Identifier: Apache-2.0
// Tests services/bus/network.cc on this machine: with a second participant, and with the kernel's own counters.
#include "services/bus/network.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cmath>
#include <set>
#include <sstream>
#include <vector>

#include "services/bus/process_reporter.h"
#include "services/bus/topology.h"
#include "services/core/clock.h"
#include "services/core/stop.h"
#include "tests/support/matchers.h"

namespace etude::bus {
namespace network_test {

using namespace std::chrono_literals;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::Field;
using ::testing::Gt;
using ::testing::SizeIs;

constexpr std::uint32_t kDomain = 103;

TEST(Network, APeerSaysItsHostAndProcess) {
  auto participant = Participant::Open({kDomain, ""});
  ASSERT_THAT(participant, IsOk());
  const auto peers = Peers(*participant);
  ASSERT_THAT(peers, IsOk());
  ASSERT_THAT(*peers, SizeIs(1));
  const NetworkPeer& self = peers->front();
  EXPECT_TRUE(self.is_self);
  EXPECT_EQ(self.participant, ParticipantId(*participant));
  char host[256] = {};
  ::gethostname(host, sizeof host - 1);
  EXPECT_EQ(self.host, host);
  EXPECT_EQ(self.pid, static_cast<std::uint32_t>(::getpid()));
  EXPECT_EQ(self.process, "bus_process_test");
}

TEST(Network, ClocksOfOneMachineAgree) {
  auto participant = Participant::Open({kDomain, ""});
  ASSERT_THAT(participant, IsOk());
  const auto reporter = ProcessReporter::Start(*participant, {.role = "test", .every = 50ms});
  ASSERT_THAT(reporter, IsOk());
  const auto agree = [](const std::vector<ClockOffset>& clocks) {
    return clocks.size() == 1 && std::abs(clocks.front().seconds) < 0.2;
  };
  auto clocks = MeasureClocks(*participant, 500ms);
  // a message that has waited for a core makes its sender's clock late
  for (int again = 0; again < 9 && clocks && !agree(*clocks); ++again) clocks = MeasureClocks(*participant, 500ms);
  ASSERT_THAT(clocks, IsOk());
  ASSERT_THAT(*clocks, SizeIs(1));
  EXPECT_EQ(clocks->front().participant, ParticipantId(*participant));
  EXPECT_LT(std::abs(clocks->front().seconds), 0.2);
}

TEST(Network, TheSocketsOfDdsAreAmongOurs) {
  EXPECT_TRUE(OwnUdpSockets().empty());
  auto participant = Participant::Open({kDomain, ""});
  ASSERT_THAT(participant, IsOk());
  EXPECT_THAT(OwnUdpSockets(), Contains(AllOf(Field(&OwnSocket::port, testing::Ge(7400 + 250 * kDomain)),
                                              Field(&OwnSocket::receive_buffer, Gt(0u)))));
}

TEST(Network, TheLoopbackIsUp) {
  EXPECT_THAT(Interfaces(),
              Contains(AllOf(Field(&NetworkInterface::address, "127.0.0.1"), Field(&NetworkInterface::loopback, true),
                             Field(&NetworkInterface::mtu, Gt(0)))));
}

TEST(Network, CountersCountADatagramForAClosedPort) {
  const auto before = ReadUdpCounters();
  ASSERT_THAT(before, IsOk());
  const int socket = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(1);
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  EXPECT_EQ(::sendto(socket, "x", 1, 0, reinterpret_cast<const sockaddr*>(&to), sizeof to), 1);
  ::close(socket);
  auto after = ReadUdpCounters();
  // on a busy machine the kernel takes it up later
  for (const Stopwatch watch; after && after->to_closed_ports <= before->to_closed_ports && watch.Seconds() < 5;) {
    WaitForStop(5ms);
    after = ReadUdpCounters();
  }
  ASSERT_THAT(after, IsOk());
  EXPECT_GT(after->sent, before->sent);
  EXPECT_GT(after->to_closed_ports, before->to_closed_ports);
}

TEST(Network, MulticastSaysWhyNot) {
  EXPECT_THAT(TryMulticast("here"), testing::HasSubstr("no IPv4 address"));
  EXPECT_THAT(TryMulticast("192.0.2.1"), testing::Not(testing::IsEmpty()));  // no interface of ours
}

// the kernel leaves no space behind a name of ten letters, and none of these was seen to look for peers
TEST(Network, InterfacesOfLongNamesAreFoundToListen) {
  std::istringstream igmp(
      "Idx\tDevice    : Count Querier\tGroup    Users Timer\tReporter\n"
      "1\tlo        :     1      V3\n\t\t\t\t010000E0     1 0:00000000\t\t0\n"
      "2\tenp129s0f0np0:     2      V3\n\t\t\t\t0100FFEF     1 0:00000000\t\t0\n"
      "3\teth0      :     2      V3\n\t\t\t\t0100FFEF     1 0:00000000\t\t0\n");
  EXPECT_EQ(ListeningInterfaces(igmp, "0100FFEF"), (std::set<std::string>{"enp129s0f0np0", "eth0"}));
}

}  // namespace network_test
}  // namespace etude::bus
