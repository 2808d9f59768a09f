// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/api/logs.cc
#include <fmt/format.h>
#include <gmock/gmock.h>

#include "tests/dashboard/server/api/api_fixture.h"
#include "tests/support/matchers.h"

namespace etude::api {
namespace logs_test {

using testing::ElementsAre;

class LogsTest : public ApiFixture {
 protected:
  void Write(const std::string& name, const std::string& text) {
    ASSERT_THAT(WriteFileAtomically(lab_.root() / "logs" / name, text), IsOk());
  }
  std::vector<std::string> Texts(const std::string& query) {
    std::vector<std::string> texts;
    const auto page = GetJson(kPrefix + "/logs" + query);
    for (const auto& line : page["lines"]) texts.push_back(line["text"]);
    return texts;
  }
};

constexpr char kTrainer[] = "?source=lab.logs.trainer.log";

TEST_F(LogsTest, PagesGoBackOverEveryLineOnce) {
  std::string text;
  std::vector<std::string> lines;
  for (int i = 0; i < 23; ++i) {
    lines.push_back(fmt::format("17:22:{:02} info etude-trainer: line {}", i, i));
    text += lines.back() + "\n";
  }
  Write("trainer.log", text);
  std::vector<std::string> seen;
  std::string before;
  for (int page = 0; page < 20; ++page) {
    const auto json = GetJson(kPrefix + "/logs" + kTrainer + "&limit=5" + before);
    std::vector<std::string> of_page;
    for (const auto& line : json["lines"]) of_page.push_back(line["text"]);
    seen.insert(seen.begin(), of_page.begin(), of_page.end());
    if (json["next"].is_null()) break;
    before = "&before=" + json["next"].get<std::string>();
  }
  EXPECT_EQ(seen, lines);
}

// a window begins in the middle of a line, which then belongs to the page before
TEST_F(LogsTest, PagesOfALargeFileLoseNoLineBetweenThem) {
  std::string text;
  constexpr int kLines = 30'000;  // 1.2 MB: three windows
  for (int i = 0; i < kLines; ++i) text += fmt::format("17:22:57 info etude-trainer: line {:09}\n", i);
  Write("trainer.log", text);
  int next = kLines;  // the line that the page before began with
  std::string before;
  for (int page = 0; page < 200 && next > 0; ++page) {
    const auto json = GetJson(kPrefix + "/logs" + kTrainer + "&limit=500" + before);
    ASSERT_FALSE(json["lines"].empty());
    const int first = std::stoi(json["lines"][0]["text"].get<std::string>().substr(34));
    ASSERT_EQ(first + static_cast<int>(json["lines"].size()), next);
    next = first;
    if (json["next"].is_null()) break;
    before = "&before=" + json["next"].get<std::string>();
  }
  EXPECT_EQ(next, 0);
}

TEST_F(LogsTest, ALineIsUnderstoodWhereItIsOneOfOurs) {
  Write("trainer.log",
        "17:22:57 warn etude-trainer: slow disk\n"
        "not ours\n17:22 loud x: y\n17:22:58 info\n:::: info x\n\n"
        "step 1\rstep 2\rstep 3\n17:22:59 error etude-trainer: end");
  const auto lines = GetJson(kPrefix + "/logs" + kTrainer)["lines"];
  ASSERT_EQ(lines.size(), 7u) << lines.dump(1) << "an empty line is none";
  EXPECT_EQ(lines[0]["level"], "warn");
  EXPECT_EQ(lines[0]["t"], "17:22:57");
  for (const int i : {1, 2, 3, 4}) EXPECT_TRUE(lines[i]["level"].is_null()) << i;
  EXPECT_EQ(lines[5]["text"], "step 3") << "what a progress line shows at last";
  EXPECT_EQ(lines[6]["level"], "error") << "a line that has no end yet";
}

TEST_F(LogsTest, LinesOfSeveralFilesAreMergedByTheirTimes) {
  Write("trainer.log", "10:00:01 info a: 1\ntrace of 1\n10:00:05 info a: 5\n");
  Write("worker.log", "10:00:02 info b: 2\n10:00:04 warn b: 4\n");
  EXPECT_THAT(Texts(""), ElementsAre("10:00:01 info a: 1", "trace of 1", "10:00:02 info b: 2", "10:00:04 warn b: 4",
                                     "10:00:05 info a: 5"));
  EXPECT_THAT(Texts("?q=b:"), ElementsAre("10:00:02 info b: 2", "10:00:04 warn b: 4"));
  EXPECT_THAT(Texts("?level=warn"), ElementsAre("10:00:04 warn b: 4"));
  EXPECT_THAT(Texts("?limit=2"), ElementsAre("10:00:04 warn b: 4", "10:00:05 info a: 5")) << "the newest";
  EXPECT_TRUE(GetJson(kPrefix + "/logs?limit=2")["next"].is_null()) << "offsets are of one file";
}

TEST_F(LogsTest, WhatIsNotThereOrMakesNoSenseIsSaid) {
  EXPECT_EQ(Get(kPrefix + "/logs?source=lab.logs.none").status, 404);
  EXPECT_EQ(Get(kPrefix + "/logs?source=..%2Flogs").status, 404);
  EXPECT_EQ(Get(kPrefix + "/logs?limit=0").status, 400);
  EXPECT_EQ(Get(kPrefix + "/logs?before=-1").status, 400);
  EXPECT_THAT(Texts(std::string(kTrainer) + "&before=0"), testing::IsEmpty());
}

}  // namespace logs_test
}  // namespace etude::api
