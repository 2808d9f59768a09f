// SPDX-License-Identifier: Apache-2.0
// Two hosts that lose each other: network namespaces with a cable between them, and packets that are dropped.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "services/core/clock.h"
#include "tests/faults/two_hosts.h"
#include "tests/support/authority.h"
#include "tests/support/wait_until.h"

namespace etude::faults {
namespace network_faults_test {

using namespace std::chrono_literals;

// What the first episode after a fault may take: the time in which a peer is given up, twice, and a second.
constexpr double RecoveryBound(double lease_s) { return 2 * lease_s + 1; }

TEST(Faults, F6F7LinksThatAreDownForLessAndMoreThanALease) {
  const TwoHosts hosts;
  if (!hosts.up()) GTEST_SKIP() << "F6, F7 " << kNoNamespaces;
  // the long one: beyond the lease of 10 s that DDS has
  for (const int seconds : {4, SecondsOf("ETUDE_OUTAGE_S", 15)}) {
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

using Side = TwoHosts::Side;

// What one side sends is dropped for 12 s, longer than peers of DDS believe in each other; returns the seconds until
// the next episode after that.
double Cut(const TwoHosts& hosts, const CampaignRun& run, Side side) {
  hosts.Mute(side, true);
  const auto before = run.Committed();
  Last(12s);
  const auto cut = run.Committed();
  EXPECT_LE(cut, before + 4) << "what was sent arrived";
  hosts.Mute(side, false);
  const Stopwatch again;
  EXPECT_TRUE(WaitUntil([&] { return run.Committed() > cut; })) << run.Logs();
  return again.Seconds();
}

std::string TextOf(Side side, double recovered) {
  const bool workers = side == Side::kWorkers;
  return fmt::format("what {} is dropped for 12 s, what {} arrives; the next episode came {:.1f} s after the cut",
                     workers ? "workers send" : "the collector sends", workers ? "they are sent" : "it is sent",
                     recovered);
}

TEST(Faults, F8OnlyOneDirectionIsCut) {
  const TwoHosts hosts;
  if (!hosts.up()) GTEST_SKIP() << "F8 " << kNoNamespaces;
  for (const Side side : {Side::kWorkers, Side::kCollector}) {
    CampaignRun run(hosts.Options("f8", 60, 20));
    run.StartCollector();
    for (int i = 0; i < 2; ++i) run.StartWorker();
    run.WaitForCommitted(8);
    const double recovered = Cut(hosts, run, side);
    EXPECT_LE(recovered, RecoveryBound(3)) << run.Logs();
    ReportRow("F8", TextOf(side, recovered), run.Finish(90s));
  }
}

// Who is muted is given up by the other side, and has not given it up; under security none of them is taken for another
// one: the side that lost its peers starts again with another participant within DDS's lease (10 s).
TEST(Faults, F8OnlyOneDirectionIsCutUnderSecurity) {
  const TwoHosts hosts;
  if (!hosts.up()) GTEST_SKIP() << "F8 " << kNoNamespaces;
  for (const Side side : {Side::kWorkers, Side::kCollector}) {
    const Authority authority;
    RunOptions options = hosts.Options("f8s", 60, 20);
    options.collector_flags = authority.CollectorFlags();
    CampaignRun run(options);
    run.StartCollector();
    for (const char* name : {"rack-1", "rack-2"}) run.StartWorker(WorkerOf(authority.Worker(name)));
    run.WaitForCommitted(8);
    const double recovered = Cut(hosts, run, side);
    EXPECT_LE(recovered, RecoveryBound(10)) << run.Logs();
    ReportRow("F8", "under security: " + TextOf(side, recovered), run.Finish(90s));
  }
}

TEST(Faults, F9PacketsThatAreLost) {
  for (const int per_mille : {10, 50}) {
    CampaignRun run(
        {.name = "f9",
         .domain = 97,
         .episodes = 60,
         .environment = {
             {"CYCLONEDDS_URI", ProfileOn("127.0.0.1", "<Peer address=\"127.0.0.1\"/>",
                                          fmt::format("<Test><XmitLossiness>{}</XmitLossiness></Test>", per_mille))}}});
    run.StartCollector();
    for (int i = 0; i < 3; ++i) run.StartWorker();
    ReportRow("F9", fmt::format("{} % of all packets are lost", per_mille / 10), run.Finish(90s));
  }
}

}  // namespace network_faults_test
}  // namespace etude::faults
