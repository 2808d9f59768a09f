// SPDX-License-Identifier: Apache-2.0
// Two hosts that lose each other: network namespaces with a cable between them, and packets that are dropped.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <optional>

#include "services/core/stop.h"
#include "tests/faults/campaign_run.h"
#include "tests/support/run_command.h"

namespace etude::faults {
namespace network_faults_test {

using namespace std::chrono_literals;

constexpr char kNoNamespaces[] = "needs `ip netns`, as root: two hosts are two network namespaces";

/// deploy/dds/local.xml on another interface, with peers and with more in its Internal section.
std::string Profile(const std::string& address, const std::string& peers, const std::string& internal) {
  std::string text = ReadTextFile("deploy/dds/local.xml").value_or("");
  EXPECT_FALSE(text.empty()) << "run the test in the root of the sources";
  const auto replace = [&](const std::string& from, const std::string& to) {
    const auto at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    if (at != std::string::npos) text.replace(at, from.size(), to);
  };
  replace("<NetworkInterface address=\"127.0.0.1\"/>", "<NetworkInterface address=\"" + address + "\"/>");
  replace("<Peer address=\"127.0.0.1\"/>", peers);
  replace("</Internal>", internal + "</Internal>");
  return text;
}

// A host for the collector and one for the workers, with a cable between them.
class TwoHosts {
 public:
  TwoHosts() {
    const std::string make = fmt::format(
        "(ip netns add {0} && ip netns add {1} && ip link add {0} netns {0} type veth peer name {1} netns {1} && "
        "ip -n {0} addr add 10.98.0.1/24 dev {0} && ip -n {1} addr add 10.98.0.2/24 dev {1} && "
        "ip -n {0} link set lo up && ip -n {1} link set lo up && ip -n {0} link set {0} up && "
        "ip -n {1} link set {1} up) 2>&1",
        a_, b_);
    up_ = RunInShell(make).code == 0;
  }
  ~TwoHosts() { RunInShell(fmt::format("(ip netns del {}; ip netns del {}) 2>&1", a_, b_)); }
  TwoHosts(const TwoHosts&) = delete;
  TwoHosts& operator=(const TwoHosts&) = delete;

  bool up() const { return up_; }
  void Link(bool on) const { Do(fmt::format("ip -n {0} link set {0} {1}", a_, on ? "up" : "down")); }
  /// What the workers' host sends does not leave it; what it is sent arrives.
  void MuteWorkers(bool mute) const {
    Do(fmt::format("ip -n {} route {} blackhole 10.98.0.1/32", b_, mute ? "add" : "del"));
  }
  RunOptions Options(const std::string& name, std::uint64_t episodes, int ms) const {
    const std::string peers = "<Peer address=\"10.98.0.1\"/><Peer address=\"10.98.0.2\"/>";
    return {.name = name,
            .domain = 96,
            .episodes = episodes,
            .lease_s = "3",
            .ms_per_attempt = ms,
            .collector_prefix = {"/usr/bin/env", "CYCLONEDDS_URI=" + Profile("10.98.0.1", peers, ""), ip(), "netns",
                                 "exec", a_},
            .worker_prefix = {"/usr/bin/env", "CYCLONEDDS_URI=" + Profile("10.98.0.2", peers, ""), ip(), "netns",
                              "exec", b_}};
  }

 private:
  static std::string ip() { return std::filesystem::exists("/usr/sbin/ip") ? "/usr/sbin/ip" : "/sbin/ip"; }
  static void Do(const std::string& command) {
    const auto done = RunInShell(command + " 2>&1");
    EXPECT_EQ(done.code, 0) << command << ": " << done.text;
  }
  const std::string a_ = fmt::format("etf{}a", ::getpid()), b_ = fmt::format("etf{}b", ::getpid());
  bool up_ = false;
};

// Waits while the fault lasts; that is what is tested.
void Last(std::chrono::seconds duration) { WaitForStop(duration); }

// Seconds of the long outage: 15 (beyond the lease of 10 s that DDS has), or what ETUDE_OUTAGE_S says.
int LongOutage() {
  const char* seconds = std::getenv("ETUDE_OUTAGE_S");
  return seconds == nullptr ? 15 : std::atoi(seconds);
}

TEST(Faults, F6F7LinksThatAreDownForLessAndMoreThanALease) {
  const TwoHosts hosts;
  if (!hosts.up()) GTEST_SKIP() << "F6, F7 " << kNoNamespaces;
  for (const int seconds : {4, LongOutage()}) {
    CampaignRun run(hosts.Options("f7", 60, 20));
    run.StartCollector();
    for (int i = 0; i < 2; ++i) run.StartWorker();
    run.WaitForCommitted(8);
    hosts.Link(false);
    const auto before = run.Committed();
    Last(std::chrono::seconds(seconds));
    EXPECT_LE(run.Committed(), before + 4) << "the link was not down";
    hosts.Link(true);
    const Stopwatch again;
    const Counts counts = run.Finish(90s);
    ReportRow(seconds == 4 ? "F6" : "F7",
              fmt::format("link down for {} s; all done {:.0f} s after it came back", seconds, again.Seconds()),
              counts);
  }
}

TEST(Faults, F8OnlyOneDirectionIsCut) {
  const TwoHosts hosts;
  if (!hosts.up()) GTEST_SKIP() << "F8 " << kNoNamespaces;
  CampaignRun run(hosts.Options("f8", 60, 20));
  run.StartCollector();
  for (int i = 0; i < 2; ++i) run.StartWorker();
  run.WaitForCommitted(8);
  hosts.MuteWorkers(true);
  const auto before = run.Committed();
  Last(12s);
  EXPECT_LE(run.Committed(), before + 4) << "what workers sent arrived";
  hosts.MuteWorkers(false);
  ReportRow("F8", "what workers send is dropped for 12 s, what they are sent arrives", run.Finish(90s));
}

TEST(Faults, F9PacketsThatAreLost) {
  for (const int per_mille : {10, 50}) {
    CampaignRun run(
        {.name = "f9",
         .domain = 97,
         .episodes = 60,
         .environment = {
             {"CYCLONEDDS_URI", Profile("127.0.0.1", "<Peer address=\"127.0.0.1\"/>",
                                        fmt::format("<Test><XmitLossiness>{}</XmitLossiness></Test>", per_mille))}}});
    run.StartCollector();
    for (int i = 0; i < 3; ++i) run.StartWorker();
    ReportRow("F9", fmt::format("{} % of all packets are lost", per_mille / 10), run.Finish(90s));
  }
}

}  // namespace network_faults_test
}  // namespace etude::faults
