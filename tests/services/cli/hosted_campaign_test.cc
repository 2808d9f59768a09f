// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/hosted_campaign.cc with a worker that makes synthetic episodes.
#include "services/cli/hosted_campaign.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>

#include "services/core/clock.h"
#include "services/core/log.h"
#include "services/core/share.h"
#include "services/core/stop.h"
#include "services/store/dataset.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/wait_until.h"
#include "tests/support/write_program.h"

namespace etude::cli {
namespace hosted_campaign_test {

using namespace std::chrono_literals;

constexpr std::uint32_t kDomain = 65;

class Hosted : public testing::Test {
 protected:
  Hosted() {
    spec_ = SyntheticSpec();
    spec_.name = "hosted-" + std::to_string(::getpid());
    spec_.episodes = 4;
    spec_.max_attempts = 100;
    options_.bus.domain = kDomain;
    options_.workers = 0;
    options_.out = folder_ / "data";
    options_.logs = folder_ / "logs";
  }
  void SetUp() override {
    auto opened = bus::Participant::Open({kDomain, ""});
    ASSERT_THAT(opened, IsOk());
    participant_.emplace(std::move(*opened));
  }
  Result<std::unique_ptr<HostedCampaign>> Start() { return HostedCampaign::Start(*participant_, spec_, options_); }
  Result<campaign::Process> StartWorker() {
    return campaign::Process::Start(
        {{(ProgramFolder() / "fake_worker").string(), spec_.name, std::to_string(kDomain), "0"},
         folder_ / "worker.log",
         {}});
  }
  // Supervises until the collector has ended.
  static void ExpectEnds(HostedCampaign& hosted) {
    const Stopwatch watch;
    while (!hosted.ended() && watch.Seconds() < 60) {
      ASSERT_THAT(hosted.Supervise(), IsOk());
      WaitForStop(1ms);
    }
    EXPECT_TRUE(hosted.ended());
  }

  TemporaryFolder folder_;
  std::optional<bus::Participant> participant_;
  CampaignSpec spec_;
  HostOptions options_;
};

TEST_F(Hosted, CollectsWithOthersWorkersAndThenNeedsNone) {
  {
    auto hosted = Start();
    ASSERT_THAT(hosted, IsOk());
    EXPECT_FALSE((*hosted)->ended());
    auto worker = StartWorker();
    ASSERT_THAT(worker, IsOk());
    ExpectEnds(**hosted);
    EXPECT_THAT((*hosted)->Finish(), IsOk());
    EXPECT_TRUE((*hosted)->progress().complete);
    EXPECT_EQ((*hosted)->progress().committed, 4u);
    EXPECT_EQ(worker->Wait(10s), 0) << ReadTextFile(folder_ / "worker.log").value_or("");
  }
  const auto reader = store::DatasetReader::Open(folder_ / "data");
  ASSERT_THAT(reader, IsOk());
  EXPECT_EQ(reader->List()->size(), 4u);

  // etude-worker does not lie beside this program, and nothing is left to be done: it is not looked for
  options_.workers = 2;
  auto again = Start();
  ASSERT_THAT(again, IsOk());
  ExpectEnds(**again);
  EXPECT_THAT((*again)->Finish(), IsOk());
  EXPECT_EQ((*again)->progress().committed, 4u);
}

TEST_F(Hosted, WithoutTheProgramOfItsWorkersItDoesNotBegin) {
  options_.workers = 1;
  const auto hosted = Start();
  EXPECT_THAT(hosted, HasCode(Code::kUnavailable));
  EXPECT_THAT(hosted, MessageHas("etude-worker"));
  options_.workers = 0;
  EXPECT_THAT(Start(), IsOk()) << "the folder is free again";
}

TEST_F(Hosted, AnotherSpecInTheFolderIsRefused) {
  {
    auto hosted = Start();
    ASSERT_THAT(hosted, IsOk());
    EXPECT_THAT((*hosted)->Finish(), IsOk()) << "a stop is no error";
    EXPECT_FALSE((*hosted)->progress().complete);
    EXPECT_TRUE((*hosted)->ended());
  }
  spec_.seed += 1;
  EXPECT_THAT(Start(), MessageHas("seed"));
}

TEST_F(Hosted, TwoDoNotWriteOneFolder) {
  auto first = Start();
  ASSERT_THAT(first, IsOk());
  EXPECT_THAT(Start(), HasCode(Code::kUnavailable));
  EXPECT_THAT((*first)->Finish(), IsOk());
}

// `etude collect … && etude train …` went on to train with nothing
TEST(NotAllGivenUp, IsAskedOfWhatIsCompleteAlone) {
  campaign::CollectorProgress progress;
  progress.total = progress.given_up = 5;
  EXPECT_TRUE(CheckNotAllGivenUp(progress, "data")) << "it may still make one";
  progress.complete = true;
  const Status none = CheckNotAllGivenUp(progress, "data");
  ASSERT_FALSE(none);
  EXPECT_NE(none.error().message.find("data/attempts.jsonl"), std::string::npos) << none.error().message;
  progress.given_up = 4, progress.committed = 1;
  EXPECT_TRUE(CheckNotAllGivenUp(progress, "data"));
}

// with a profile without multicast on a host that is no hub, nothing was said and nothing ended
TEST_F(Hosted, WorkersThatNobodyHearsAreToldOf) {
  InitLog("test", "info");
  options_.worker = WriteProgram(folder_ / "mute", "#!/bin/sh\nexec sleep 60\n");
  options_.workers = 1;
  options_.unheard = 100ms;
  std::atomic<int> told = 0;
  const LogListener hear([&](const LogRecord& record) { told += record.text.starts_with("no worker was heard"); });
  auto hosted = Start();
  ASSERT_THAT(hosted, IsOk());
  EXPECT_TRUE(WaitUntil([&] { return !(*hosted)->Supervise() || told > 0; }));
  for (int i = 0; i < 3; ++i) ASSERT_THAT((*hosted)->Supervise(), IsOk());
  EXPECT_EQ(told, 1);
}

}  // namespace hosted_campaign_test
}  // namespace etude::cli
