// SPDX-License-Identifier: Apache-2.0
// Tests services/campaign/collector_sampling.cc, and what workers make of it, over a real bus.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <functional>

#include "services/campaign/process.h"
#include "services/core/share.h"
#include "services/store/dataset.h"
#include "services/store/sampling_journal.h"
#include "tests/services/campaign/fake_work.h"
#include "tests/services/campaign/running_collector.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/wait_until.h"

namespace etude::campaign {
namespace adaptive_sampling_test {

constexpr std::uint32_t kDomain = 99;
constexpr char kRun[] = "0123456789abcdef";
constexpr char kOtherRun[] = "fedcba9876543210";

CampaignSpec Spec(const std::string& name, std::uint64_t episodes, std::uint64_t every) {
  CampaignSpec spec = SyntheticSpec();
  spec.name = name + "-" + std::to_string(::getpid());
  spec.episodes = episodes;
  spec.max_attempts = 100;
  spec.adaptive_sampling = {.share = 0.5, .largest_ratio = 3, .every = every};
  return spec;
}

// as far from uniform as the bound lets it
const std::vector<ErrorCell> kExtreme{{"push", "coke", 3, 90, 9}, {"pick", "milk", 4, 90, 0.01}};
const std::vector<ErrorCell> kOther{{"pick", "milk", 4, 90, 9}, {"push", "coke", 3, 90, 0.01}};

class AdaptiveSampling : public testing::Test {
 protected:
  void SetUp() override {
    auto opened = bus::Participant::Open({kDomain, ""});
    ASSERT_TRUE(opened) << opened.error().message;
    participant_ = std::make_unique<bus::Participant>(std::move(*opened));
  }
  Result<Collector> Open(const CampaignSpec& spec, const Path& folder) {
    CollectorOptions options = QuickOptions();
    options.run_id = kRun;
    return Collector::Open(*participant_, spec, folder, options);
  }
  Process StartWorker(const CampaignSpec& spec, int ms_per_attempt) {
    auto process = Process::Start({{(ProgramFolder() / "fake_worker").string(), spec.name, std::to_string(kDomain),
                                    std::to_string(ms_per_attempt)},
                                   folder_ / "w.log"});
    EXPECT_TRUE(process) << (process ? "" : process.error().message);
    return std::move(*process);
  }
  store::SamplingJournal Journal(const Path& folder, const CampaignSpec& spec) {
    auto journal = store::SamplingJournal::Open(folder, spec);
    EXPECT_TRUE(journal) << (journal ? "" : journal.error().message);
    return std::move(*journal);
  }

  std::unique_ptr<bus::Participant> participant_;
  TemporaryFolder folder_;
};

// A trainer, but for the training.
class Critic {
 public:
  Critic(const bus::Participant& participant, Running& running, const CampaignSpec& spec)
      : running_(running),
        writer_(std::move(*bus::Writer<bus::ValidationErrors>::Open(participant, PartitionOf(running, spec)))) {
    EXPECT_TRUE(writer_.WaitForReaders(1, 10s));
    message.campaign = spec.name;
    message.campaign_id = running->id();
    message.run_id = kRun;
  }
  void Say(const std::vector<ErrorCell>& cells) {
    message.errors_json = ErrorCellsText(cells);
    EXPECT_TRUE(writer_.Write(message));
  }
  // Returns once what was said before it was taken, too: one writer's messages come in order.
  void SayWrongly(const bus::ValidationErrors& wrong) {
    const std::uint64_t before = running_->progress().refused_errors;
    EXPECT_TRUE(writer_.Write(wrong));
    EXPECT_TRUE(WaitUntil([&] { return running_->progress().refused_errors == before + 1; }));
  }
  void SayAndBeHeard(const std::vector<ErrorCell>& cells) {
    Say(cells);
    bus::ValidationErrors forged = message;
    forged.run_id = kOtherRun;
    SayWrongly(forged);
  }

  bus::ValidationErrors message;

 private:
  Running& running_;
  bus::Writer<bus::ValidationErrors> writer_;
};

// Makes what is leased until `index` comes, and returns its lease.
bus::Lease WorkUpTo(RawWorker& worker, const CampaignSpec& spec, std::uint64_t index) {
  while (true) {
    const bus::Lease lease = worker.Ask();
    if (lease.kind != bus::LeaseKind::kWork || lease.index >= index) return lease;
    const auto weights = ParseWeights(lease.sampling_json, spec);
    EXPECT_THAT(weights, IsOk());
    const Episode episode = FakeEpisode(spec, lease.index, lease.attempt, weights.value_or(SamplingWeights()));
    if (worker.Send(lease, episode).kind != bus::AckKind::kDone) {
      ADD_FAILURE() << "index " << lease.index;
      return lease;
    }
  }
}

// what every worker makes, in whatever order, is what the spec and the journal say
void ExpectMadeByTheJournal(const Path& dataset, const CampaignSpec& spec, const store::SamplingJournal& journal) {
  const auto reader = store::DatasetReader::Open(dataset);
  ASSERT_THAT(reader, IsOk());
  const auto indices = reader->List();
  ASSERT_THAT(indices, IsOk());
  ASSERT_EQ(indices->size(), spec.episodes);
  int follow = 0;
  for (const std::uint64_t index : *indices) {
    const auto record = reader->Read(index);
    ASSERT_THAT(record, IsOk());
    const EpisodePlan plan = PlanEpisode(spec, index, record->episode.attempt, journal.At(index));
    EXPECT_EQ(record->episode.task, plan.task.text()) << index;
    EXPECT_EQ(WeightsOf(record->episode.details), plan.weights_sha256) << index;
    follow += plan.follows_weights;
  }
  EXPECT_GT(follow, 0);
  const auto report = store::Verify(dataset, store::Quarantine::kNo);
  ASSERT_THAT(report, IsOk());
  EXPECT_EQ(report->good, spec.episodes);
}

TEST_F(AdaptiveSampling, TwoWorkersMakeWhatOneMakesAgainFromSpecAndJournal) {
  const CampaignSpec spec = Spec("adaptive", 120, 20);
  {
    Running running(std::move(*Open(spec, folder_ / "data")));
    Critic critic(*participant_, running, spec);
    critic.SayAndBeHeard(kExtreme);
    Process a = StartWorker(spec, 20), b = StartWorker(spec, 20);
    ASSERT_TRUE(WaitUntil([&] { return running->progress().reweighted == 1; }));
    critic.Say(kOther);
    running.Join();
    EXPECT_TRUE(running.status());
    EXPECT_EQ(running->progress().refused, 0u);
  }
  const auto journal = Journal(folder_ / "data", spec);
  ASSERT_EQ(journal.entries().size(), 2u);
  EXPECT_EQ(journal.entries()[0].from_index, 20u) << "the first that may be, and nobody was leased";
  EXPECT_GE(journal.entries()[1].from_index, 40u);
  EXPECT_EQ(journal.entries()[0].run, kRun);
  EXPECT_NE(journal.entries()[0].weights, journal.entries()[1].weights);
  ExpectMadeByTheJournal(folder_ / "data", spec, journal);

  // elsewhere, from its spec and its journal alone
  ASSERT_TRUE(MakeFolders(folder_ / "again"));
  std::filesystem::copy_file(folder_ / "data/sampling.jsonl", folder_ / "again/sampling.jsonl");
  {
    Running running(std::move(*Open(spec, folder_ / "again")));
    Process worker = StartWorker(spec, 0);
    running.Join();
    EXPECT_EQ(running->progress().reweighted, 2u);
  }
  EXPECT_EQ(store::HashDataset(folder_ / "again").value(), store::HashDataset(folder_ / "data").value());
}

TEST_F(AdaptiveSampling, AnEntryIsDurableBeforeItsFirstEpisodeIsLeasedAndOutlivesTheCollector) {
  const CampaignSpec spec = Spec("restart", 30, 10);
  bus::Lease before;
  {
    Running running(std::move(*Open(spec, folder_ / "data")));
    Critic critic(*participant_, running, spec);
    critic.message.step = 750;
    critic.SayAndBeHeard(kExtreme);
    RawWorker worker(*participant_, spec, running->id(), "first");
    EXPECT_EQ(WorkUpTo(worker, spec, 9).sampling_json, "") << "not before so many episodes";
    EXPECT_FALSE(std::filesystem::exists(folder_ / "data/sampling.jsonl"));
    before = WorkUpTo(worker, spec, 10);
    ASSERT_EQ(before.index, 10u);
    const auto entries = Journal(folder_ / "data", spec).entries();
    ASSERT_EQ(entries.size(), 1u);
    EXPECT_EQ(entries[0].from_index, 10u);
    EXPECT_EQ(entries[0].step, 750u);
    EXPECT_EQ(WeightsText(entries[0].weights), before.sampling_json);
    EXPECT_EQ(entries[0].weights, WeightsFor(kExtreme, spec));
    EXPECT_EQ(running->progress().reweighted_from, 10u);
  }
  Running running(std::move(*Open(spec, folder_ / "data")));
  EXPECT_EQ(running->progress().reweighted, 1u);
  RawWorker worker(*participant_, spec, running->id(), "second");
  const bus::Lease after = worker.Ask();
  EXPECT_EQ(after.index, 10u);
  EXPECT_EQ(after.sampling_json, before.sampling_json);
  EXPECT_GT(after.token, before.token) << "of a later start";

  const bus::Verdict refused = worker.Send(after, FakeEpisode(spec, 10, 0));
  EXPECT_EQ(refused.kind, bus::AckKind::kRefused) << "made without the weights";
  EXPECT_NE(refused.reason.find("sampling weights"), std::string::npos) << refused.reason;
  EXPECT_EQ(WorkUpTo(worker, spec, 12).index, 12u) << "made with them it is taken";
}

TEST_F(AdaptiveSampling, WhatMayFollowFollowsNoSoonerThanTheSpecSaysAndIsTheNewest) {
  const CampaignSpec spec = Spec("every", 40, 10);
  Running running(std::move(*Open(spec, folder_ / "data")));
  Critic critic(*participant_, running, spec);
  RawWorker worker(*participant_, spec, running->id(), "raw");
  const bus::Lease late = WorkUpTo(worker, spec, 13);
  critic.SayAndBeHeard(kExtreme);
  EXPECT_EQ(worker.Ask().token, late.token);
  EXPECT_EQ(late.sampling_json, "") << "what was leased stays as it was";
  const auto weights = [&](std::uint64_t index) {
    const auto parsed = ParseWeights(WorkUpTo(worker, spec, index).sampling_json, spec);
    EXPECT_THAT(parsed, IsOk());
    return parsed.value_or(SamplingWeights());
  };
  EXPECT_EQ(weights(14), WeightsFor(kExtreme, spec));
  critic.SayAndBeHeard({{"pick", "cube", 0, 5, 1}});
  critic.SayAndBeHeard(kOther);
  EXPECT_EQ(weights(23), WeightsFor(kExtreme, spec)) << "nine after the last change";
  EXPECT_EQ(weights(24), WeightsFor(kOther, spec));
  EXPECT_EQ(running->progress().reweighted, 2u);
}

TEST_F(AdaptiveSampling, MessagesOfOthersAndMalformedOnesChangeNothing) {
  const CampaignSpec spec = Spec("hostile", 30, 10);
  Running running(std::move(*Open(spec, folder_ / "data")));
  Critic critic(*participant_, running, spec);
  critic.message.errors_json = ErrorCellsText(kExtreme);
  const auto wrongly = [&](const std::function<void(bus::ValidationErrors&)>& change) {
    bus::ValidationErrors wrong = critic.message;
    change(wrong);
    critic.SayWrongly(wrong);
  };
  wrongly([](auto& message) { message.campaign_id = kOtherRun; });
  wrongly([](auto& message) { message.run_id = kOtherRun; });
  wrongly([](auto& message) { message.run_id = "../evil"; });
  wrongly([](auto& message) { message.run_id = ""; });
  for (const char* text : {"", "[]", "{", "[[[[[[[[]]]]]]]]", R"([{"object": "duck", "episodes": 1}])",
                           R"([{"object": "coke", "episodes": 1, "place": 99}])",
                           R"([{"object": "coke", "episodes": 1, "error": 1e999}])"})
    wrongly([&](auto& message) { message.errors_json = text; });
  wrongly([](auto& message) { message.errors_json = std::string(1 << 20, '['); });

  RawWorker worker(*participant_, spec, running->id(), "raw");
  EXPECT_EQ(WorkUpTo(worker, spec, 12).sampling_json, "");
  EXPECT_EQ(running->progress().reweighted, 0u);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "data/sampling.jsonl"));
}

TEST_F(AdaptiveSampling, ACampaignWithoutItTakesNoErrors) {
  CampaignSpec spec = Spec("off", 30, 10);
  spec.adaptive_sampling = {};
  Running running(std::move(*Open(spec, folder_ / "data")));
  Critic critic(*participant_, running, spec);
  critic.message.errors_json = ErrorCellsText(kExtreme);
  critic.SayWrongly(critic.message);
  RawWorker worker(*participant_, spec, running->id(), "raw");
  EXPECT_EQ(WorkUpTo(worker, spec, 12).sampling_json, "");
}

TEST_F(AdaptiveSampling, LeasingWaitsWhileTheJournalCannotBeWritten) {
  const CampaignSpec spec = Spec("full", 30, 10);
  Running running(std::move(*Open(spec, folder_ / "data")));
  const Path in_its_place = folder_ / "data/sampling.jsonl/something";
  ASSERT_TRUE(MakeFolders(in_its_place));
  Critic critic(*participant_, running, spec);
  critic.SayAndBeHeard(kExtreme);
  RawWorker worker(*participant_, spec, running->id(), "raw");

  EXPECT_EQ(WorkUpTo(worker, spec, 10).kind, bus::LeaseKind::kWait);
  EXPECT_NE(running->progress().error.find("leasing waits"), std::string::npos) << running->progress().error;
  EXPECT_EQ(running->progress().committed, 10u);

  std::filesystem::remove_all(in_its_place.parent_path());
  const bus::Lease lease = worker.Ask();
  EXPECT_EQ(lease.kind, bus::LeaseKind::kWork);
  EXPECT_EQ(lease.index, 10u);
  EXPECT_EQ(lease.sampling_json, WeightsText(WeightsFor(kExtreme, spec)));
  EXPECT_EQ(running->progress().error, "");
}

}  // namespace adaptive_sampling_test
}  // namespace etude::campaign
