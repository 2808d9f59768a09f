// SPDX-License-Identifier: Apache-2.0
// A collector over a real bus, with worker processes that are killed; of the tests of collector_test.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <memory>
#include <string>
#include <utility>

#include "services/campaign/collector.h"
#include "services/campaign/process.h"
#include "services/core/command.h"
#include "services/core/share.h"
#include "services/store/dataset.h"
#include "tests/services/campaign/fake_work.h"
#include "tests/services/campaign/running_collector.h"
#include "tests/support/temporary_folder.h"

namespace etude::campaign {

inline constexpr std::uint32_t kCollectorDomain = 80;

inline CampaignSpec Spec(const std::string& name, std::uint64_t episodes) {
  CampaignSpec spec = SyntheticSpec();
  spec.name = name + "-" + std::to_string(::getpid());
  spec.episodes = episodes;
  spec.max_attempts = 100;
  return spec;
}

// `campaign`: NAME or NAME@ID
inline Process StartWorkerOf(const std::string& campaign, const Path& log, int ms_per_attempt,
                             std::uint32_t content = kContentVersion, const char* prefetch = "") {
  auto process =
      Process::Start({{(ProgramFolder() / "fake_worker").string(), campaign, std::to_string(kCollectorDomain),
                       std::to_string(ms_per_attempt), std::to_string(content)},
                      log,
                      {{"FAKE_PREFETCH", prefetch}}});
  EXPECT_TRUE(process) << (process ? "" : process.error().message);
  return std::move(*process);
}

inline Process StartPrefetching(const CampaignSpec& spec, const Path& log, int ms_per_attempt) {
  return StartWorkerOf(spec.name, log, ms_per_attempt, kContentVersion, "1");
}

inline Process StartWorker(const CampaignSpec& spec, const Path& log, int ms_per_attempt) {
  return StartWorkerOf(spec.name, log, ms_per_attempt);
}

class CollectorTest : public testing::Test {
 protected:
  void SetUp() override {
    auto opened = bus::Participant::Open({kCollectorDomain, ""});
    ASSERT_TRUE(opened) << opened.error().message;
    participant_ = std::make_unique<bus::Participant>(std::move(*opened));
  }
  Result<Collector> Open(const CampaignSpec& spec, const Path& folder, Claim claim = Claim::kRefuse) {
    CollectorOptions options = QuickOptions();
    options.claim = claim;
    return Collector::Open(*participant_, spec, folder, options);
  }

  // what must be in the folder at the end, whoever made it
  void ExpectWhole(const CampaignSpec& spec, const Path& dataset) {
    const auto reader = store::DatasetReader::Open(dataset);
    ASSERT_TRUE(reader) << reader.error().message;
    const auto indices = reader->List();
    ASSERT_TRUE(indices);
    ASSERT_EQ(indices->size(), spec.episodes) << "nothing lost";
    for (const std::uint64_t index : *indices) {
      const auto record = reader->Read(index);
      ASSERT_TRUE(record) << record.error().message;
      EXPECT_EQ(record->episode.attempt, FakeCommittedAttempt(index)) << index;
    }
    const auto report = store::Verify(dataset, store::Quarantine::kNo);
    ASSERT_TRUE(report);
    EXPECT_EQ(report->good, spec.episodes);
    EXPECT_TRUE(report->bad.empty());
  }

  std::unique_ptr<bus::Participant> participant_;
  TemporaryFolder folder_;
};

}  // namespace etude::campaign
