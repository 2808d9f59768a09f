// SPDX-License-Identifier: Apache-2.0
// Tests services/campaign/history.cc
#include "services/campaign/history.h"

#include <gtest/gtest.h>

#include "services/campaign/lease_table.h"
#include "tests/services/campaign/says_stopped.h"
#include "tests/support/temporary_folder.h"

namespace etude::campaign {
namespace history_test {

TEST(Epoch, GrowsWithEveryStart) {
  TemporaryFolder folder;
  EXPECT_EQ(LastEpoch(folder.path()).value(), 0u);
  ASSERT_TRUE(RememberEpoch(folder.path(), 1));
  EXPECT_EQ(LastEpoch(folder.path()).value(), 1u);
  ASSERT_TRUE(RememberEpoch(folder.path(), 7)) << "one that adopts leaves the other behind";
  EXPECT_EQ(LastEpoch(folder.path()).value(), 7u);
  EXPECT_FALSE(RememberEpoch(folder.path(), 7));
  EXPECT_FALSE(RememberEpoch(folder.path(), kEpochs)) << "it would not fit into a token";
}

TEST(Epoch, RefusesAFileThatItDoesNotUnderstand) {
  TemporaryFolder folder;
  for (const char* text : {"", "{", "[]", "{\"epoch\": -1}", "{\"epoch\": \"2\"}"}) {
    ASSERT_TRUE(WriteFileAtomically(folder / "collector.json", std::string_view(text)));
    const auto epoch = LastEpoch(folder.path());
    ASSERT_FALSE(epoch) << text;
    EXPECT_EQ(epoch.error().code, Code::kCorrupt) << text;
    EXPECT_FALSE(RememberEpoch(folder.path(), 1));
    EXPECT_EQ(ReadTextFile(folder / "collector.json").value(), text) << "left as it was";
  }
}

TEST(KnownFiles, StayOverStarts) {
  TemporaryFolder folder;
  EXPECT_FALSE(KnownFiles(folder.path()));
  EXPECT_FALSE(RememberFiles(folder.path(), "abc")) << "only a collector's folder has some";
  ASSERT_TRUE(RememberEpoch(folder.path(), 1));
  EXPECT_FALSE(KnownFiles(folder.path()));
  ASSERT_TRUE(RememberFiles(folder.path(), "abc"));
  ASSERT_TRUE(RememberEpoch(folder.path(), 2));
  EXPECT_EQ(KnownFiles(folder.path()), "abc");
}

TEST(KnownShard, StaysOverStarts) {
  TemporaryFolder folder;
  EXPECT_FALSE(KnownShard(folder.path()));
  ASSERT_TRUE(RememberEpoch(folder.path(), 1));
  EXPECT_FALSE(KnownShard(folder.path()));
  ASSERT_TRUE(RememberShard(folder.path(), "1/2"));
  ASSERT_TRUE(RememberEpoch(folder.path(), 2));
  EXPECT_EQ(KnownShard(folder.path()), "1/2");
}

TEST(RememberStop, IsForgottenWithTheNextStart) {
  TemporaryFolder folder;
  EXPECT_FALSE(SaysStopped(folder.path()));
  ASSERT_TRUE(RememberEpoch(folder.path(), 1));
  EXPECT_FALSE(SaysStopped(folder.path()));
  ASSERT_TRUE(RememberStop(folder.path()));
  EXPECT_TRUE(SaysStopped(folder.path()));
  ASSERT_TRUE(RememberEpoch(folder.path(), 2));
  EXPECT_FALSE(SaysStopped(folder.path()));
}

TEST(CheckHostsAgree, NamesTheLineInWhichShardsDiffer) {
  TemporaryFolder folder;
  const auto shard = [&](const char* name, const char* picture, const char* physics) {
    EXPECT_TRUE(RememberEpoch(folder / name, 1));
    EXPECT_TRUE(RememberFingerprint(folder / name, {{"picture", picture}, {"physics", physics}}));
    return folder / name;
  };
  const Path a = shard("a", "p1", "x"), same = shard("same", "p1", "x"), drawn = shard("drawn", "p2", "x"),
             other = shard("other", "p1", "y");
  EXPECT_TRUE(CheckHostsAgree({a, folder / "none", same}, "bytes"));
  const auto refused = CheckHostsAgree({folder / "none", a, drawn}, "bytes");
  ASSERT_FALSE(refused);
  for (const std::string& text : {a.string(), drawn.string(), std::string("picture: here p1, there p2")})
    EXPECT_NE(refused.error().message.find(text), std::string::npos) << refused.error().message;
  EXPECT_TRUE(CheckHostsAgree({a, drawn}, "physics"));
  EXPECT_FALSE(CheckHostsAgree({a, other}, "physics"));
  EXPECT_TRUE(CheckHostsAgree({a, other}, "none"));
  ASSERT_TRUE(RememberFiles(a, "aa"));
  ASSERT_TRUE(RememberFiles(same, "bb"));
  EXPECT_FALSE(CheckHostsAgree({a, same}, "none")) << "other robots or objects";
}

TEST(CarryHosts, AMadeDatasetKnowsWhoMadeIt) {
  TemporaryFolder folder;
  for (const char* name : {"a", "b", "none"}) ASSERT_TRUE(RememberEpoch(folder / name, 3));
  ASSERT_TRUE(RememberFingerprint(folder / "b", {{"picture", "p1"}}));
  ASSERT_TRUE(RememberFiles(folder / "b", "ff"));
  ASSERT_TRUE(CarryHosts({folder / "a", folder / "b"}, folder / "none"));
  EXPECT_EQ(KnownFiles(folder / "none"), "ff");
  EXPECT_EQ(FingerprintText(*KnownFingerprint(folder / "none")), FingerprintText({{"picture", "p1"}}));
  EXPECT_EQ(LastEpoch(folder / "none").value(), 0u) << "nobody has collected there";
}

TEST(ReadHistory, CountsEachFailedAttemptOnce) {
  TemporaryFolder folder;
  const std::string_view lines = R"({"index": 3, "attempt": 0, "seed": 9, "outcome": "plan_failed"}
{"index": 3, "attempt": 1, "seed": 9, "outcome": "dropped"}
{"index": 3, "attempt": 1, "seed": 9, "outcome": "dropped"}
{"index": 5, "attempt": 0, "outcome": "policy_error"}
{"index": 5, "attempt": 0, "outcome": "policy_error"}
not json
{"index": -1, "attempt": 0, "outcome": "x"}
{"index": 7, "attempt": 0}
{"index": 8, "att)";
  ASSERT_TRUE(WriteFileAtomically(folder / "attempts.jsonl", lines));

  const History history = ReadHistory(folder.path(), {});

  ASSERT_EQ(history.indices.size(), 1u);
  EXPECT_EQ(history.indices.at(3).failures, 2u);
  EXPECT_EQ(history.indices.at(3).next_attempt, 2u);
  EXPECT_EQ(history.failures.at("policy_error"), 2u) << "a policy that does not answer is no failure of the rollout";
  EXPECT_EQ(history.total, 2u);
  EXPECT_EQ(history.failures.at("dropped"), 1u);
}

TEST(ReadHistory, DoesNotCountWhatAnOlderProgramForgot) {
  TemporaryFolder folder;
  ASSERT_TRUE(
      WriteFileAtomically(folder / "collector.json", std::string_view(R"({"epoch": 1, "forgotten_attempts": "2"})")));
  std::string lines = R"({"index": 3, "attempt": 0, "outcome": "plan_failed"})"
                      "\nnot json\n"
                      R"({"index": 3, "attempt": 1, "outcome": "plan_failed"})"
                      "\n";
  ASSERT_TRUE(WriteFileAtomically(folder / "attempts.jsonl", lines));
  EXPECT_TRUE(ReadHistory(folder.path(), {}).indices.empty());
  EXPECT_EQ(ReadHistory(folder.path(), {}).total, 0u);

  lines += R"({"index": 3, "attempt": 0, "outcome": "plan_failed"})"
           "\n";
  ASSERT_TRUE(WriteFileAtomically(folder / "attempts.jsonl", lines));
  EXPECT_EQ(ReadHistory(folder.path(), {}).indices.at(3).next_attempt, 1u) << "the same attempt, made again";

  ASSERT_TRUE(DropForgottenCount(folder.path()));
  EXPECT_EQ(ReadHistory(folder.path(), {}).indices.at(3).failures, 2u) << "of a file that began anew all count";
  EXPECT_EQ(LastEpoch(folder.path()).value(), 1u);
  EXPECT_TRUE(DropForgottenCount(folder / "none")) << "nothing to drop";
}

TEST(ReadHistory, ARolloutWithoutASceneOrThatEndsWorkersIsNeverTriedAgain) {
  TemporaryFolder folder;
  ASSERT_TRUE(WriteFileAtomically(folder / "attempts.jsonl", R"({"index": 3, "attempt": 0, "outcome": "scene_invalid"})"
                                                             "\n"
                                                             R"({"index": 4, "attempt": 0, "outcome": "kills_workers"})"
                                                             "\n"));
  for (const std::uint64_t index : {3, 4}) {
    CampaignSpec spec;
    EXPECT_EQ(ReadHistory(folder.path(), spec).indices.at(index).failures, 1u)
        << "a demonstration's next scene is another";
    spec.mode = "rollout";
    EXPECT_EQ(ReadHistory(folder.path(), spec).indices.at(index).failures,
              static_cast<std::uint32_t>(spec.max_attempts));
  }
}

TEST(ReadHistory, IsEmptyWithoutAFile) {
  TemporaryFolder folder;
  EXPECT_TRUE(ReadHistory(folder.path(), {}).indices.empty());
}

}  // namespace history_test
}  // namespace etude::campaign
