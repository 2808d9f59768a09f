// SPDX-License-Identifier: Apache-2.0
// Tests services/relay/kept_checkpoints.cc
#include "services/relay/kept_checkpoints.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <set>

#include "tests/services/relay/example_run.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::relay {
namespace kept_checkpoints_test {

constexpr char kId[] = "aaaa000000000001";
const bus::Owner kRun{"kept", kId};

std::set<std::string> Files(const Path& folder) {
  std::set<std::string> names;
  for (const auto& item : std::filesystem::directory_iterator(folder)) names.insert(item.path().filename());
  return names;
}

KeptCheckpoints OpenOrDie(const Path& folder, const bus::Owner& run = kRun) {
  auto opened = KeptCheckpoints::Open(folder, run);
  EXPECT_THAT(opened, IsOk());
  return std::move(*opened);
}

TEST(KeptCheckpoints, OneFileAChannelAndTheyAreThereAfterARestart) {
  const TemporaryFolder folder;
  const auto newest = ExampleBlob(kId, "latest", 12, 3), best = ExampleBlob(kId, "best", 11, 2);
  {
    auto kept = OpenOrDie(folder.path());
    ASSERT_THAT(kept.Keep(ExampleBlob(kId, "latest", 10, 1)), IsOk());
    ASSERT_THAT(kept.Keep(best), IsOk());
    ASSERT_THAT(kept.Keep(newest), IsOk());
  }
  EXPECT_EQ(Files(folder.path()), (std::set<std::string>{"kept.json", "kept.lock", "relayed-best-11.safetensors",
                                                         "relayed-latest-12.safetensors"}));
  auto kept = OpenOrDie(folder.path());
  ASSERT_EQ(kept.channels().size(), 2u);
  EXPECT_EQ(kept.channels().at("latest").version, 12u);
  EXPECT_EQ(kept.channels().at("latest").meta_json, newest.meta_json);
  EXPECT_EQ(kept.channels().at("best").sha256, best.sha256);
  EXPECT_EQ(kept.Read("latest").value(), newest.bytes);
  EXPECT_EQ(kept.Read("best").value(), best.bytes);
  EXPECT_THAT(kept.Read("other"), HasCode(Code::kNotFound));
}

TEST(KeptCheckpoints, VersionsNeverGoBackAlsoAfterARestart) {
  const TemporaryFolder folder;
  for (int start = 0; start < 2; ++start) {
    auto kept = OpenOrDie(folder.path());
    ASSERT_THAT(kept.Keep(ExampleBlob(kId, "latest", 5, 5)), IsOk()) << "the same one again is no error";
    EXPECT_THAT(kept.Keep(ExampleBlob(kId, "latest", 4, 4)), HasCode(Code::kInvalidArgument));
    EXPECT_THAT(kept.Keep(ExampleBlob(kId, "latest", 5, 6)), MessageHas("version 5 is not newer than 5"));
    EXPECT_EQ(kept.Read("latest").value(), ExampleCheckpoint(5));
  }
}

TEST(KeptCheckpoints, WhatIsNotOfTheRunIsNotKept) {
  const TemporaryFolder folder;
  auto kept = OpenOrDie(folder.path());
  EXPECT_THAT(kept.Keep(ExampleBlob("bbbb000000000002", "latest", 1, 1)), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(kept.Keep(ExampleBlob(kId, "../latest", 1, 1)), HasCode(Code::kInvalidArgument));
  auto talkative = ExampleBlob(kId, "latest", 1, 1);
  talkative.meta_json.assign(2u << 20, 'x');
  EXPECT_THAT(kept.Keep(talkative), MessageHas("its metadata has 2097152 bytes"));
  for (std::size_t i = 0; i < KeptCheckpoints::kMostChannels; ++i)
    ASSERT_THAT(kept.Keep(ExampleBlob(kId, "channel" + std::to_string(i), 1, 1)), IsOk());
  EXPECT_THAT(kept.Keep(ExampleBlob(kId, "latest", 1, 1)), HasCode(Code::kInvalidArgument));
  EXPECT_EQ(Files(folder.path()).size(), KeptCheckpoints::kMostChannels + 2);
}

TEST(KeptCheckpoints, WhatIsForgottenIsSetAsideAndCountsNoMore) {
  const TemporaryFolder folder;
  const auto best = ExampleBlob(kId, "best", 11, 2), latest = ExampleBlob(kId, "latest", 12, 3);
  {
    auto kept = OpenOrDie(folder.path());
    ASSERT_THAT(kept.Keep(latest), IsOk());
    ASSERT_THAT(kept.Keep(best), IsOk());
    ASSERT_THAT(kept.Forget("latest"), IsOk());
    EXPECT_THAT(kept.Forget("other"), IsOk());
  }
  const Path refused = folder.path() / "refused-relayed-latest-12.safetensors";
  EXPECT_EQ(Files(folder.path()),
            (std::set<std::string>{"kept.json", "kept.lock", "relayed-best-11.safetensors", refused.filename()}));
  EXPECT_EQ(ReadBinaryFile(refused).value(), latest.bytes) << "the key may have been the wrong one";
  auto kept = OpenOrDie(folder.path());
  EXPECT_FALSE(kept.channels().contains("latest"));
  EXPECT_EQ(kept.Read("best").value(), best.bytes);
  EXPECT_THAT(kept.Keep(ExampleBlob(kId, "latest", 5, 1)), IsOk());
}

TEST(KeptCheckpoints, AFolderIsOneRelays) {
  const TemporaryFolder folder;
  const auto kept = OpenOrDie(folder.path());
  const auto second = KeptCheckpoints::Open(folder.path(), kRun);
  EXPECT_THAT(second, HasCode(Code::kUnavailable));
  EXPECT_THAT(second, MessageHas("is used by another process"));
}

// Killed after the new file and before the record, or while it wrote either.
TEST(KeptCheckpoints, WithoutItsRecordAFileCountsForNothing) {
  const TemporaryFolder folder;
  const auto newest = ExampleBlob(kId, "latest", 7, 7);
  ASSERT_THAT(OpenOrDie(folder.path()).Keep(newest), IsOk());
  for (const char* name : {"relayed-latest-8.safetensors", "relayed-latest-9.safetensors.tmp-12-ab",
                           "kept.json.tmp-12-ab", "mine.safetensors"})
    ASSERT_THAT(WriteFileAtomically(folder / name, std::string_view("half")), IsOk());
  auto kept = OpenOrDie(folder.path());
  EXPECT_EQ(kept.Read("latest").value(), newest.bytes);
  EXPECT_EQ(Files(folder.path()),
            (std::set<std::string>{"kept.json", "kept.lock", "mine.safetensors", "relayed-latest-7.safetensors"}));
}

TEST(KeptCheckpoints, ADamagedFileIsNotReadAndItsVersionStands) {
  const TemporaryFolder folder;
  const auto newest = ExampleBlob(kId, "latest", 7, 7);
  ASSERT_THAT(OpenOrDie(folder.path()).Keep(newest), IsOk());
  auto damaged = newest.bytes;
  damaged[damaged.size() / 2] ^= 1;
  ASSERT_THAT(WriteFileAtomically(folder / "relayed-latest-7.safetensors", damaged), IsOk());

  auto kept = OpenOrDie(folder.path());
  EXPECT_FALSE(kept.channels().at("latest").whole);
  EXPECT_THAT(kept.Read("latest"), HasCode(Code::kCorrupt));
  EXPECT_THAT(kept.Keep(ExampleBlob(kId, "latest", 6, 6)), HasCode(Code::kInvalidArgument));
  ASSERT_THAT(kept.Keep(newest), IsOk()) << "the same one again mends it";
  EXPECT_TRUE(kept.channels().at("latest").whole);
  EXPECT_EQ(kept.Read("latest").value(), newest.bytes);
}

TEST(KeptCheckpoints, DamageThatComesLaterIsFoundWhenItIsRead) {
  const TemporaryFolder folder;
  auto kept = OpenOrDie(folder.path());
  ASSERT_THAT(kept.Keep(ExampleBlob(kId, "latest", 7, 7)), IsOk());
  ASSERT_TRUE(std::filesystem::remove(folder / "relayed-latest-7.safetensors"));
  EXPECT_THAT(kept.Read("latest"), HasCode(Code::kNotFound));
  EXPECT_FALSE(kept.channels().at("latest").whole);
}

TEST(KeptCheckpoints, AnotherRunTakesThePlaceWithItsFirstCheckpoint) {
  const TemporaryFolder folder;
  const bus::Owner anew{"kept", "bbbb000000000002"};
  EXPECT_FALSE(KeptRun(folder.path()).value());
  ASSERT_THAT(OpenOrDie(folder.path()).Keep(ExampleBlob(kId, "latest", 900, 9)), IsOk());
  EXPECT_EQ(KeptRun(folder.path()).value()->id, kId);
  auto kept = OpenOrDie(folder.path(), anew);
  EXPECT_TRUE(kept.channels().empty());
  EXPECT_EQ(KeptRun(folder.path()).value()->id, kId) << "it has nothing yet";
  ASSERT_THAT(kept.Keep(ExampleBlob(anew.id, "latest", 1, 1)), IsOk()) << "versions are a run's own";
  EXPECT_EQ(KeptRun(folder.path()).value()->id, anew.id);
  EXPECT_EQ(Files(folder.path()), (std::set<std::string>{"kept.json", "kept.lock", "relayed-latest-1.safetensors"}));
}

TEST(KeptCheckpoints, ARecordThatIsNotUnderstoodIsAnErrorWithWords) {
  const TemporaryFolder folder;
  for (const char* text : {"", "[]", "{}", R"({"run": "kept", "run_id": "x", "channels": {}})",
                           R"({"run": "../kept", "run_id": "aaaa000000000001", "channels": {}})",
                           R"({"run": "kept", "run_id": "aaaa000000000001", "channels": {"latest": {"version": -1}}})",
                           R"({"run": "kept", "run_id": "aaaa000000000001", "channels":
            {"../up": {"version": 1, "sha256": "", "meta_json": ""}}})"}) {
    ASSERT_THAT(WriteFileAtomically(folder / "kept.json", std::string_view(text)), IsOk());
    EXPECT_THAT(KeptCheckpoints::Open(folder.path(), kRun), HasCode(Code::kCorrupt)) << text;
    EXPECT_THAT(KeptRun(folder.path()), MessageHas("does not say what a relay keeps")) << text;
  }
}

}  // namespace kept_checkpoints_test
}  // namespace etude::relay
