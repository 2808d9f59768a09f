// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/api/jobs.cc
#include "dashboard/server/api/jobs.h"

#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>

#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::api {
namespace jobs_test {

TEST(CommandText, IsWhatAShellTakesAsOneWordEach) {
  EXPECT_EQ(CommandText({"etude", "eval", "--out", "a b", "it's", "", "$(rm)"}),
            "etude eval --out 'a b' 'it'\\''s' '' '$(rm)'");
}

TEST(Jobs, AreFewAtOnce) {
  TemporaryFolder folder;
  Jobs jobs(folder / "jobs");
  EXPECT_THAT(jobs.Add({"evaluate", {"eval"}, Weight::kHeavy}), IsOk());
  EXPECT_THAT(jobs.Add({"evaluate", {"eval"}, Weight::kHeavy}), HasCode(Code::kUnavailable));
  for (int i = 0; i < 3; ++i) EXPECT_THAT(jobs.Add({"replay", {"attempt"}, Weight::kLight}), IsOk());
  EXPECT_THAT(jobs.Add({"replay", {"attempt"}, Weight::kLight}), HasCode(Code::kUnavailable));
  EXPECT_EQ(jobs.All().size(), 4u);
  EXPECT_THAT(jobs.Json("none"), HasCode(Code::kNotFound));
  EXPECT_THAT(jobs.Stop("none"), HasCode(Code::kNotFound));
}

// Servers that nobody stopped do not keep anybody from pausing a campaign.
TEST(Jobs, ThatLastAreCountedByThemselvesAndBriefOnesAlwaysGo) {
  TemporaryFolder folder;
  Jobs jobs(folder / "jobs");
  for (int i = 0; i < 8; ++i) EXPECT_THAT(jobs.Add({"serve", {"policy"}, Weight::kLasting}), IsOk());
  EXPECT_THAT(jobs.Add({"play", {"worker"}, Weight::kLasting}), HasCode(Code::kUnavailable));
  for (int i = 0; i < 4; ++i) EXPECT_THAT(jobs.Add({"replay", {"attempt"}, Weight::kLight}), IsOk());
  EXPECT_THAT(jobs.Add({"replay", {"attempt"}, Weight::kLight}), HasCode(Code::kUnavailable));
  for (int i = 0; i < 3; ++i) EXPECT_THAT(jobs.Add({"pause", {"campaign"}, Weight::kBrief}), IsOk());
}

TEST(Jobs, WhatIsToRunOnceIsOneJobWhileItRuns) {
  TemporaryFolder folder;
  Jobs jobs(folder / "jobs");
  std::vector<bool> ends;
  const Jobs::Request request{"replay", {"attempt"}, Weight::kLight, "same", [&](bool well) { ends.push_back(well); }};
  const auto first = jobs.Add(request), second = jobs.Add(request);
  ASSERT_THAT(first, IsOk());
  EXPECT_EQ(*second, *first);
  EXPECT_EQ(jobs.Running("same"), *first);
  EXPECT_FALSE(jobs.Running("other"));
  EXPECT_FALSE(jobs.Running(""));
  EXPECT_EQ(jobs.All().size(), 1u);
  jobs.Pump();  // no etude lies beside this test
  EXPECT_EQ(ends, std::vector<bool>{false});
  EXPECT_FALSE(jobs.Running("same"));
  EXPECT_NE(jobs.Add(request).value(), *first);
}

TEST(Jobs, OneThatCannotBeStartedSaysWhy) {
  TemporaryFolder folder;
  Jobs jobs(folder / "jobs");
  const auto id = jobs.Add({"verify", {"dataset"}, Weight::kLight});
  ASSERT_THAT(id, IsOk());
  EXPECT_EQ(jobs.Json(*id).value()["state"], "running");
  jobs.Pump();  // no etude lies beside this test
  const auto json = jobs.Json(*id).value();
  EXPECT_EQ(json["state"], "failed");
  EXPECT_NE(json["log"].back().get<std::string>().find("etude"), std::string::npos);
}

// before, logs of jobs stayed for ever
TEST(Jobs, LogsOfGatewaysThatEndedGoWhenTheyAreOld) {
  TemporaryFolder folder;
  const Path old = folder / "jobs" / "old.log", fresh = folder / "jobs" / "fresh.log",
             other = folder / "jobs" / "a.txt";
  for (const auto& path : {old, fresh, other}) ASSERT_THAT(WriteFileAtomically(path, std::string_view("x")), IsOk());
  for (const auto& path : {old, other})
    std::filesystem::last_write_time(path, std::filesystem::file_time_type::clock::now() - std::chrono::hours(25));
  const Jobs jobs(folder / "jobs");
  EXPECT_FALSE(std::filesystem::exists(old));
  EXPECT_TRUE(std::filesystem::exists(fresh)) << "perhaps of one that is at work";
  EXPECT_TRUE(std::filesystem::exists(other)) << "no log";
}

TEST(Jobs, ALogGoesWithItsJob) {
  TemporaryFolder folder;
  Jobs jobs(folder / "jobs");
  std::vector<Path> logs;
  for (int i = 0; i < 60; ++i) {
    const auto id = jobs.Add({"verify", {"dataset"}, Weight::kLight});
    ASSERT_THAT(id, IsOk());
    logs.push_back(folder / "jobs" / (*id + ".log"));
    ASSERT_THAT(WriteFileAtomically(logs.back(), std::string_view("said\n")), IsOk());
    jobs.Pump();  // no etude lies beside this test: it ends at once
  }
  EXPECT_EQ(jobs.All().size(), 50u);
  EXPECT_FALSE(std::filesystem::exists(logs.front()));
  EXPECT_TRUE(std::filesystem::exists(logs.back()));
}

// a policy server that was started first kept all that came behind it, and their logs, for weeks
TEST(Jobs, OneThatLastsKeepsNoneOfThoseThatEnded) {
  TemporaryFolder folder;
  Jobs jobs(folder / "jobs", "/bin/sh");
  const auto server = jobs.Add({"serve", {"-c", "exec sleep 1000"}, Weight::kLasting});
  ASSERT_THAT(server, IsOk());
  for (int i = 0; i < 60; ++i) {
    ASSERT_THAT(jobs.Add({"verify", {"-c", "exit 0"}, Weight::kLight, "verify"}), IsOk());
    while (jobs.Running("verify")) jobs.Pump();
  }
  EXPECT_EQ(jobs.All().size(), 50u);
  EXPECT_EQ(jobs.Json(*server).value()["state"], "running");
  jobs.StopAll();
}

// one that is asked to stop may have much to end; before, a second request did nothing
TEST(Jobs, AskedTwiceToStopIsToldTwice) {
  TemporaryFolder folder;
  Jobs jobs(folder / "jobs", "/bin/sh");
  const auto id = jobs.Add({"verify",
                            {"-c", "trap 'trap - TERM; echo draining' TERM; echo ready; while :; do sleep 0.01; done"},
                            Weight::kLight,
                            "verify"});
  ASSERT_THAT(id, IsOk());
  const auto pump_until = [&](const std::string& said) {
    for (jobs.Pump(); jobs.Json(*id).value()["log"].dump().find(said) == std::string::npos;) jobs.Pump();
  };
  pump_until("ready");
  EXPECT_EQ(jobs.Json(*id).value()["stopping"], false);
  ASSERT_THAT(jobs.Stop(*id), IsOk());
  EXPECT_EQ(jobs.Json(*id).value()["stopping"], true);
  pump_until("draining");
  EXPECT_EQ(jobs.Json(*id).value()["state"], "running");
  ASSERT_THAT(jobs.Stop(*id), IsOk());
  while (jobs.Running("verify")) jobs.Pump();
  EXPECT_EQ(jobs.Json(*id).value()["exit_code"], 128 + SIGTERM);
}

// a quiet one's log was removed when a second gateway began in the same folder
TEST(Jobs, LogsOfThoseAtWorkStayHoweverLittleTheySay) {
  TemporaryFolder folder;
  Jobs jobs(folder / "jobs", "/bin/sh");
  const auto id = jobs.Add({"serve", {"-c", "exec sleep 1000"}, Weight::kLasting});
  ASSERT_THAT(id, IsOk());
  jobs.Pump();
  const Path log = folder / "jobs" / (*id + ".log");
  std::filesystem::last_write_time(log, std::filesystem::file_time_type::clock::now() - std::chrono::hours(25));
  jobs.Pump();
  const Jobs another(folder / "jobs");
  EXPECT_TRUE(std::filesystem::exists(log));
  jobs.StopAll();
}

}  // namespace jobs_test
}  // namespace etude::api
