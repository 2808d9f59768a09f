// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/live/bus_watch.cc
#include "dashboard/server/live/bus_watch.h"

#include <gtest/gtest.h>

namespace etude::live {
namespace {

using namespace std::chrono_literals;

bus::Presence Campaign() {
  bus::Presence presence;
  presence.id = "0123456789abcdef";
  presence.name = "quickstart";
  return presence;
}

bus::WorkerStatus Worker(std::uint64_t episodes, const std::string& phase = "play") {
  bus::WorkerStatus status;
  status.worker = "w0";
  status.host = "lab-7";
  status.phase = phase;
  status.episodes = episodes;
  return status;
}

class LiveModelTest : public testing::Test {
 protected:
  LiveModelTest() { model_.Directory({Campaign()}, start_); }
  LiveCampaign& campaign() { return model_.view().campaigns.at(id_); }
  const std::string id_ = Campaign().id;
  const TimePoint start_ = MonotonicClock::now();
  LiveModel model_;
};

TEST_F(LiveModelTest, AWorkersRateIsOfTheLastMinute) {
  for (int i = 0; i <= 240; ++i) model_.On(id_, Worker(static_cast<std::uint64_t>(i / 4)), start_ + i * 500ms);
  const auto& worker = campaign().workers.at("w0");
  EXPECT_NEAR(worker.PerMinute().value(), 30, 1) << "one every two seconds";
  EXPECT_LE(worker.episodes.size(), 123u);
  EXPECT_EQ(worker.last, "success");
}

TEST_F(LiveModelTest, TheStripShowsPhasesAndSilence) {
  model_.On(id_, Worker(0, "plan"), start_);
  model_.On(id_, Worker(0, "play"), start_ + 500ms);
  model_.On(id_, Worker(0, "send"), start_ + 3500ms);
  EXPECT_EQ(campaign().workers.at("w0").strip, "py....s");
  for (int i = 0; i < 500; ++i) model_.On(id_, Worker(0), start_ + 4s + i * 500ms);
  EXPECT_EQ(campaign().workers.at("w0").strip, std::string(120, 'y'));
}

TEST_F(LiveModelTest, RememberedThingsAreBounded) {
  bus::AttemptReport report;
  report.worker = "w0";
  report.outcome = "plan_failed";
  for (std::uint64_t i = 0; i < 1000; ++i) {
    report.index = i;
    model_.On(id_, report, start_, 0);
    bus::CampaignStatus status;
    status.committed = i;
    model_.On(id_, status, start_ + i * 10s);
  }
  EXPECT_EQ(campaign().attempts.size(), 200u);
  EXPECT_EQ(campaign().attempts.front().report.index, 999u) << "newest first";
  EXPECT_EQ(campaign().per_minute.size(), 60u);
}

TEST_F(LiveModelTest, WhatWentAwayIsKeptForAWhile) {
  model_.Directory({}, start_ + 1min);
  EXPECT_FALSE(campaign().present);
  model_.Directory({}, start_ + 1h);
  EXPECT_FALSE(model_.view().campaigns.contains(id_));
}

}  // namespace
}  // namespace etude::live
