// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/api/logs.cc
#include <fcntl.h>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <sys/stat.h>

#include <algorithm>
#include <cstdio>
#include <ctime>

#include "dashboard/server/sources/files.h"
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
  // The file, changed last on that day of March 2026, local time.
  void WriteOn(int day, const std::string& time_of_day, const std::string& name, const std::string& text) {
    Write(name, text);
    std::tm parts{};
    parts.tm_year = 126, parts.tm_mon = 2, parts.tm_mday = day, parts.tm_isdst = -1;
    ASSERT_EQ(std::sscanf(time_of_day.c_str(), "%d:%d:%d", &parts.tm_hour, &parts.tm_min, &parts.tm_sec), 3);
    const timespec changed[2] = {{std::mktime(&parts), 0}, {std::mktime(&parts), 0}};
    ASSERT_EQ(::utimensat(AT_FDCWD, (lab_.root() / "logs" / name).c_str(), changed, 0), 0);
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
  WriteOn(10, "10:00:05", "trainer.log", "10:00:01 info a: 1\ntrace of 1\n10:00:05 info a: 5\n");
  WriteOn(10, "10:00:04", "worker.log", "10:00:02 info b: 2\n10:00:04 warn b: 4\n");
  EXPECT_THAT(Texts(""), ElementsAre("10:00:01 info a: 1", "trace of 1", "10:00:02 info b: 2", "10:00:04 warn b: 4",
                                     "10:00:05 info a: 5"));
  EXPECT_THAT(Texts("?q=b:"), ElementsAre("10:00:02 info b: 2", "10:00:04 warn b: 4"));
  EXPECT_THAT(Texts("?level=warn"), ElementsAre("10:00:04 warn b: 4"));
  EXPECT_THAT(Texts("?limit=2"), ElementsAre("10:00:04 warn b: 4", "10:00:05 info a: 5")) << "the newest";
}

// before, older lines of several files could not be reached
TEST_F(LogsTest, PagesOfSeveralFilesGoBackOverEveryLineOnceInOrderOfTime) {
  std::string texts[2], all;
  std::vector<std::string> lines;
  for (int i = 0; i < 40; ++i) {
    lines.push_back(fmt::format("10:00:{:02} info {}: line {}", i, i % 3 == 0 ? "a" : "b", i));
    texts[i % 3 == 0 ? 0 : 1] += lines.back() + "\n";
  }
  WriteOn(10, "10:00:39", "trainer.log", texts[0]);
  WriteOn(10, "10:00:38", "worker.log", texts[1]);
  std::vector<std::string> seen;
  std::string before;
  for (int page = 0; page < 20; ++page) {
    const auto json = GetJson(kPrefix + "/logs?limit=7" + before);
    std::vector<std::string> of_page;
    for (const auto& line : json["lines"]) of_page.push_back(line["text"]);
    EXPECT_EQ(json["back_to"].is_null(), json["next"].is_null());
    seen.insert(seen.begin(), of_page.begin(), of_page.end());
    if (json["next"].is_null()) break;
    before = "&before=" + json["next"].get<std::string>();
  }
  EXPECT_EQ(seen, lines);
}

TEST_F(LogsTest, AFileThatIsOnlyPartlyReadHoldsBackWhatIsOlderInOthers) {
  const auto time = [](int i) { return fmt::format("{:02}:{:02}:{:02}", i / 3600, i / 60 % 60, i % 60); };
  std::string large, small;
  constexpr int kLines = 18'000;  // 0.6 MB: two windows
  for (int i = 0; i < kLines; ++i) large += fmt::format("{} info a: line {:09}\n", time(i), i);
  for (int i = 0; i < kLines; i += 1000) small += fmt::format("{} warn b: {}\n", time(i), i);
  WriteOn(10, "05:00:00", "trainer.log", large);
  WriteOn(10, "05:00:00", "worker.log", small);
  std::vector<std::size_t> pages;
  std::vector<std::string> found;
  std::string before;
  while (pages.size() < 20) {
    const auto json = GetJson(kPrefix + "/logs?level=warn" + before);
    std::vector<std::string> of_page;
    for (const auto& line : json["lines"]) of_page.push_back(line["text"]);
    pages.push_back(of_page.size());
    found.insert(found.begin(), of_page.begin(), of_page.end());
    if (json["next"].is_null()) break;
    EXPECT_EQ(json["searched"], 2);
    before = "&before=" + json["next"].get<std::string>();
  }
  EXPECT_THAT(pages, ElementsAre(16, 2)) << "the oldest two wait for the other file";
  EXPECT_EQ(found.size(), 18u);
  EXPECT_TRUE(std::ranges::is_sorted(found));
}

// before, a filter by level left the first line of an error alone
TEST_F(LogsTest, TheRestOfAMessageIsOfItsLevel) {
  Write("trainer.log",
        "plain at the begin\n17:22:57 info a: fine\nrest of fine\n17:22:58 error a: bad\n  because\n  of this\n"
        "17:22:59 info a: on\n");
  EXPECT_THAT(Texts(std::string(kTrainer) + "&level=error"),
              ElementsAre("17:22:58 error a: bad", "  because", "  of this"));
  EXPECT_EQ(Texts(std::string(kTrainer) + "&level=info").size(), 7u) << "what has no level is no debug output";
  const auto lines = GetJson(kPrefix + "/logs" + kTrainer + "&level=error")["lines"];
  EXPECT_TRUE(lines[1]["level"].is_null()) << "as written";
}

TEST_F(LogsTest, LinesOfJsonAreUnderstood) {
  Write(
      "trainer.log",
      R"({"time":"2026-03-10T10:00:01.250Z","level":"info","source":"etude-trainer","pid":7,"code":"a","text":"one"})"
      "\n"
      R"({"time":"2026-03-10T10:00:03.000Z","level":"error","source":"etude-trainer","pid":7,"code":"b","text":"three"})"
      "\n{\"no\": \"line of ours\"}\n{torn");
  Write("worker.log",
        R"({"time":"2026-03-10T10:00:02.000Z","level":"warn","source":"etude-worker","pid":8,"code":"c","text":"two"})"
        "\n");
  const auto page = GetJson(kPrefix + "/logs?level=info");
  std::vector<std::string> texts;
  for (const auto& line : page["lines"]) texts.push_back(line["text"]);
  EXPECT_THAT(texts, ElementsAre("etude-trainer: one", "etude-worker: two", "etude-trainer: three",
                                 R"({"no": "line of ours"})", "{torn"));
  EXPECT_EQ(page["lines"][1]["level"], "warn");
  EXPECT_EQ(page["lines"][1]["t"].get<std::string>().size(), 8u);
  EXPECT_EQ(page["lines"][1]["at"], "2026-03-10T10:00:02.000Z");
  EXPECT_TRUE(page["lines"][3]["at"].is_null());
  EXPECT_THAT(Texts("?level=warn&q=etude-"), ElementsAre("etude-worker: two", "etude-trainer: three"));
}

// before, by time of day alone, what came after midnight stood first and was cut off
TEST_F(LogsTest, MidnightComesAfterTheDayBefore) {
  WriteOn(10, "23:59:58", "trainer.log", "23:59:58 info a: 1\n");
  WriteOn(11, "00:00:04", "worker.log", "no time yet\n23:59:57 info b: 0\n00:00:02 info b: 3\ntrace of 3\n");
  WriteOn(11, "00:00:03", "policy.log", "00:00:01 info c: 2\n00:00:03 info c: 4\n");
  EXPECT_THAT(Texts(""), ElementsAre("no time yet", "23:59:57 info b: 0", "23:59:58 info a: 1", "00:00:01 info c: 2",
                                     "00:00:02 info b: 3", "trace of 3", "00:00:03 info c: 4"));
  EXPECT_THAT(Texts("?limit=2"), ElementsAre("trace of 3", "00:00:03 info c: 4"));
  const auto lines = GetJson(kPrefix + "/logs")["lines"];
  const auto at = [&](int i) { return sources::ParseTime(lines[i]["at"].get<std::string>()).value(); };
  EXPECT_DOUBLE_EQ(at(3) - at(2), 3) << "23:59:58 and 00:00:01 are of two days";
  EXPECT_TRUE(lines[5]["at"].is_null()) << "a trace says no time";
}

TEST_F(LogsTest, DaysAreCountedBackFromAFilesLastChange) {
  WriteOn(10, "12:00:00", "trainer.log", "22:00:00 info a: 1\n08:00:00 info a: 2\n07:59:59 info a: 3\n");
  WriteOn(9, "23:00:00", "worker.log", "23:00:00 info b: 1\n");
  WriteOn(12, "01:00:00", "policy.log", "11:00:00 info c: 1\nno time\n");
  WriteOn(10, "07:00:00", "plain.log", "no times\n");
  EXPECT_THAT(Texts(""), ElementsAre("22:00:00 info a: 1", "23:00:00 info b: 1", "no times", "08:00:00 info a: 2",
                                     "07:59:59 info a: 3", "11:00:00 info c: 1", "no time"))
      << "two lines that are a second out of order are of one day";
  EXPECT_THAT(Texts("?q=info%20a"), ElementsAre("22:00:00 info a: 1", "08:00:00 info a: 2", "07:59:59 info a: 3"));
}

// before, a file that others had overtaken by then was left out of the next page
TEST_F(LogsTest, AFileThatIsNoLongerAmongTheNewestKeepsItsOlderLines) {
  WriteOn(20, "10:00:05", "trainer.log", "10:00:01 info a: 1\n10:00:05 info a: 5\n");
  for (int i = 0; i < 12; ++i) WriteOn(10, "10:00:00", fmt::format("worker{}.log", i), "10:00:00 info b: 0\n");
  const auto first = GetJson(kPrefix + "/logs?limit=1");
  ASSERT_EQ(first["lines"].size(), 1u);
  EXPECT_EQ(first["lines"][0]["text"], "10:00:05 info a: 5");
  for (int i = 0; i < 12; ++i) WriteOn(21, "10:00:00", fmt::format("worker{}.log", i), "10:00:00 info b: 0\n");
  EXPECT_THAT(Texts("?limit=1&before=" + first["next"].get<std::string>()), ElementsAre("10:00:01 info a: 1"));
}

// before, older lines were dated by the file's last change, and took the day of what came after the first page
TEST_F(LogsTest, AFileThatGrowsBetweenPagesKeepsTheDaysOfItsOlderLines) {
  const std::string lines = "10:00:01 info a: 1\n10:00:03 info a: 3\n10:00:05 info a: 5\n";
  WriteOn(10, "10:00:05", "trainer.log", lines);
  WriteOn(10, "10:00:04", "worker.log", "10:00:02 info b: 2\n10:00:04 info b: 4\n");
  const auto first = GetJson(kPrefix + "/logs?limit=2");
  ASSERT_EQ(first["lines"].size(), 2u);
  const std::string next = first["next"];
  EXPECT_EQ(std::ranges::count(next, '@'), 4) << next;
  const auto unchanged = GetJson(kPrefix + "/logs?limit=2&before=" + next);
  WriteOn(12, "09:00:00", "trainer.log", lines + "09:00:00 info a: 6\n");
  EXPECT_THAT(Texts("?before=" + next), ElementsAre("10:00:01 info a: 1", "10:00:02 info b: 2", "10:00:03 info a: 3"));
  EXPECT_EQ(GetJson(kPrefix + "/logs?limit=2&before=" + next)["back_to"], unchanged["back_to"]);
}

TEST_F(LogsTest, WhatIsNotThereOrMakesNoSenseIsSaid) {
  EXPECT_EQ(Get(kPrefix + "/logs?source=lab.logs.none").status, 404);
  EXPECT_EQ(Get(kPrefix + "/logs?source=..%2Flogs").status, 404);
  EXPECT_EQ(Get(kPrefix + "/logs?limit=0").status, 400);
  for (const char* before : {"-1", "x", "5x", "lab.logs.trainer.log@", "a@1,b@y", "123", "a@1@", "a@1@-1", "a@1@nan",
                             "a@1@1e300", "a@b@1", "@"})
    EXPECT_EQ(Get(kPrefix + "/logs?before=" + before).status, 400) << before;
  for (const char* before : {"lab.logs.trainer.log@5", "lab.logs.trainer.log@5@1000", "5@x", "1@2@3"})
    EXPECT_EQ(Get(kPrefix + "/logs" + kTrainer + "&before=" + before).status, 400) << before;
  EXPECT_THAT(Texts(std::string(kTrainer) + "&before=36@1795369650"), testing::SizeIs(1)) << "the first line";
  EXPECT_THAT(Texts(std::string(kTrainer) + "&before=0"), testing::IsEmpty());
}

}  // namespace logs_test
}  // namespace etude::api
