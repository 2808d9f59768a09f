// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/training_words.cc: the words of a served checkpoint, where its file is at hand.
#include "services/cli/training_words.h"

#include <gtest/gtest.h>

#include "services/bus/directory.h"
#include "services/store/safetensors.h"
#include "tests/support/temporary_folder.h"

namespace etude::cli {
namespace training_words_test {

using Words = std::set<std::string>;

constexpr char kId[] = "eeee000000000001";

class TrainingWordsTest : public testing::Test {
 protected:
  std::string Write(const std::string& name, const std::map<std::string, std::string>& metadata) {
    store::Safetensors content;
    content.metadata = metadata;
    content.tensors["w"] = {store::DType::kF32, {2}, std::vector<std::uint8_t>(8)};
    EXPECT_TRUE(MakeFolders((folder_ / name).parent_path()));
    EXPECT_TRUE(store::WriteSafetensors(folder_ / name, content));
    return (folder_ / name).string();
  }
  bus::Announcement Announce(bus::PresenceKind kind, const std::string& folder, const std::string& host = "") {
    bus::Presence presence = bus::MakePresence(kind, "words", kId, folder);
    if (!host.empty()) presence.host = host;
    return bus::Announcement::Open(participant_, presence, Claim::kAdopt).value();
  }

  TemporaryFolder folder_;
  bus::Participant participant_ = bus::Participant::Open({84, ""}).value();
};

TEST_F(TrainingWordsTest, AreThoseThatTheCheckpointSays) {
  EXPECT_EQ(TrainingWordsOf(Write("a.safetensors", {{"words", "can push the"}})), (Words{"can", "push", "the"}));
  EXPECT_EQ(TrainingWordsOf(Write("b.safetensors", {{"run", "old"}})), std::nullopt);
  EXPECT_EQ(TrainingWordsOf((folder_ / "none.safetensors").string()), std::nullopt);
}

TEST_F(TrainingWordsTest, AreThoseOfTheFileThatIsServed) {
  EXPECT_EQ(TrainingWords(participant_, "words"), std::nullopt) << "nobody serves it";
  const auto server = Announce(bus::PresenceKind::kPolicy, Write("served.safetensors", {{"words", "lift milk"}}));
  EXPECT_EQ(TrainingWords(participant_, std::string("words@") + kId), (Words{"lift", "milk"}));
}

TEST_F(TrainingWordsTest, OfAServerThatFollowsARunAreThoseOfTheRun) {
  Write("run/checkpoints/latest.safetensors", {{"words", "pick cube"}});
  const auto server = Announce(bus::PresenceKind::kPolicy, "");
  const auto trainer = Announce(bus::PresenceKind::kRun, (folder_ / "run").string());
  EXPECT_EQ(TrainingWords(participant_, "words"), (Words{"pick", "cube"}));
}

TEST_F(TrainingWordsTest, OfARunThatNobodyServesAreThoseOfItsCheckpoints) {
  Write("run/checkpoints/latest.safetensors", {{"words", "pick cube"}});
  const auto trainer = Announce(bus::PresenceKind::kRun, (folder_ / "run").string());
  EXPECT_EQ(TrainingWords(participant_, "words"), (Words{"pick", "cube"}));
}

TEST_F(TrainingWordsTest, AreNotReadFromAFileThatAnotherMachineNamed) {
  const auto server =
      Announce(bus::PresenceKind::kPolicy, Write("served.safetensors", {{"words", "lift milk"}}), "another");
  EXPECT_EQ(TrainingWords(participant_, "words"), std::nullopt);
}

}  // namespace training_words_test
}  // namespace etude::cli
