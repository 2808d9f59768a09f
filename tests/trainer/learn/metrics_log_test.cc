// SPDX-License-Identifier: Apache-2.0
// Tests trainer/learn/metrics_log.cc
#include "trainer/learn/metrics_log.h"

#include <gtest/gtest.h>

#include <cmath>
#include <sstream>

#include "services/core/config.h"
#include "tests/support/temporary_folder.h"

namespace etude::learn {
namespace {

TEST(MetricsLog, WritesLinesThatParseEvenForNumbersJsonDoesNotHave) {
  const TemporaryFolder folder;
  {
    auto log = MetricsLog::Open(folder.path());
    ASSERT_TRUE(log) << log.error().message;
    ASSERT_TRUE(log->Write("train", 7, 1.5, {{"loss", std::nan("")}, {"lr", 0.1}}));
    ASSERT_TRUE(log->WriteAdvance({1, 2, 7, curriculum::Cause::kBudget, "time"}, "EE2D"));
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
  EXPECT_TRUE(ReadTextFile(folder / "curriculum.jsonl").value().starts_with("{"));
}

}  // namespace
}  // namespace etude::learn
