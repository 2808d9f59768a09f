// SPDX-License-Identifier: Apache-2.0
// `etude collect` at a terminal: Ctrl-C and a terminal that goes away drain it; begun again it makes the rest.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <signal.h>
#include <unistd.h>

#include "services/core/clock.h"
#include "services/core/command.h"
#include "services/store/dataset.h"
#include "tests/support/etude_command.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude {
namespace stopped_collection_test {

using namespace std::chrono_literals;

class StoppedCollection : public testing::Test {
 protected:
  campaign::Process Collect(const std::string& out, const std::string& log) const {
    auto process =
        campaign::Process::Start({{(ProgramsFolder() / "etude").string(), "collect", "deploy/campaigns/quickstart.yaml",
                                   "--out", (folder_ / out).string(), "--episodes", "16", "--workers", "2", "--domain",
                                   "58", "--set", fmt::format("name=stopped-{}", ::getpid()), "--set",
                                   "split={train: 12, valid: 4, test: 0}", "--set", "image_stride=25"},
                                  folder_ / log,
                                  {}});
    EXPECT_THAT(process, IsOk());
    return std::move(*process);
  }
  std::size_t Committed() const {
    const auto reader = store::DatasetReader::Open(folder_ / "data");
    if (!reader) return 0;
    const auto list = reader->List();
    return list ? list->size() : 0;
  }
  std::string Text(const std::string& log) const { return ReadTextFile(folder_ / log).value_or(""); }

  const TemporaryFolder folder_;
};

TEST_F(StoppedCollection, DrainsAndGoesOnWhereItWas) {
  const auto before = ::signal(SIGHUP, SIG_DFL);  // whoever runs the tests may ignore it
  EXPECT_EQ(Collect("calm", "calm.log").Wait(180s), kExitOk) << Text("calm.log");
  std::size_t committed = 0;
  for (const int signal : {SIGINT, SIGHUP}) {
    SCOPED_TRACE(signal);
    const std::string log = fmt::format("{}.log", signal);
    auto collecting = Collect("data", log);
    for (const auto end = Deadline(120s);
         Committed() <= committed && collecting.running() && MonotonicClock::now() < end;)
      collecting.Wait(20ms);
    collecting.Signal(signal);  // its workers are in groups of their own, as at a terminal
    EXPECT_EQ(collecting.Wait(60s), kExitOk) << Text(log);
    EXPECT_THAT(Text(log), testing::HasSubstr("stopped, run again to continue:"));
    EXPECT_GT(Committed(), committed);
    committed = Committed();
    EXPECT_LT(committed, 16u);
    const auto report = store::Verify(folder_ / "data", store::Quarantine::kNo);
    ASSERT_THAT(report, IsOk());
    EXPECT_TRUE(report->bad.empty());
  }
  ::signal(SIGHUP, before);
  EXPECT_EQ(Collect("data", "rest.log").Wait(180s), kExitOk) << Text("rest.log");
  EXPECT_EQ(store::HashDataset(folder_ / "data").value(), store::HashDataset(folder_ / "calm").value());
}

}  // namespace stopped_collection_test
}  // namespace etude
