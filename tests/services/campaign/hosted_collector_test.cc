// SPDX-License-Identifier: Apache-2.0
// Tests services/campaign/hosted_collector.cc
#include "services/campaign/hosted_collector.h"

#include <gtest/gtest.h>

#include "services/store/dataset.h"
#include "tests/support/temporary_folder.h"

namespace etude::campaign {
namespace hosted_collector_test {

constexpr std::uint32_t kDomain = 97;

// before, `train --collect` read the file without putting names in the place of generated:train
TEST(HostedCollector, TakesGeneratedObjectsByTheWordsThatCommandsTake) {
  const TemporaryFolder folder;
  const Path file = folder / "campaign.yaml";
  ASSERT_TRUE(
      WriteFileAtomically(file, "name: hosted\nepisodes: 2\nobjects: [generated:train]\nobjects_per_scene: 3\n"));
  const auto participant = bus::Participant::Open({kDomain, ""});
  ASSERT_TRUE(participant) << participant.error().message;

  const auto collector = HostedCollector::Start(*participant, file.string(), folder / "dataset");

  ASSERT_TRUE(collector) << collector.error().message;
  EXPECT_TRUE((*collector)->status());
  const auto dataset = store::DatasetReader::Open(folder / "dataset");
  ASSERT_TRUE(dataset) << dataset.error().message;
  EXPECT_EQ(dataset->spec().objects.size(), 30u);
}

TEST(HostedCollector, SaysWhatIsWrongWithItsFile) {
  const TemporaryFolder folder;
  const auto participant = bus::Participant::Open({kDomain, ""});
  ASSERT_TRUE(participant);
  EXPECT_EQ(HostedCollector::Start(*participant, "/nonexistent.yaml", folder / "d").error().code,
            Code::kInvalidArgument);
}

}  // namespace hosted_collector_test
}  // namespace etude::campaign
