// SPDX-License-Identifier: Apache-2.0
// Tests trainer/publish/sink.cc
#include "trainer/publish/sink.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <set>

#include "tests/trainer/publish/example_checkpoint.h"

namespace etude::publish {
namespace {

using namespace std::chrono_literals;
constexpr std::uint32_t kDomain = 75;

std::set<std::string> Files(const Path& folder) {
  std::set<std::string> names;
  for (const auto& item : std::filesystem::directory_iterator(folder)) names.insert(item.path().filename());
  return names;
}

TEST(CheckpointSink, KeepsTheNewestAndTheBest) {
  const TemporaryFolder folder;
  const auto config = learn::TinyConfig({"checkpoint.keep=2"});
  auto sink = CheckpointSink::Open(folder.path(), "demo", nullptr);
  ASSERT_TRUE(sink) << sink.error().message;
  for (std::uint64_t step = 1; step <= 6; ++step) {
    auto request = ExampleRequest(config, step);
    request.best = step == 2;
    ASSERT_TRUE(sink->Save(request));
  }

  EXPECT_EQ(Files(folder / "checkpoints"),
            (std::set<std::string>{"00000002.safetensors", "00000005.safetensors", "00000006.safetensors",
                                   "latest.safetensors", "best.safetensors", "starts"}));
  EXPECT_EQ(ReadCheckpoint(folder / "checkpoints/latest.safetensors").value().info.step, 6u);
  EXPECT_EQ(ReadCheckpoint(folder / "checkpoints/best.safetensors").value().info.step, 2u);
}

TEST(CheckpointSink, PublishesToLateJoinersAlsoAfterARestart) {
  const TemporaryFolder folder;
  const auto config = learn::TinyConfig();
  auto participant = bus::Participant::Open({kDomain, ""});
  ASSERT_TRUE(participant) << participant.error().message;
  auto first = CheckpointSink::Open(folder.path(), "sink-demo", &*participant);
  ASSERT_TRUE(first) << first.error().message;
  ASSERT_TRUE(first->Save(ExampleRequest(config, 500)));

  auto subscriber = bus::ObjectSubscriber::Open(*participant, "sink-demo", kLatest);
  ASSERT_TRUE(subscriber);
  const auto before = subscriber->Wait(20s);
  ASSERT_TRUE(before);
  EXPECT_EQ(DecodeCheckpoint(before->bytes).value().info.step, 500u);
  EXPECT_EQ(OrderedJson::parse(before->meta_json)["step"], 500);

  // the trainer restarts: what is on disk is published again, then a step that is older than the
  // last one
  first = Fail(Code::kInternal, "gone");
  auto second = CheckpointSink::Open(folder.path(), "sink-demo", &*participant);
  ASSERT_TRUE(second) << second.error().message;
  ASSERT_TRUE(second->Save(ExampleRequest(config, 400)));
  std::uint64_t step = 0;
  for (int i = 0; i < 4 && step != 400; ++i) {
    const auto after = subscriber->Wait(20s);
    ASSERT_TRUE(after);
    step = DecodeCheckpoint(after->bytes).value().info.step;
  }
  EXPECT_EQ(step, 400u);
}

TEST(RunNameOf, MakesAPlainName) {
  EXPECT_EQ(RunNameOf("out/My Run"), "my-run");
  EXPECT_EQ(RunNameOf("out/run_3/"), "run_3");
  EXPECT_TRUE(IsPlainName(RunNameOf(".")));
  EXPECT_TRUE(IsPlainName(RunNameOf("x/" + std::string(100, 'a'))));
}

}  // namespace
}  // namespace etude::publish
