// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/up_record.cc
#include "services/cli/up_record.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::cli {
namespace up_record_test {

TEST(UpRecord, SaysThatItRunsAndHowItEnded) {
  const TemporaryFolder folder;
  const auto read = [&] { return OrderedJson::parse(ReadTextFile(folder / "up.json").value_or("null")); };
  auto record = UpRecord::Begin(folder.path(), 3, {{"dataset", folder / "dataset"}}, "http://127.0.0.1:8080");
  ASSERT_THAT(record, IsOk());
  EXPECT_EQ(read()["pids"].dump(), OrderedJson({{"up", ::getpid()}}).dump());
  EXPECT_EQ(read()["domain"], 3);
  EXPECT_EQ(read()["folders"]["dataset"], (folder / "dataset").string());
  EXPECT_EQ(read()["address"], "http://127.0.0.1:8080");
  EXPECT_GT(read()["started"].get<double>(), 1.6e9);
  EXPECT_TRUE(read()["ended"].is_null());
  EXPECT_TRUE(read()["exit"].is_null());

  record->SetChildren({{"trainer", 4711}});
  EXPECT_EQ(read()["pids"]["trainer"], 4711);
  record->SetChildren({});
  EXPECT_FALSE(read()["pids"].contains("trainer")) << "it has ended";

  EXPECT_EQ(read()["phase"], "begin");
  record->SetPhase("roll out", "20 rollouts");
  EXPECT_EQ(read()["phase"], "roll out");
  EXPECT_EQ(read()["goal"], "20 rollouts");

  record->End(3);
  EXPECT_EQ(read()["phase"], "ended");
  EXPECT_EQ(read()["exit"], 3);
  EXPECT_GE(read()["ended"].get<double>(), read()["started"].get<double>());
}

TEST(UpRecord, TakesFoldersWhoseNamesAreNotUtf8) {
  const TemporaryFolder folder;
  EXPECT_THAT(UpRecord::Begin(folder.path(), 3, {{"dataset", folder / "caf\xe9"}}, ""), IsOk());
  EXPECT_TRUE(OrderedJson::parse(ReadTextFile(folder / "up.json").value_or("null")).is_object());
}

}  // namespace up_record_test
}  // namespace etude::cli
