// SPDX-License-Identifier: Apache-2.0
// Tests trainer/publish/sink.cc
#include "trainer/publish/sink.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <set>

#include "services/core/hash.h"
#include "services/core/link.h"
#include "tests/support/temporary_folder.h"
#include "tests/trainer/checkpoint/example_checkpoint.h"
#include "tests/trainer/policy/fixtures.h"

namespace etude::publish {
namespace sink_test {

using namespace std::chrono_literals;
constexpr std::uint32_t kDomain = 75;

std::set<std::string> Files(const Path& folder) {
  std::set<std::string> names;
  for (const auto& item : std::filesystem::directory_iterator(folder)) names.insert(item.path().filename());
  return names;
}

TEST(CheckpointSink, KeepsTheNewestAndTheBest) {
  const TemporaryFolder folder;
  const auto config = policy::TinyConfig();
  auto sink = CheckpointSink::Open(folder.path(), {"demo", "", 1}, nullptr, 2);
  ASSERT_TRUE(sink) << sink.error().message;
  for (std::uint64_t step = 1; step <= 6; ++step) {
    auto request = checkpoint::ExampleCheckpoint(config, step);
    request.metadata.best = step == 2;
    const auto kept = sink->Save(request);
    ASSERT_TRUE(kept) << kept.error().message;
    const Path file = folder / "checkpoints" / kept->file;
    EXPECT_EQ(kept->sha256, Sha256Hex(ReadBinaryFile(file).value()));
    EXPECT_EQ(kept->channels.size(), step == 2 ? 2u : 1u);
  }

  EXPECT_EQ(Files(folder / "checkpoints"),
            (std::set<std::string>{"00000002.safetensors", "00000005.safetensors", "00000006.safetensors",
                                   "latest.safetensors", "best.safetensors"}));
  EXPECT_EQ(Files(folder.path()), (std::set<std::string>{"checkpoints", "starts"}));
  EXPECT_EQ(checkpoint::ReadFile(folder / "checkpoints/latest.safetensors").value().metadata.step, 6u);
  EXPECT_EQ(checkpoint::ReadFile(folder / "checkpoints/best.safetensors").value().metadata.step, 2u);
  EXPECT_TRUE(sink->HasBest());
  std::filesystem::remove(folder / "checkpoints/00000002.safetensors");
  EXPECT_FALSE(sink->HasBest()) << "the link alone is none";
}

// a promotion by hand may name the file by its whole path: it was removed with the old ones
TEST(CheckpointSink, KeepsTheBestHoweverItIsNamed) {
  const TemporaryFolder folder;
  const auto config = policy::TinyConfig();
  auto sink = CheckpointSink::Open(folder.path(), {"demo", "", 1}, nullptr, 2);
  ASSERT_TRUE(sink) << sink.error().message;
  for (std::uint64_t step = 1; step <= 5; ++step) {
    ASSERT_TRUE(sink->Save(checkpoint::ExampleCheckpoint(config, step)));
    if (step == 1)
      std::filesystem::create_symlink(folder / "checkpoints/00000001.safetensors",
                                      folder / "checkpoints/best.safetensors");
  }
  EXPECT_TRUE(sink->HasBest());
}

TEST(CheckpointSink, LeavesFilesOfOtherNamesToTheirOwner) {
  const TemporaryFolder folder;
  const auto config = policy::TinyConfig();
  auto sink = CheckpointSink::Open(folder.path(), {"demo", "", 1}, nullptr, 2);
  ASSERT_TRUE(sink) << sink.error().message;
  ASSERT_TRUE(sink->Save(checkpoint::ExampleCheckpoint(config, 1)));
  for (const char* name : {"00000001-keep.safetensors", "good.safetensors"})
    std::filesystem::copy_file(folder / "checkpoints/00000001.safetensors", folder / "checkpoints" / name);
  for (std::uint64_t step = 2; step <= 5; ++step) ASSERT_TRUE(sink->Save(checkpoint::ExampleCheckpoint(config, step)));

  EXPECT_EQ(Files(folder / "checkpoints"),
            (std::set<std::string>{"00000001-keep.safetensors", "good.safetensors", "00000004.safetensors",
                                   "00000005.safetensors", "latest.safetensors"}));
  EXPECT_TRUE(sink->Has(5));
  EXPECT_FALSE(sink->Has(3));
}

TEST(CheckpointSink, PublishesToLateJoinersAlsoAfterARestart) {
  const TemporaryFolder folder;
  const auto config = policy::TinyConfig();
  auto participant = bus::Participant::Open({kDomain, ""});
  ASSERT_TRUE(participant) << participant.error().message;
  EXPECT_EQ(NextStart(folder.path()), 1u);
  auto first = CheckpointSink::Open(folder.path(), {"sink-demo", "aaaa", 1}, &*participant);
  ASSERT_TRUE(first) << first.error().message;
  ASSERT_TRUE(first->Save(checkpoint::ExampleCheckpoint(config, 500)));

  auto subscriber = bus::BlobSubscriber::Open(*participant, {"sink-demo", "aaaa"}, checkpoint::kLatest);
  ASSERT_TRUE(subscriber);
  const auto before = subscriber->Wait(20s);
  ASSERT_TRUE(before);
  EXPECT_EQ(checkpoint::Decode(before->bytes).value().metadata.step, 500u);
  EXPECT_EQ(OrderedJson::parse(before->meta_json)["step"], 500);

  // the trainer restarts: what is on disk is published again, then a step that is older than the
  // last one
  first = Fail(Code::kInternal, "gone");
  EXPECT_EQ(NextStart(folder.path()), 2u);
  auto second = CheckpointSink::Open(folder.path(), {"sink-demo", "aaaa", 2}, &*participant);
  ASSERT_TRUE(second) << second.error().message;
  ASSERT_TRUE(second->Save(checkpoint::ExampleCheckpoint(config, 400)));
  std::uint64_t step = 0;
  for (int i = 0; i < 4 && step != 400; ++i) {
    const auto after = subscriber->Wait(20s);
    ASSERT_TRUE(after);
    step = checkpoint::Decode(after->bytes).value().metadata.step;
  }
  EXPECT_EQ(step, 400u);
}

// before, what a killed trainer had half written stayed for ever
TEST(CheckpointSink, PublishesWhatSomebodyPromoted) {
  const TemporaryFolder folder;
  const auto config = policy::TinyConfig();
  auto participant = bus::Participant::Open({kDomain, ""});
  ASSERT_TRUE(participant) << participant.error().message;
  auto sink = CheckpointSink::Open(folder.path(), {"sink-promoted", "aaaa", 1}, &*participant);
  ASSERT_TRUE(sink) << sink.error().message;
  auto subscriber = bus::BlobSubscriber::Open(*participant, {"sink-promoted", "aaaa"}, checkpoint::kBest);
  ASSERT_TRUE(subscriber);
  ASSERT_TRUE(sink->Save(checkpoint::ExampleCheckpoint(config, 100)));
  ASSERT_TRUE(PointLink(folder / "checkpoints/best.safetensors", "00000100.safetensors"));
  ASSERT_TRUE(sink->Save(checkpoint::ExampleCheckpoint(config, 200)));

  const auto published = subscriber->Wait(20s);
  ASSERT_TRUE(published);
  EXPECT_EQ(checkpoint::Decode(published->bytes).value().metadata.step, 100u);
}

TEST(CheckpointSink, RemovesWhatAKilledRunLeftHalfWritten) {
  const TemporaryFolder folder;
  for (const char* name : {"checkpoints/00000100.safetensors.tmp-4711-00aa11ff",
                           "training_state.safetensors.tmp-4711-00aa11ff", "config.yaml.tmp-12-00000000",
                           "checkpoints/00000050.safetensors", "backup.tmp-2024.tar", "policy.pt.tmp-4711-00aa11ff"})
    ASSERT_TRUE(WriteFileAtomically(folder / name, "half"));

  const auto sink = CheckpointSink::Open(folder.path(), {"demo", "", 1}, nullptr);

  ASSERT_TRUE(sink) << sink.error().message;
  EXPECT_EQ(Files(folder / "checkpoints"), (std::set<std::string>{"00000050.safetensors"}));
  EXPECT_EQ(Files(folder.path()),
            (std::set<std::string>{"checkpoints", "starts", "backup.tmp-2024.tar", "policy.pt.tmp-4711-00aa11ff"}))
      << "what others wrote, or are writing, is theirs";
}

// versions grow over the starts of a run, also where somebody frees the disk between two of them
TEST(NextStart, GrowsThoughTheCheckpointsAreTakenAway) {
  const TemporaryFolder folder;
  ASSERT_TRUE(WriteFileAtomically(folder / "checkpoints/starts", "4"));  // where earlier versions counted
  ASSERT_EQ(NextStart(folder.path()), 5u);
  ASSERT_TRUE(CheckpointSink::Open(folder.path(), {"demo", "", 5}, nullptr));
  std::filesystem::remove_all(folder / "checkpoints");
  EXPECT_EQ(NextStart(folder.path()), 6u);
}

TEST(SetCheckpointsAside, LeavesANewRunNoneOfAnotherOnes) {
  const TemporaryFolder folder;
  EXPECT_TRUE(SetCheckpointsAside(folder.path()));
  for (const char* text : {"first", "second"}) {
    ASSERT_TRUE(WriteFileAtomically(folder / "checkpoints/00000100.safetensors", text));
    ASSERT_TRUE(SetCheckpointsAside(folder.path()));
  }
  EXPECT_EQ(Files(folder.path()), (std::set<std::string>{"checkpoints.before-1", "checkpoints.before-2"}));
  EXPECT_EQ(ReadTextFile(folder / "checkpoints.before-2/00000100.safetensors").value(), "second");
}

TEST(SetCheckpointsAside, NotWhatTheRunBeginsWith) {
  const TemporaryFolder folder;
  const Path own = folder / "checkpoints/00000100.safetensors", elsewhere = folder / "other/00000100.safetensors";
  for (const Path& path : {own, elsewhere}) ASSERT_TRUE(WriteFileAtomically(path, "first"));
  const Status refused = SetCheckpointsAside(folder.path(), own);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, Code::kInvalidArgument);
  EXPECT_TRUE(std::filesystem::exists(own));
  EXPECT_TRUE(SetCheckpointsAside(folder.path(), elsewhere));
  EXPECT_FALSE(std::filesystem::exists(own));
}

}  // namespace sink_test
}  // namespace etude::publish
