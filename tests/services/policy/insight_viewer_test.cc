// SPDX-License-Identifier: Apache-2.0
// Tests services/policy/insight_stream.cc and insight_viewer.cc against a policy server by hand, over real DDS.
#include "services/policy/insight_viewer.h"

#include <gtest/gtest.h>

#include <optional>
#include <vector>

#include "services/bus/topic.h"
#include "services/core/clock.h"
#include "services/policy/insight_stream.h"
#include "tests/services/policy/policy_asker.h"
#include "tests/support/matchers.h"
#include "tests/support/wait_until.h"

namespace etude::policy {
namespace insight_viewer_test {

using namespace std::chrono_literals;

constexpr char kFirst[] = "dddd000000000001", kSecond[] = "dddd000000000002";

// A server that shows what it is told to.
class FakeServer {
 public:
  FakeServer(const bus::Participant& participant, const std::string& name, const std::string& id)
      : id_(id),
        presence_(AnnounceServer(participant, name, id)),
        wishes_(bus::Reader<bus::InsightWish>::Open(participant, bus::Owner{name, id}.partition()).value()),
        insights_(bus::Writer<bus::Insight>::Open(participant, bus::Owner{name, id}.partition()).value()) {}

  // The newest wish that came, if any.
  std::optional<bus::InsightWish> Wish() {
    for (auto& wish : wishes_.Take()) newest_ = std::move(wish);
    return newest_;
  }
  void Show(const std::string& viewer, const std::string& session, std::uint64_t step) {
    bus::Insight insight;
    insight.run_id = id_;
    insight.viewer = viewer;
    insight.session = session;
    insight.checkpoint_step = step;
    insight.modules_json = R"({"LANG": {"value": "coke"}})";
    insight.attention_json = "{}";
    ASSERT_TRUE(insights_.WaitForReaders(1, 20s));
    ASSERT_TRUE(insights_.Write(insight));
  }

 private:
  std::string id_;
  bus::Announcement presence_;
  bus::Reader<bus::InsightWish> wishes_;
  bus::Writer<bus::Insight> insights_;
  std::optional<bus::InsightWish> newest_;
};

class PolicyInsightViewer : public PolicyAsker {
 protected:
  InsightViewer OpenViewer(const std::string& run) {
    return InsightViewer::Open(participant_, run, "play-one").value();
  }

  // Until the wish stands.
  static bool Meet(InsightViewer& viewer, FakeServer& server) {
    return WaitUntil([&] {
      EXPECT_THAT(viewer.Take(), IsOk());
      const auto wish = server.Wish();
      return wish && wish->seconds > 0;
    });
  }
  static std::optional<Insight> Await(InsightViewer& viewer) {
    std::optional<Insight> insight;
    WaitUntil([&] {
      auto taken = viewer.Take();
      EXPECT_THAT(taken, IsOk());
      if (taken && *taken) insight = std::move(**taken);
      return insight.has_value();
    });
    return insight;
  }
};

TEST_F(PolicyInsightViewer, IsShownTheSessionThatItWatchesAndNothingElse) {
  FakeServer server(participant_, "view-one", kFirst);
  auto viewer = OpenViewer(std::string("view-one@") + kFirst);
  ASSERT_TRUE(Meet(viewer, server));
  const bus::InsightWish wish = server.Wish().value();
  EXPECT_EQ(wish.session, "play-one");
  EXPECT_EQ(wish.run_id, kFirst);
  EXPECT_EQ(wish.seconds, bus::kWishStands);
  EXPECT_EQ(wish.what_if_json, "");
  server.Show("somebody else", "play-one", 1);
  server.Show(wish.viewer, "play-two", 2);
  server.Show(wish.viewer, "play-one", 3);
  const auto insight = Await(viewer);
  ASSERT_TRUE(insight);
  EXPECT_EQ(insight->checkpoint_step, 3u);
  EXPECT_EQ(insight->modules["LANG"]["value"], "coke");
}

TEST_F(PolicyInsightViewer, WaitsForNothing) {
  auto viewer = OpenViewer("view-nobody");
  const Stopwatch watch;
  const auto none = viewer.Take();
  ASSERT_THAT(none, IsOk());
  EXPECT_FALSE(*none);
  EXPECT_LT(watch.Seconds(), 1);
  EXPECT_FALSE(InsightViewer::Open(participant_, "Two Words", "play-one"));
}

TEST_F(PolicyInsightViewer, GoesOnWithTheServerThatComesInItsPlace) {
  auto viewer = OpenViewer("view-again");
  {
    FakeServer server(participant_, "view-again", kFirst);
    ASSERT_TRUE(Meet(viewer, server));
  }
  FakeServer server(participant_, "view-again", kSecond);
  ASSERT_TRUE(Meet(viewer, server));
  server.Show(server.Wish()->viewer, "play-one", 9);
  const auto insight = Await(viewer);
  ASSERT_TRUE(insight);
  EXPECT_EQ(insight->checkpoint_step, 9u);
}

TEST_F(PolicyInsightViewer, AStreamIsEverybodysAndSaysWhoseServerItIs) {
  bus::InsightWish wish;
  wish.viewer = "stream-one";
  wish.what_if_json = R"({"worth":true})";
  auto stream = InsightStream::Open(participant_, {.name = "view-stream", .id = ""}, wish).value();
  const auto meet = [&](FakeServer& server) {
    return WaitUntil([&] {
      EXPECT_THAT(stream.Take(), IsOk());
      return server.Wish() && server.Wish()->seconds > 0;
    });
  };
  EXPECT_THAT(stream.Take(), IsOk());
  EXPECT_FALSE(stream.server());
  {
    FakeServer server(participant_, "view-stream", kFirst);
    ASSERT_TRUE(meet(server));
    EXPECT_EQ(server.Wish()->session, "");
    EXPECT_EQ(server.Wish()->what_if_json, wish.what_if_json);
    server.Show("somebody else", "play-one", 1);
    std::vector<std::uint64_t> steps;
    const auto take = [&](std::size_t count) {
      return WaitUntil([&] {
        for (const auto& insight : stream.Take().value()) steps.push_back(insight.checkpoint_step);
        return steps.size() == count;
      });
    };
    // in one burst, as a server shows those of all sessions
    server.Show("stream-one", "play-one", 2);
    server.Show("stream-one", "play-two", 3);
    ASSERT_TRUE(take(2));
    EXPECT_EQ(steps, (std::vector<std::uint64_t>{2, 3}));
    EXPECT_EQ(stream.server()->id, kFirst);
  }
  FakeServer server(participant_, "view-stream", kSecond);
  ASSERT_TRUE(meet(server));
  EXPECT_EQ(stream.server()->id, kSecond);
}

TEST_F(PolicyInsightViewer, TakesItsWishBack) {
  FakeServer server(participant_, "view-end", kFirst);
  {
    auto viewer = OpenViewer("view-end");
    ASSERT_TRUE(Meet(viewer, server));
  }
  EXPECT_TRUE(WaitUntil([&] { return server.Wish()->seconds == 0; }));
}

TEST_F(PolicyInsightViewer, SaysWhatANameThatMeansTwoServersMeans) {
  FakeServer one(participant_, "view-two", kFirst), other(participant_, "view-two", kSecond);
  auto viewer = OpenViewer("view-two");
  std::string said;
  EXPECT_TRUE(WaitUntil([&] {
    const auto taken = viewer.Take();
    if (!taken) said = taken.error().message;
    return !said.empty();
  }));
  EXPECT_NE(said.find(kFirst), std::string::npos) << said;
  EXPECT_NE(said.find(kSecond), std::string::npos) << said;
}

}  // namespace insight_viewer_test
}  // namespace etude::policy
