// SPDX-License-Identifier: Apache-2.0
#include "services/bus/inbox.h"

#include <gtest/gtest.h>

#include "tests/services/bus/two_processes.h"

namespace etude::bus {
namespace inbox_test {

using namespace std::chrono_literals;

constexpr Inbox::TimePoint kStart{};

// What `blobs` of so many bytes in all count.
constexpr std::uint64_t Memory(std::uint64_t blobs, std::uint64_t bytes) { return blobs * kBlobRecord + bytes; }

BlobManifest Announce(const std::string& sender, std::uint64_t id, std::uint64_t size) {
  BlobManifest manifest;
  manifest.sender = sender;
  manifest.id = id;
  manifest.size = size;
  manifest.chunk_size = 100;
  manifest.chunk_count = ChunkCount(size, 100);
  return manifest;
}

TEST(Inbox, HandsOnWhatWasFinishedFirst) {
  Inbox inbox;
  IncomingBlob* const left = inbox.Add(Announce("left", 1, 10), kStart);
  IncomingBlob* const right = inbox.Add(Announce("right", 1, 20), kStart);
  ASSERT_TRUE(left && right);
  EXPECT_FALSE(inbox.has_finished());
  inbox.Finish(*right, MakeBytes(20, 1));
  inbox.Finish(*left, MakeBytes(10, 2));
  EXPECT_EQ(inbox.memory(), Memory(2, 30));

  const auto first = inbox.Pop(), second = inbox.Pop();

  EXPECT_EQ(first.manifest.sender, "right");
  EXPECT_EQ(first.bytes, MakeBytes(20, 1));
  EXPECT_EQ(second.manifest.sender, "left");
  EXPECT_EQ(second.bytes, MakeBytes(10, 2));
  EXPECT_FALSE(inbox.has_finished());
  EXPECT_EQ(inbox.Find("left", 1)->state, IncomingBlob::State::kJudging);
  EXPECT_EQ(inbox.memory(), Memory(2, 30)) << "who popped them holds them";
  inbox.Judge(first.manifest, {});
  EXPECT_EQ(inbox.memory(), Memory(1, 10));
  inbox.Judge(first.manifest, {});
  inbox.Judge(second.manifest, {});
  EXPECT_EQ(inbox.memory(), 0u);
}

TEST(Inbox, WhatIsSaidOfABlobCountsAsMemoryUntilItIsJudged) {
  ReceiveOptions options;
  options.max_memory = Memory(1, 100);
  Inbox inbox(options);
  BlobManifest talkative = Announce("s", 1, 10);
  talkative.meta_json = std::string(80, ' ');
  ASSERT_TRUE(inbox.Add(talkative, kStart));
  EXPECT_EQ(inbox.memory(), Memory(1, 90));
  talkative.id = 2;
  EXPECT_FALSE(inbox.Add(talkative, kStart));
  inbox.Finish(*inbox.Find("s", 1), MakeBytes(10, 1));
  const auto popped = inbox.Pop();
  EXPECT_EQ(popped.manifest.meta_json.size(), 80u);
  inbox.Judge(popped.manifest, {});
  EXPECT_EQ(inbox.memory(), 0u);
  EXPECT_EQ(inbox.Find("s", 1)->manifest.meta_json, "") << "the verdict is kept, not this";
  EXPECT_TRUE(inbox.Add(talkative, kStart));
}

TEST(Inbox, TakesOneBlobOfAnySizeAndOthersWhileThereIsRoom) {
  ReceiveOptions options;
  options.max_memory = Memory(2, 100);
  Inbox inbox(options);
  IncomingBlob* const large = inbox.Add(Announce("s", 1, 100000), kStart);
  ASSERT_TRUE(large);
  EXPECT_FALSE(inbox.Add(Announce("s", 2, 1), kStart));
  inbox.Remove(*large);
  EXPECT_FALSE(inbox.Find("s", 1));
  EXPECT_TRUE(inbox.Add(Announce("s", 2, 60), kStart));
  EXPECT_TRUE(inbox.Add(Announce("s", 3, 40), kStart));
  EXPECT_FALSE(inbox.Add(Announce("s", 4, 1), kStart));
}

TEST(Inbox, ManifestsWithoutBytesAreBoundedToo) {
  ReceiveOptions options;
  options.max_memory = 1 << 20;
  Inbox inbox(options);
  std::uint64_t taken = 0;
  for (std::uint64_t id = 0; id < 100'000; ++id) taken += inbox.Add(Announce("s", id, 1), kStart) != nullptr;
  EXPECT_GT(taken, 500u);
  EXPECT_LE(taken, 1024u);
}

TEST(Inbox, KeepsTheLastVerdictsOfEachSender) {
  ReceiveOptions options;
  options.verdicts_kept = 2;
  Inbox inbox(options);
  for (const std::uint64_t id : {1, 2, 2, 3}) inbox.Judge(Announce("s", id, 10), {AckKind::kRefused, "why"});
  inbox.Judge(Announce("other", 1, 10), {});
  EXPECT_FALSE(inbox.Find("s", 1));
  ASSERT_TRUE(inbox.Find("s", 2) && inbox.Find("s", 3) && inbox.Find("other", 1));
  EXPECT_EQ(inbox.Find("s", 3)->verdict.reason, "why");
  EXPECT_EQ(inbox.memory(), 0u);
}

TEST(Inbox, AVerdictDoesNotEndWhatIsUnderWay) {
  Inbox inbox;
  IncomingBlob* const blob = inbox.Add(Announce("s", 1, 10), kStart);
  inbox.Judge(blob->manifest, {});
  EXPECT_EQ(inbox.Find("s", 1)->state, IncomingBlob::State::kReceiving);
  inbox.Finish(*blob, MakeBytes(10, 1));
  inbox.Judge(blob->manifest, {});
  EXPECT_EQ(inbox.Pop().bytes, MakeBytes(10, 1));
}

TEST(Inbox, ForgetsWhatNobodySendsAnyMore) {
  Inbox inbox;
  IncomingBlob* const whole = inbox.Add(Announce("s", 1, 10), kStart);
  IncomingBlob* const heard = inbox.Add(Announce("s", 2, 20), kStart);
  inbox.Add(Announce("s", 3, 40), kStart);
  inbox.Finish(*whole, MakeBytes(10, 1));
  heard->last_news = kStart + 50s;
  inbox.Clean(kStart + 59s);
  EXPECT_EQ(inbox.memory(), Memory(3, 70));
  inbox.Clean(kStart + 60s);
  EXPECT_EQ(inbox.memory(), Memory(2, 30));
  EXPECT_FALSE(inbox.Find("s", 3));
  EXPECT_TRUE(inbox.Find("s", 2));
  EXPECT_EQ(inbox.Pop().bytes, MakeBytes(10, 1));
}

TEST(Inbox, ForgetsTheFirstOfTooManySenders) {
  Inbox inbox;
  for (int i = 0; i < 4097; ++i) {
    const std::string sender = std::to_string(i);
    inbox.Finish(*inbox.Add(Announce(sender, 1, 10), kStart + std::chrono::seconds(i)), MakeBytes(10, 1));
    inbox.Judge(inbox.Pop().manifest, {});
  }
  inbox.Clean(kStart);
  EXPECT_FALSE(inbox.Find("0", 1));
  EXPECT_TRUE(inbox.Find("1", 1));
}

}  // namespace inbox_test
}  // namespace etude::bus
