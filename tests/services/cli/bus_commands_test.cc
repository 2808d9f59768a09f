// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/campaign.cc, top.cc, topic.cc and bus_watch.cc against a collector, as a user meets them
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <functional>
#include <future>
#include <optional>
#include <thread>

#include "services/bus/process_reporter.h"
#include "services/bus/topic.h"
#include "services/core/command.h"
#include "services/core/stop.h"
#include "services/store/dataset.h"
#include "services/store/filter_keys.h"
#include "tests/services/campaign/fake_work.h"
#include "tests/services/campaign/running_collector.h"
#include "tests/support/etude_command.h"
#include "tests/support/temporary_folder.h"

namespace etude::campaign {
namespace bus_commands_test {

using testing::ContainsRegex;
using testing::HasSubstr;

constexpr std::uint32_t kDomain = 87;

// What stands behind the lines of the log.
OrderedJson JsonIn(const std::string& text) {
  const auto begin = text.find('{');
  return begin == std::string::npos ? OrderedJson() : OrderedJson::parse(text.substr(begin), nullptr, false);
}

class BusCommands : public testing::Test {
 protected:
  void SetUp() override {
    spec_ = SyntheticSpec();
    spec_.name = "commands-" + std::to_string(::getpid());
    spec_.episodes = 6;
    auto participant = bus::Participant::Open({kDomain, ""});
    ASSERT_TRUE(participant) << participant.error().message;
    participant_ = std::make_unique<bus::Participant>(std::move(*participant));
    auto collector = Collector::Open(*participant_, spec_, folder_ / "data", QuickOptions());
    ASSERT_TRUE(collector) << collector.error().message;
    running_ = std::make_unique<Running>(std::move(*collector));
  }
  CommandOutcome Etude(std::vector<std::string> arguments, const std::string& log = "output.txt") {
    arguments.insert(arguments.end(), {"--domain", std::to_string(kDomain)});
    return RunEtude(arguments, folder_ / log);
  }
  // `etude top --once` looks for a second and a half, which may be short on a busy machine: until it shows what is
  // there, at most ten times.
  CommandOutcome TopUntil(const std::function<bool(const std::string&)>& shows,
                          const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments{"top", "--once"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    CommandOutcome top;
    for (int look = 0; look < 10; ++look) {
      top = Etude(arguments);
      if (top.exit_code != kExitOk || shows(top.text)) break;
    }
    return top;
  }
  CommandOutcome Campaign(const std::string& action, const std::string& log = "output.txt") {
    return Etude({"campaign", action, spec_.name}, log);
  }
  bus::Verdict Finish(RawWorker& worker, const bus::Lease& lease) {
    return worker.Send(lease, FakeEpisode(spec_, lease.index, lease.attempt));
  }

  TemporaryFolder folder_;
  CampaignSpec spec_;
  std::unique_ptr<bus::Participant> participant_;
  std::unique_ptr<Running> running_;
};

TEST_F(BusCommands, TopHasARowForEachWorker) {
  const std::string partition = bus::Owner{spec_.name, (*running_)->id()}.partition();
  auto writer = bus::Writer<bus::WorkerStatus>::Open(*participant_, partition);
  ASSERT_TRUE(writer);
  const std::jthread beating([&](const std::stop_token& ended) {
    bus::WorkerStatus status;
    status.campaign = spec_.name;
    status.campaign_id = (*running_)->id();
    status.phase = "plan";
    for (int beat = 0; !ended.stop_requested(); ++beat, WaitForStop(20ms)) {
      status.worker = beat % 2 == 0 ? "first" : "second";
      EXPECT_TRUE(writer->Write(status));
    }
  });
  const auto names_in = [](const std::string& text) {
    auto json = JsonIn(text);
    std::vector<std::string> names;
    for (const auto& campaign : json["campaigns"])
      for (const auto& worker : campaign["worker_list"]) names.push_back(worker["worker"]);
    return names;
  };
  const auto top = TopUntil([&](const std::string& text) { return names_in(text).size() == 2; }, {"--json"});
  ASSERT_EQ(top.exit_code, kExitOk) << top.text;
  auto json = JsonIn(top.text);
  ASSERT_EQ(json["campaigns"].size(), 1u) << top.text;
  EXPECT_THAT(names_in(top.text), testing::UnorderedElementsAre("first", "second"));
}

TEST_F(BusCommands, PauseLeasesNothingNewAndLosesNothing) {
  RawWorker first(*participant_, spec_, (*running_)->id(), "first");
  RawWorker second(*participant_, spec_, (*running_)->id(), "second");
  const bus::Lease lease = first.Ask();
  ASSERT_EQ(lease.kind, bus::LeaseKind::kWork);

  const auto paused = Campaign("pause");
  EXPECT_EQ(paused.exit_code, kExitOk) << paused.text;
  EXPECT_THAT(paused.text, HasSubstr(": paused, 0 of 6 committed"));
  EXPECT_THAT(paused.text,
              ContainsRegex("etude campaign resume .* --domain " + std::to_string(participant_->domain()) + "\n"));
  EXPECT_EQ(second.Ask().kind, bus::LeaseKind::kWait);
  EXPECT_EQ(first.Ask().index, lease.index) << "who asks again is told what it holds";
  EXPECT_EQ(Finish(first, lease).kind, bus::AckKind::kDone) << "what is leased is committed";
  EXPECT_EQ(first.Ask().kind, bus::LeaseKind::kWait);

  const auto resumed = Campaign("resume");
  EXPECT_EQ(resumed.exit_code, kExitOk) << resumed.text;
  EXPECT_THAT(resumed.text, HasSubstr(": running, 1 of 6 committed"));
  EXPECT_EQ(second.Ask().kind, bus::LeaseKind::kWork);

  const auto again = Campaign("resume");
  EXPECT_EQ(again.exit_code, kExitUsage);
  EXPECT_THAT(again.text, HasSubstr("refused: campaign '" + spec_.name + "' is not paused"));
}

TEST_F(BusCommands, DrainWaitsForWhatIsLeased) {
  RawWorker worker(*participant_, spec_, (*running_)->id(), "worker");
  const bus::Lease lease = worker.Ask();
  ASSERT_EQ(lease.kind, bus::LeaseKind::kWork);
  auto drained = std::async(std::launch::async, [this] { return Campaign("drain", "drain.txt"); });
  auto statuses = bus::Reader<bus::CampaignStatus>::Open(*participant_, PartitionOf(*running_, spec_));
  ASSERT_TRUE(statuses);
  std::string state;
  while (state != "draining" && statuses->Wait(20s))
    for (const auto& status : statuses->Take()) state = status.state;
  EXPECT_EQ(state, "draining");
  EXPECT_EQ(Finish(worker, lease).kind, bus::AckKind::kDone);

  const auto outcome = drained.get();
  EXPECT_EQ(outcome.exit_code, kExitOk) << outcome.text;
  EXPECT_THAT(outcome.text, HasSubstr(": paused, 1 of 6 committed"));
}

TEST_F(BusCommands, StopEndsTheCollectorWhichResumesLater) {
  const auto stopped = Campaign("stop");
  EXPECT_EQ(stopped.exit_code, kExitOk) << stopped.text;
  EXPECT_THAT(stopped.text, HasSubstr(": stopping"));
  running_->Join();
  EXPECT_TRUE(running_->status());
  EXPECT_FALSE((*running_)->progress().complete);
  running_.reset();

  const auto gone = Campaign("pause");
  EXPECT_EQ(gone.exit_code, kExitFailure);
  EXPECT_THAT(gone.text, HasSubstr("is not live on domain 87"));

  Running again(std::move(*Collector::Open(*participant_, spec_, folder_ / "data", QuickOptions())));
  RawWorker worker(*participant_, spec_, again->id(), "worker");
  EXPECT_EQ(worker.Ask().kind, bus::LeaseKind::kWork);
}

TEST_F(BusCommands, AFilterKeyIsWrittenByTheCollectorWhileItHasTheDataset) {
  RawWorker worker(*participant_, spec_, (*running_)->id(), "worker");
  const bus::Lease lease = worker.Ask();
  ASSERT_EQ(Finish(worker, lease).kind, bus::AckKind::kDone);
  const Path data = folder_ / "data";
  const auto filter = [&](const std::string& key) {
    return Etude({"dataset", "filter", data.string(), "--index", std::to_string(lease.index), "--as", key});
  };

  const auto written = filter("mine");
  EXPECT_EQ(written.exit_code, kExitOk) << written.text;
  EXPECT_THAT(written.text, HasSubstr("filter key 'mine': 1 episodes"));
  EXPECT_EQ(*store::ReadFilterKeys(data), (store::FilterKeys{{"mine", {lease.index}}}));

  const auto elsewhere = RunEtude(
      {"dataset", "filter", data.string(), "--index", std::to_string(lease.index), "--as", "other", "--domain", "88"},
      folder_ / "elsewhere.txt");
  EXPECT_EQ(elsewhere.exit_code, kExitMachine);
  EXPECT_THAT(elsewhere.text, HasSubstr("being written by another process"));
  EXPECT_THAT(elsewhere.text, HasSubstr("were it a collector on domain 88"));

  running_.reset();
  EXPECT_EQ(filter("later").exit_code, kExitOk) << "nobody has it: by itself";
  EXPECT_EQ(store::ReadFilterKeys(data)->size(), 2u);
}

TEST_F(BusCommands, ShowWhatIsLive) {
  const auto list = Etude({"campaign", "list"});
  EXPECT_EQ(list.exit_code, kExitOk) << list.text;
  EXPECT_THAT(list.text, HasSubstr(spec_.name + "@" + (*running_)->id() + "  running  0/6"));

  const auto status = Etude({"campaign", "status", spec_.name, "--json"});
  ASSERT_EQ(status.exit_code, kExitOk) << status.text;
  const auto json = JsonIn(status.text);
  EXPECT_EQ(json["total"], 6);
  EXPECT_EQ(json["state"], "running");

  const std::string collecting = spec_.name + ": collecting 0 of 6";
  const auto top = TopUntil([&](const std::string& text) { return text.find(collecting) != std::string::npos; });
  EXPECT_EQ(top.exit_code, kExitOk) << top.text;
  EXPECT_THAT(top.text, HasSubstr(collecting));
  const auto as_json =
      TopUntil([](const std::string& text) { return JsonIn(text)["campaigns"][0]["total"] == 6; }, {"--json"});
  ASSERT_EQ(as_json.exit_code, kExitOk) << as_json.text;
  EXPECT_EQ(JsonIn(as_json.text)["campaigns"][0]["total"], 6) << as_json.text;
  EXPECT_EQ(Etude({"top", "--json"}).exit_code, kExitUsage) << "one object, not one a second";
}

TEST_F(BusCommands, OfACampaignInShardsAllThatAreThereAreMeant) {
  running_.reset();
  std::vector<std::unique_ptr<Running>> shards;
  for (std::uint32_t number : {1, 2}) {
    CollectorOptions options = QuickOptions();
    options.shard = {number, 3};
    auto collector = Collector::Open(*participant_, spec_, folder_ / fmt::format("shard{}", number), options);
    ASSERT_TRUE(collector) << collector.error().message;
    shards.push_back(std::make_unique<Running>(std::move(*collector)));
  }
  const auto status = Campaign("status");
  EXPECT_EQ(status.exit_code, kExitOk) << status.text;
  for (const char* text : {"shard 1/3", "shard 2/3", "2 of 3 shards are there: 0 of their 4 committed"})
    EXPECT_THAT(status.text, HasSubstr(text));
  const auto json = JsonIn(Etude({"campaign", "status", spec_.name, "--json"}).text);
  EXPECT_EQ(json["shard_count"], 3);
  EXPECT_EQ(json["total"], 4);
  EXPECT_EQ(json["shards"].size(), 2u);

  const auto paused = Campaign("pause");
  EXPECT_EQ(paused.exit_code, kExitOk) << paused.text;
  for (const auto& shard : shards) EXPECT_THAT(paused.text, HasSubstr((*shard)->id() + ": paused, 0 of 2 committed"));
  EXPECT_THAT(paused.text, HasSubstr("etude campaign resume " + spec_.name + " --domain " +
                                     std::to_string(participant_->domain()) + "\n"));
  RawWorker worker(*participant_, spec_, (*shards[0])->id(), "worker");
  EXPECT_EQ(worker.Ask().kind, bus::LeaseKind::kWait);
  EXPECT_EQ(Etude({"campaign", "resume", spec_.name + "@" + (*shards[0])->id()}).exit_code, kExitOk);
  EXPECT_EQ(worker.Ask().kind, bus::LeaseKind::kWork);
  const auto rest = Campaign("resume");
  EXPECT_EQ(rest.exit_code, kExitUsage) << "one of them was not paused any more";
  EXPECT_THAT(rest.text, HasSubstr((*shards[1])->id() + ": running"));
}

TEST_F(BusCommands, TopicsAndTheirMessages) {
  const auto list = Etude({"topic", "list"});
  EXPECT_EQ(list.exit_code, kExitOk) << list.text;
  EXPECT_THAT(list.text, HasSubstr("etude/campaign/status\n  type     etude::wire::CampaignStatus\n"));
  EXPECT_THAT(list.text, HasSubstr("reliable, transient-local, last 1"));

  const auto echo =
      Etude({"topic", "echo", "etude/campaign/status", "--count", "1", "--partition", PartitionOf(*running_, spec_)});
  ASSERT_EQ(echo.exit_code, kExitOk) << echo.text;
  const auto message = JsonIn(echo.text);
  EXPECT_EQ(message["campaign"], spec_.name);
  EXPECT_EQ(message["total"], 6);

  // who counts is each writer's own process: the programs start one
  const auto reporter = bus::ProcessReporter::Start(*participant_, {.role = "collector", .every = 100ms});
  ASSERT_TRUE(reporter) << reporter.error().message;
  std::optional<OrderedJson> rate;
  CommandOutcome hz;
  for (int look = 0; look < 10 && !rate; ++look) {  // two seconds may be short on a busy machine
    hz = Etude({"topic", "hz", "etude/campaign/status", "--seconds", "2", "--json"});
    ASSERT_EQ(hz.exit_code, kExitOk) << hz.text;
    const auto rates = OrderedJson::parse(hz.text.substr(hz.text.rfind("\n[") + 1), nullptr, false);
    ASSERT_TRUE(rates.is_array()) << hz.text;
    for (const auto& one : rates)
      if (one["topic"] == "etude/campaign/status" && one["samples_per_second"] > 0.0) rate = one;
  }
  ASSERT_TRUE(rate) << hz.text;
  EXPECT_GT((*rate)["bytes_per_second"], 0.0);
  EXPECT_EQ((*rate)["writers"], 1);

  const auto bulk = Etude({"topic", "echo", "etude/blob/chunk"});
  EXPECT_EQ(bulk.exit_code, kExitUsage);
  EXPECT_THAT(bulk.text, HasSubstr("etude topic hz etude/blob/chunk"));
  const auto unknown = Etude({"topic", "echo", "etude/campaign/statu"});
  EXPECT_EQ(unknown.exit_code, kExitUsage);
  EXPECT_THAT(unknown.text, HasSubstr("did you mean 'etude/campaign/status'"));
}

}  // namespace bus_commands_test
}  // namespace etude::campaign
