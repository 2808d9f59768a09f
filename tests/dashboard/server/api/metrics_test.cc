// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/api/metrics.cc: that what is scraped is Prometheus' text format, whatever names there are.
#include "dashboard/server/api/metrics.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <sstream>

#include "dashboard/server/api/counters.h"
#include "tests/dashboard/server/api/api_fixture.h"
#include "tests/support/matchers.h"

namespace etude::api {
namespace metrics_test {

struct Line {
  std::string name;
  std::map<std::string, std::string> labels;
  std::string value;
};

// By the format's description: NAME{LABEL="VALUE",...} NUMBER, with \\, \" and \n in values.
std::optional<Line> Parse(const std::string& text) {
  Line line;
  std::size_t at = text.find_first_of("{ ");
  if (at == std::string::npos) return std::nullopt;
  line.name = text.substr(0, at);
  while (text[at] == '{' || text[at] == ',') {
    const std::size_t equal = text.find("=\"", at);
    if (equal == std::string::npos) return std::nullopt;
    const std::string label = text.substr(at + 1, equal - at - 1);
    std::string value;
    for (at = equal + 2; at < text.size() && text[at] != '"'; ++at) {
      if (text[at] == '\\') {
        ++at;
        if (at >= text.size()) return std::nullopt;
        if (text[at] != '\\' && text[at] != '"' && text[at] != 'n') return std::nullopt;
        value += text[at] == 'n' ? '\n' : text[at];
      } else {
        value += text[at];
      }
    }
    line.labels[label] = value;
    if (++at >= text.size()) return std::nullopt;
  }
  if (text[at] == '}') ++at;
  if (text[at] != ' ') return std::nullopt;
  line.value = text.substr(at + 1);
  return line;
}

class MetricsTest : public ApiFixture {
 protected:
  std::vector<Line> Scrape() {
    std::vector<Line> lines;
    std::istringstream text(Get("/metrics").body);
    for (std::string line; std::getline(text, line);) {
      if (line.starts_with('#')) continue;
      const auto parsed = Parse(line);
      EXPECT_TRUE(parsed) << line;
      if (parsed) lines.push_back(*parsed);
    }
    return lines;
  }
  // Values of the label campaign.
  std::set<std::string> Campaigns() {
    std::set<std::string> campaigns;
    for (const auto& line : Scrape())
      if (line.name == "etude_demonstrations_total") campaigns.insert(line.labels.at("campaign"));
    return campaigns;
  }
};

TEST_F(MetricsTest, NamesOfStrangersKeepTheFormat) {
  const std::string reason = "a \"quoted\" \\ reason\nof two lines{,}";
  const OrderedJson line{{"index", 3}, {"attempt", 0}, {"outcome", reason}};
  ASSERT_THAT(WriteFileAtomically(lab_.root() / "data" / "attempts.jsonl", JsonText(line) + "\n"), IsOk());
  int found = 0;
  for (const auto& parsed : Scrape()) {
    if (parsed.name != "etude_failed_attempts_total") continue;
    EXPECT_EQ(parsed.labels.at("reason"), reason);
    EXPECT_EQ(parsed.value, "1");
    ++found;
  }
  EXPECT_EQ(found, 1);
}

TEST_F(MetricsTest, EverySampleIsOfAFamilyAndEverySeriesStandsOnce) {
  std::set<std::string> families;
  std::istringstream text(MetricFamilies());
  for (std::string line; std::getline(text, line);) {
    std::istringstream words(line);
    std::string hash, kind, name;
    words >> hash >> kind >> name;
    EXPECT_EQ(hash, "#");
    if (kind == "TYPE") {
      EXPECT_TRUE(families.insert(name).second) << name;
    }
  }
  EXPECT_GT(families.size(), 15u);
  std::set<std::pair<std::string, std::map<std::string, std::string>>> series;
  for (const auto& line : Scrape()) {
    std::string family = line.name;
    for (const char* ending : {"_bucket", "_sum", "_count"})
      if (family.ends_with(ending) && !families.contains(family)) family.erase(family.size() - std::strlen(ending));
    EXPECT_TRUE(families.contains(family)) << line.name;
    EXPECT_TRUE(series.insert({line.name, line.labels}).second) << line.name;
  }
}

TEST_F(MetricsTest, HostsHaveSlots) {
  live::LiveModel model;
  model.view().enabled = true;
  const auto now = MonotonicClock::now();
  bus::Presence one, other;
  one.id = std::string(16, '1'), one.name = "lab";
  other.id = std::string(16, '2'), other.name = "lab";
  model.Directory({one, other}, now);
  const auto say = [&](const bus::Presence& campaign, const char* worker, const char* host, const char* phase) {
    bus::WorkerStatus status;
    status.worker = worker, status.host = host, status.phase = phase;
    model.On(campaign.id, status, now);
  };
  say(one, "a", "lab-7", "play");
  say(other, "a", "lab-7", "idle");
  say(one, "b", "lab-7", "idle");
  say(one, "c", "lab-8", "send");
  say(one, "d", "lab-8", "gone");
  bus::WorkerStatus silent;
  silent.worker = "e", silent.host = "lab-8", silent.phase = "play";
  model.On(one.id, silent, now - std::chrono::seconds(11));
  live_ = std::make_shared<const live::LiveView>(model.view());
  std::map<std::pair<std::string, std::string>, std::string> found;
  for (const auto& line : Scrape())
    if (line.name.starts_with("etude_slots")) found[{line.name, line.labels.at("host")}] = line.value;
  const decltype(found) expected{{{"etude_slots", "lab-7"}, "2"},
                                 {{"etude_slots", "lab-8"}, "1"},
                                 {{"etude_slots_busy", "lab-7"}, "1"},
                                 {{"etude_slots_busy", "lab-8"}, "1"}};
  EXPECT_EQ(found, expected);
}

// before, every server, run and host that there ever was had its series until the gateway ended
TEST(Counters, ASeriesEndsWhenNobodyCountedForTenMinutes) {
  Counters counters;
  const auto start = MonotonicClock::now();
  const Counters::Key away{"run@1", "lab-7"}, stays{"run@2", "lab-7"};
  counters.Saw("answers", away, "a", 30, start);
  for (int minute = 0; minute <= 11; ++minute) {
    counters.Saw("answers", stays, "b", 10 * minute, start + std::chrono::minutes(minute));
    counters.Forget(start + std::chrono::minutes(minute));
    EXPECT_EQ(counters.Sums("answers").contains(away), minute <= 10) << minute;
  }
  EXPECT_EQ(counters.Sums("answers").at(stays), 110);
  counters.Saw("answers", away, "a", 31, start + std::chrono::minutes(12));
  EXPECT_EQ(counters.Sums("answers").at(away), 31) << "it begins anew";
}

// before, all were forgotten, and what each had counted was added once more
TEST(Counters, OneProcessTooManyTakesNothingOfTheOthers) {
  Counters counters;
  const auto now = MonotonicClock::now();
  const Counters::Key key{"run@1", "lab-7"};
  for (std::size_t process = 0; process < Counters::kMost; ++process)
    counters.Saw("answers", key, std::to_string(process), 1, now);
  counters.Saw("answers", key, "one too many", 1, now);
  counters.Saw("answers", key, "0", 2, now);
  EXPECT_EQ(counters.Sums("answers").at(key), Counters::kMost + 1);
}

// before, rollouts counted towards the bound, and forty evaluations hid every demonstration
TEST_F(MetricsTest, DemonstrationsAreThereBesideManyEvaluations) {
  for (int i = 0; i < 40; ++i)
    std::filesystem::copy(lab_.root() / "eval_a", lab_.root() / fmt::format("eval_{}", i),
                          std::filesystem::copy_options::recursive);
  EXPECT_EQ(Campaigns(), (std::set<std::string>{"lab.data"}));
}

TEST_F(MetricsTest, EvaluationsOnTheBusAreNoDemonstrations) {
  const auto here = OpenIdentity(lab_.root() / "eval_a" / "rollouts");
  ASSERT_THAT(here, IsOk());
  const auto now = MonotonicClock::now();
  bus::Presence of_folder, announced, collects;
  of_folder.id = here->id, of_folder.name = "here";
  announced.id = std::string(16, '1'), announced.name = "away";
  collects.id = std::string(16, '2'), collects.name = "lab";
  live::LiveModel model;
  model.view().enabled = true;
  model.Directory({of_folder, announced, collects}, now);
  bus::CampaignAnnouncement announcement;
  announcement.spec_json = R"({"mode": "rollout"})";
  model.On(announced.id, announcement, now);
  announcement.spec_json = R"({"mode": "demonstrate"})";
  model.On(collects.id, announcement, now);
  live_ = std::make_shared<const live::LiveView>(model.view());
  EXPECT_EQ(Campaigns(), (std::set<std::string>{"lab.data", "lab@" + collects.id}));
}

TEST_F(MetricsTest, TheHistogramAddsUp) {
  std::string text;
  const double plans[] = {0.005, 0.01, 0.015, 0.3, 99.0};
  for (int i = 0; i < 5; ++i)
    text +=
        fmt::format("{{\"index\":{},\"attempt\":0,\"outcome\":\"slip\",\"details\":{{\"plan_s\":{}}}}}\n", i, plans[i]);
  ASSERT_THAT(WriteFileAtomically(lab_.root() / "data" / "attempts.jsonl", text), IsOk());
  double before = 0, sum = 0, count = 0;
  int buckets = 0;
  for (const auto& line : Scrape()) {
    if (!line.labels.contains("campaign") || line.labels.at("campaign") != "lab.data") continue;
    const double value = std::strtod(line.value.c_str(), nullptr);
    if (line.name == "etude_plan_seconds_sum") sum = value;
    if (line.name == "etude_plan_seconds_count") count = value;
    if (line.name != "etude_plan_seconds_bucket") continue;
    ++buckets;
    EXPECT_GE(value, before) << "cumulative";
    before = value;
    const std::string edge = line.labels.at("le");
    const double limit = edge == "+Inf" ? 1e99 : std::strtod(edge.c_str(), nullptr);
    EXPECT_EQ(value, std::ranges::count_if(plans, [&](double plan) { return plan <= limit; })) << edge;
  }
  EXPECT_EQ(buckets, 12);
  EXPECT_NEAR(sum, 99.33, 1e-9);
  EXPECT_EQ(count, 5);
  EXPECT_EQ(before, 5) << "the last bucket has all";
}

}  // namespace metrics_test
}  // namespace etude::api
