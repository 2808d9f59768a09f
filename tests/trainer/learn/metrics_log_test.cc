// SPDX-License-Identifier: Apache-2.0
// Tests trainer/learn/metrics_log.cc
#include "trainer/learn/metrics_log.h"

#include <gtest/gtest.h>

#include <cmath>
#include <sstream>

#include "services/core/config.h"
#include "tests/support/temporary_folder.h"

namespace etude::learn {
namespace metrics_log_test {

TEST(MetricsLog, WritesLinesThatParseEvenForNumbersJsonDoesNotHave) {
  const TemporaryFolder folder;
  {
    auto log = MetricsLog::Open(folder.path());
    ASSERT_TRUE(log) << log.error().message;
    ASSERT_TRUE(log->Write("train", 7, 1.5, {{"loss", std::nan("")}, {"lr", 0.1}}));
    ASSERT_TRUE(log->WriteAdvance({1, 2, 7, curriculum::Cause::kBudget, "time"}, "EE2D"));
    ASSERT_TRUE(log->WriteStage({1, 2, 7, curriculum::Cause::kBudget, "time"}, "EE2D"));
  }
  const auto text = ReadTextFile(folder / "metrics.jsonl");
  ASSERT_TRUE(text);
  std::istringstream lines(*text);
  std::string line;
  ASSERT_TRUE(std::getline(lines, line));
  const auto json = OrderedJson::parse(line);
  EXPECT_EQ(json["kind"], "train");
  EXPECT_EQ(json["step"], 7);
  EXPECT_TRUE(json["loss"].is_null());
  EXPECT_EQ(json["lr"], 0.1);
  ASSERT_TRUE(std::getline(lines, line));
  EXPECT_EQ(OrderedJson::parse(line)["kind"], "stage");
  EXPECT_EQ(OrderedJson::parse(line)["cause"], "budget");
  EXPECT_TRUE(ReadTextFile(folder / "curriculum.jsonl").value().starts_with("{"));
}

TEST(MetricsLog, SaysWhatWasKeptAndHowItEnded) {
  const TemporaryFolder folder;
  auto log = MetricsLog::Open(folder.path());
  ASSERT_TRUE(log) << log.error().message;
  ASSERT_TRUE(NoteCheckpoint(folder.path(), 500, "00000500.safetensors", "ab", "best"));
  ASSERT_TRUE(log->WriteEnd(501, 2.5, End::kFailed, "the disk is full \xff"));

  std::istringstream lines(ReadTextFile(folder / "metrics.jsonl").value_or(""));
  std::string kept, end;
  ASSERT_TRUE(std::getline(lines, kept) && std::getline(lines, end));
  const auto checkpoint = OrderedJson::parse(kept), last = OrderedJson::parse(end);
  EXPECT_EQ(checkpoint["kind"], "checkpoint");
  EXPECT_EQ(checkpoint["step"], 500);
  EXPECT_EQ(checkpoint["file"], "00000500.safetensors");
  EXPECT_EQ(checkpoint["sha256"], "ab");
  EXPECT_EQ(checkpoint["channel"], "best");
  EXPECT_EQ(last["kind"], "end");
  EXPECT_EQ(last["step"], 501);
  EXPECT_EQ(last["cause"], "failed");
  EXPECT_EQ(ToString(End::kFinished), "finished");
  EXPECT_EQ(ToString(End::kStopped), "stopped");
}

}  // namespace metrics_log_test
}  // namespace etude::learn
