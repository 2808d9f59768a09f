// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/top_text.cc and top_json.cc
#include "services/cli/top_text.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "services/cli/top_json.h"

namespace etude::cli {
namespace top_text_test {

using testing::HasSubstr;
using testing::Not;
using namespace std::chrono_literals;

const MonotonicClock::time_point kNow{1000s};

BusView Collecting() {
  BusView view;
  CampaignView& campaign = view.campaigns["0011"];
  campaign.presence.name = "quickstart";
  campaign.presence.id = "0011";
  bus::CampaignStatus status;
  status.committed = 1412;
  status.total = 6000;
  status.eta_s = 185;
  status.episodes_per_minute = 61.3;
  status.workers = 2;
  status.state = "running";
  status.failures_json = R"({"plan_failed": 4})";
  campaign.status = {status, kNow};
  for (int i = 0; i < 40; ++i) {
    bus::WorkerStatus worker;
    worker.worker = fmt::format("lab-7-{:02}", i);
    worker.host = i < 24 ? "lab-7" : "lab-8";
    worker.episodes = 100;
    worker.phase = "play";
    worker.stage = "reach";
    worker.step = 212;
    worker.token = 1;
    worker.index = 413;
    worker.last_outcome = "success";
    campaign.workers[worker.worker] = {worker, kNow};
  }
  return view;
}

RunView Training() {
  RunView run{.name = "quickstart", .id = "0022"};
  bus::TrainStatus status;
  status.step = 6589;
  status.stage = status.stages = 5;
  status.stage_name = "CTRL";
  status.loss = 0.25;
  status.metrics_json = R"({"TAR3D.cm": 0.15, "loss": 3})";
  run.status = {status, kNow};
  bus::PolicyStatus policy;
  policy.server = "lab-7-1";
  policy.step = 6500;
  policy.sha256 = "c4ad6f0ef74d11112222";
  policy.control_trained = true;
  policy.sessions = 1;
  run.policies["lab-7-1"] = {policy, kNow};
  return run;
}

TEST(StateSentence, SaysWhatGoesOn) {
  BusView view = Collecting();
  EXPECT_EQ(StateSentence(view, kNow), "quickstart: collecting 1,412 of 6,000, done in 3:05");
  view.runs["0022"] = Training();
  EXPECT_THAT(StateSentence(view, kNow), HasSubstr("quickstart: training stage 5/5 CTRL, step 6,589"));
  EXPECT_THAT(StateSentence(view, kNow), HasSubstr("step 6,500 serves 1 session"));
  EXPECT_EQ(StateSentence(BusView{.domain = 7}, kNow), "nothing is live on domain 7");
}

TEST(StateSentence, KnowsWhatStandsAndWhatIsSilent) {
  BusView view = Collecting();
  auto& status = view.campaigns["0011"].status->message;
  status.state = "paused";
  EXPECT_EQ(StateSentence(view, kNow), "quickstart: paused at 1,412 of 6,000");
  status.state = "running";
  EXPECT_THAT(StateSentence(view, kNow + 14s), HasSubstr("(silent 14 s)"));
  status.committed = status.total;
  EXPECT_EQ(StateSentence(view, kNow), "quickstart: collected 6,000");
}

TEST(TopText, ShowsCampaignWorkersTrainingAndPolicy) {
  BusView view = Collecting();
  view.runs["0022"] = Training();
  const std::string text = TopText(view, kNow);
  EXPECT_THAT(text, HasSubstr("61.3/min"));
  EXPECT_THAT(text, HasSubstr("failed: plan_failed 4"));
  EXPECT_THAT(text, HasSubstr("lab-7-39"));
  EXPECT_THAT(text, HasSubstr("#413 a0"));
  EXPECT_THAT(text, HasSubstr("loss 0.25"));
  EXPECT_THAT(text, HasSubstr("TAR3D.cm 0.15"));
  EXPECT_THAT(text, HasSubstr("sha256 c4ad6f0ef74d "));
}

TEST(TopJson, HasWhatTheScreenHas) {
  BusView view = Collecting();
  view.domain = 7;
  view.campaigns["0011"].workers["lab-7-00"].message.phase = bus::kGonePhase;
  view.campaigns["0033"].presence.name = "silent";
  view.runs["0022"] = Training();
  const OrderedJson json = TopJson(view, kNow + 2s);
  EXPECT_EQ(json["domain"], 7);
  EXPECT_EQ(json["sentence"], StateSentence(view, kNow + 2s));
  const auto& campaign = json["campaigns"][0];
  EXPECT_EQ(campaign["committed"], 1412);
  EXPECT_EQ(campaign["failures"]["plan_failed"], 4);
  EXPECT_EQ(campaign["heard_s"], 2.0);
  ASSERT_EQ(campaign["worker_list"].size(), 39u) << "one went home";
  EXPECT_EQ(campaign["worker_list"][0]["worker"], "lab-7-01");
  EXPECT_EQ(campaign["worker_list"][0]["index"], 413);
  EXPECT_TRUE(json["campaigns"][1]["heard_s"].is_null()) << "no word yet";
  EXPECT_EQ(json["runs"][0]["step"], 6589);
  EXPECT_EQ(json["runs"][0]["metrics"]["TAR3D.cm"], 0.15);
  EXPECT_EQ(json["runs"][0]["policies"][0]["sha256"], "c4ad6f0ef74d11112222");
}

TEST(TopText, SpeaksOfHostsAndTheirSlots) {
  BusView view = Collecting();
  auto& workers = view.campaigns["0011"].workers;
  workers["lab-7-03"].message.phase = "idle";
  workers["lab-7-30"].at = kNow - 9s;
  // one that went from shard to shard is one slot
  view.campaigns["0022"].presence.name = "quickstart";
  view.campaigns["0022"].workers["lab-7-05"] = workers["lab-7-05"];
  workers["left"] = workers["lab-7-05"];
  workers["left"].message.phase = "gone";
  const std::string text = TopText(view, kNow);
  EXPECT_THAT(text, HasSubstr(fmt::format("host {:<23} 24 slots, 23 busy  2,400 done", "lab-7")));
  EXPECT_THAT(text, HasSubstr(fmt::format("host {:<23} 16 slots, 15 busy, 1 silent  1,600 done", "lab-8")));
  for (int i = 0; i < 90; ++i) {
    bus::WorkerStatus worker;
    worker.host = fmt::format("rack-{:02}", i);
    workers[worker.host] = {worker, kNow};
  }
  EXPECT_THAT(TopText(view, kNow, 24, 120), HasSubstr("and 86 more hosts"));
}

TEST(TopText, SaysWhatAnotherHostMadeAgain) {
  BusView view = Collecting();
  auto& status = view.campaigns["0011"].status->message;
  EXPECT_THAT(TopText(view, kNow), Not(HasSubstr("made again")));
  status.rechecked = 28;
  EXPECT_THAT(TopText(view, kNow), HasSubstr("made again on another host: 28, the same bytes"));
  status.mismatched = 3;
  EXPECT_THAT(TopText(view, kNow), HasSubstr("made again on another host: 28  OTHER BYTES: 3"));
}

TEST(TopText, FitsTheScreen) {
  BusView view = Collecting();
  view.runs["0022"] = Training();
  view.campaigns["0011"].workers.begin()->second.message.stage = "bad\x1b[2J";
  const std::string text = TopText(view, kNow, 20, 60);
  EXPECT_LE(std::count(text.begin(), text.end(), '\n'), 20);
  EXPECT_THAT(text, HasSubstr("more"));
  EXPECT_THAT(text, Not(HasSubstr("\x1b"))) << "what came over the bus moves no cursor";
  for (std::size_t at = 0, end; (end = text.find('\n', at)) != std::string::npos; at = end + 1)
    EXPECT_LE(end - at, 60u);
}

}  // namespace top_text_test
}  // namespace etude::cli
