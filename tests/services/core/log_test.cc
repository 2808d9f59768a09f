// SPDX-License-Identifier: Apache-2.0
// Tests services/core/log.cc
#include "services/core/log.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <vector>

namespace etude {
namespace log_test {

TEST(CodeOf, IsTheConstantTextsWords) {
  EXPECT_EQ(CodeOf("refused a checkpoint run=a@b step=3: too old"), "refused_a_checkpoint");
  EXPECT_EQ(CodeOf("committing waits, nothing is lost, it is tried again: disk full"), "committing_waits");
  EXPECT_EQ(CodeOf("No Videos: x"), "no_videos");
  EXPECT_EQ(CodeOf("3 rollouts could not be run"), "message");
  EXPECT_EQ(CodeOf("stage 3 of 5"), "stage");
  EXPECT_EQ(CodeOf("the dataset's index"), "the_datasets_index");
  EXPECT_EQ(CodeOf(""), "message");
  EXPECT_EQ(CodeOf("'/tmp/x': full"), "message");
  EXPECT_LE(CodeOf(std::string(1000, 'a')).size(), 64u);
  std::string words;
  for (int i = 0; i < 100; ++i) words += "many ";
  EXPECT_LE(CodeOf(words).size(), 64u);
}

TEST(LogListener, HearsWarningsForAsLongAsItLives) {
  InitLog("test", "info");
  std::vector<LogRecord> heard;
  {
    const LogListener listener([&](const LogRecord& record) { heard.push_back(record); });
    Log().info("started");
    Log().warn("disk nearly full free={}", 3);
    Log().error("gone: x");
  }
  Log().warn("afterwards");

  ASSERT_EQ(heard.size(), 2u);
  EXPECT_EQ(heard[0].level, "warn");
  EXPECT_EQ(heard[0].code, "disk_nearly_full");
  EXPECT_EQ(heard[0].text, "disk nearly full free=3");
  EXPECT_GT(heard[0].time_ms, 1'600'000'000'000u);
  EXPECT_EQ(heard[1].level, "error");
}

TEST(LogListener, HearsWarningsWhateverIsShown) {
  InitLog("test", "error");
  std::vector<LogRecord> heard;
  const LogListener listener([&](const LogRecord& record) { heard.push_back(record); });
  testing::internal::CaptureStderr();
  Log().warn("not shown");
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
  ASSERT_EQ(heard.size(), 1u);
  EXPECT_EQ(heard[0].text, "not shown");
  InitLog("test", "info");
}

TEST(Log, AnUnknownLevelIsInfoAndSaysSo) {
  testing::internal::CaptureStderr();
  InitLog("test", "verbose");
  Log().info("shown");
  InitLog("test", "");
  Log().info("and this");
  for (const char* level : {"error", "warn", "warning", "info", "debug"}) InitLog("test", level);
  const std::string text = testing::internal::GetCapturedStderr();
  InitLog("test", "info");
  EXPECT_NE(text.find("'verbose' is none of error, warn, info, debug"), std::string::npos) << text;
  EXPECT_NE(text.find("shown"), std::string::npos) << text;
  EXPECT_NE(text.find("and this"), std::string::npos) << text;
  EXPECT_EQ(text.find("none of"), text.rfind("none of")) << "nothing else is unknown: " << text;
}

TEST(Log, JsonIsAnObjectALine) {
  SetLogFormat(LogFormat::kJson);
  InitLog("etude-test", "info");
  testing::internal::CaptureStderr();
  Log().warn("odd \"text\" \xff\nline n={}", 1);
  Log().info("second");
  const std::string text = testing::internal::GetCapturedStderr();
  SetLogFormat(LogFormat::kText);
  InitLog("test", "info");

  const auto end = text.find('\n');
  ASSERT_NE(end, std::string::npos);
  const auto first = nlohmann::json::parse(text.substr(0, end)), second = nlohmann::json::parse(text.substr(end + 1));
  EXPECT_EQ(first["level"], "warn");
  EXPECT_EQ(first["source"], "etude-test");
  EXPECT_EQ(first["code"], "odd");
  EXPECT_NE(first["text"].get<std::string>().find("\nline n=1"), std::string::npos);
  EXPECT_EQ(first["time"].get<std::string>().size(), std::string("2026-01-31T12:00:00.123Z").size());
  EXPECT_EQ(second["text"], "second");
}

}  // namespace log_test
}  // namespace etude
