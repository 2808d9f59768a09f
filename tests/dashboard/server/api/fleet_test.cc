// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/api/fleet.cc: hosts and workers from the journals of what has ended; live_test.cc has those of
// the bus.
#include <gmock/gmock.h>

#include <string>
#include <vector>

#include "tests/dashboard/server/api/api_fixture.h"
#include "tests/support/matchers.h"

namespace etude::api {
namespace fleet_test {

using testing::ElementsAre;

class FleetTest : public ApiFixture {};

// before, nothing that failed was counted: whatever had ended was all right
TEST_F(FleetTest, JournalsTellWhatFailedToo) {
  const CampaignSpec spec = SyntheticSpec();
  auto writer = store::DatasetWriter::Open(lab_.root() / "late", spec);
  ASSERT_THAT(writer, IsOk());
  for (std::uint64_t i = 0; i < 3; ++i) {
    store::CommitFacts facts;
    facts.worker = i < 2 ? "w0" : "w1", facts.host = i < 2 ? "lab-7" : "lab-8";
    ASSERT_THAT(writer->Commit(MakeSyntheticEpisode(spec, i, 10), facts), IsOk());
  }
  ASSERT_THAT(writer->RecordFailure(3, 0, "slip", R"({"worker":"w0","t":1000})"), IsOk());
  ASSERT_THAT(writer->RecordFailure(3, 1, "slip", R"({"worker":"w9"})"), IsOk());
  ASSERT_THAT(writer->RecordFailure(4, 0, "slip", R"({"worker":"w9"})"), IsOk());
  ASSERT_THAT(writer->RecordFailure(5, 0, "slip", "{}"), IsOk());  // of nobody

  const auto fleet = GetJson(kPrefix + "/fleet");
  EXPECT_EQ(fleet["live"], false);
  EXPECT_EQ(fleet["workers"], 3);
  EXPECT_EQ(fleet["ok"], 0.5) << "of six attempts";
  std::vector<std::string> hosts;
  for (const auto& host : fleet["hosts"]) hosts.push_back(host["host"]);
  ASSERT_THAT(hosts, ElementsAre("?", "lab-7", "lab-8"));
  const auto& unknown = fleet["hosts"][0]["workers"][0];
  EXPECT_EQ(unknown["worker"], "w9") << "it committed nothing";
  EXPECT_EQ(unknown["episodes"], 0);
  EXPECT_EQ(unknown["failures"], 2);
  EXPECT_EQ(unknown["campaign"], "lab.late");
  EXPECT_EQ(fleet["hosts"][1]["episodes"], 2);
  EXPECT_EQ(fleet["hosts"][1]["failures"], 1) << "where the worker committed";
  EXPECT_LT(fleet["hosts"][1]["workers"][0]["age_ms"], 3'600'000) << "heard last when it committed";
  EXPECT_EQ(fleet["hosts"][2]["failures"], 0);
  EXPECT_EQ(fleet["hosts"][2]["ok"], 1.0);
}

}  // namespace fleet_test
}  // namespace etude::api
