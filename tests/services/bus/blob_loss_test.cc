// SPDX-License-Identifier: Apache-2.0
// Blob transfers when packets, chunks, acks or receivers get lost.
#include <gtest/gtest.h>

#include <algorithm>
#include <future>
#include <thread>

#include "services/bus/assembly.h"
#include "services/bus/blob_transfer.h"
#include "services/bus/topic.h"
#include "services/core/hash.h"
#include "tests/services/bus/two_processes.h"

namespace etude::bus {
namespace blob_loss_test {

using namespace std::chrono_literals;

constexpr std::uint32_t kDomain = 73;

TEST(BlobLoss, LostPacketsAreMadeUpFor) {
  const auto peers = OpenTwo(kDomain, 30);
  auto receiver = BlobReceiver::Open(peers.b, {"lossy", "1"}, "episode");
  ASSERT_TRUE(receiver);
  constexpr std::uint64_t kCount = 6;
  std::thread sending([&peers] {
    SendOptions options;
    options.chunk_size = 32 * 1024;
    options.window = 8;
    auto sender = BlobSender::Open(peers.a, {"lossy", "1"}, "episode", "s", options);
    ASSERT_TRUE(sender);
    for (std::uint64_t id = 0; id < kCount; ++id) {
      const auto verdict = sender->Send(id, MakeBytes(400'000 + id, 8), 0, "", 60s);
      ASSERT_TRUE(verdict) << verdict.error().message;
      EXPECT_EQ(verdict->kind, AckKind::kDone);
    }
  });
  for (std::uint64_t id = 0; id < kCount; ++id) {
    const auto blob = receiver->Receive(60s);
    ASSERT_TRUE(blob);
    EXPECT_EQ(blob->bytes, MakeBytes(400'000 + id, 8));
    EXPECT_TRUE(receiver->Acknowledge(blob->manifest, {}));
  }
  for (auto done = std::async(std::launch::async, [&] { sending.join(); });
       done.wait_for(0ms) != std::future_status::ready;) {
    EXPECT_FALSE(receiver->Receive(20ms));  // answers what is asked again
  }
  EXPECT_EQ(receiver->corrupt_blobs(), 0u);
}

// A sender made by hand, so that it can do what a real one would not.
struct Hand {
  Writer<BlobManifest> manifests;
  Writer<BlobChunk> chunks;
  Reader<BlobAck> acks;
  std::string host;
  BlobReceiver& receiver;

  Hand(const TwoProcesses& peers, const std::string& name, BlobReceiver& to)
      : manifests(std::move(*Writer<BlobManifest>::Open(peers.a, name + "/1/episode"))),
        chunks(std::move(*Writer<BlobChunk>::Open(peers.a, name + "/1/episode"))),
        acks(std::move(*Reader<BlobAck>::Open(peers.a, PartitionOfAddress(name + "/1/episode", peers.a.address())))),
        host(peers.a.address()),
        receiver(to) {
    EXPECT_TRUE(manifests.WaitForReaders(1, 10s));
    EXPECT_TRUE(chunks.WaitForReaders(1, 10s));
  }
  BlobManifest Manifest(std::uint64_t id, const std::vector<std::uint8_t>& bytes) const {
    BlobManifest manifest;
    manifest.channel = "episode";
    manifest.sender = "hand";
    manifest.owner = "1";
    manifest.host = host;
    manifest.id = id;
    manifest.size = bytes.size();
    manifest.chunk_size = 1000;
    manifest.chunk_count = ChunkCount(bytes.size(), 1000);
    const auto digest = Sha256Of(bytes);
    manifest.sha256.assign(digest.begin(), digest.end());
    return manifest;
  }
  void SendChunk(std::uint64_t id, const std::vector<std::uint8_t>& bytes, std::uint32_t index) {
    const auto data = ChunkOf(bytes, 1000, index);
    EXPECT_TRUE(chunks.Write({"episode", "hand", id, index, {data.begin(), data.end()}}));
  }
  void SendAll(std::uint64_t id, const std::vector<std::uint8_t>& bytes) {
    for (std::uint32_t index = 0; index < ChunkCount(bytes.size(), 1000); ++index) SendChunk(id, bytes, index);
  }
  // Announces until an ack of `kind` with `received` comes; false when a blob came out instead.
  std::optional<BlobAck> Ask(const BlobManifest& manifest, AckKind kind, std::uint32_t received) {
    for (int attempt = 0; attempt < 500; ++attempt) {
      EXPECT_TRUE(manifests.Write(manifest));
      EXPECT_FALSE(receiver.Receive(5ms)) << "not complete yet";
      if (!acks.Wait(5ms)) continue;
      for (auto& ack : acks.Take()) {
        if (ack.id == manifest.id && ack.kind == kind && ack.received == received) return ack;
      }
    }
    return std::nullopt;
  }
};

/// A receiver and the hand that sends to it.
struct Receiving {
  explicit Receiving(const std::string& name)
      : receiver(std::move(*BlobReceiver::Open(peers.b, {name, "1"}, "episode"))), hand(peers, name, receiver) {}

  TwoProcesses peers = OpenTwo(kDomain);
  BlobReceiver receiver;
  Hand hand;
};

void ExpectReceived(BlobReceiver& receiver, const std::vector<std::uint8_t>& bytes) {
  const auto blob = receiver.Receive(10s);
  ASSERT_TRUE(blob);
  EXPECT_EQ(blob->bytes, bytes);
}

TEST(BlobLoss, TheReceiverSaysWhatIsMissing) {
  Receiving to("gaps");
  BlobReceiver& receiver = to.receiver;
  Hand& hand = to.hand;
  const auto bytes = MakeBytes(9'500, 1);
  const auto manifest = hand.Manifest(1, bytes);
  ASSERT_TRUE(hand.Ask(manifest, AckKind::kMissing, 0));
  for (const std::uint32_t index : {0u, 1u, 3u, 4u, 7u}) hand.SendChunk(1, bytes, index);
  std::optional<BlobAck> ack;
  const std::vector<std::uint32_t> expected{2, 5, 6, 8, 9};
  for (int attempt = 0; attempt < 100 && (!ack || ack->missing != expected); ++attempt) {
    ack = hand.Ask(manifest, AckKind::kMissing, 2);  // chunks may still be on their way
    ASSERT_TRUE(ack);
  }
  EXPECT_EQ(ack->missing, expected);
  for (const auto index : ack->missing) hand.SendChunk(1, bytes, index);
  ExpectReceived(receiver, bytes);
}

TEST(BlobLoss, ChunksBeforeTheirManifestAreAskedForAgain) {
  Receiving to("early");
  BlobReceiver& receiver = to.receiver;
  Hand& hand = to.hand;
  const auto bytes = MakeBytes(2'500, 2);
  hand.SendAll(1, bytes);
  // what the same writer sends later is read later: once the second one is whole, the first one's chunks have been read
  const auto other = MakeBytes(1'500, 3);
  ASSERT_TRUE(hand.Ask(hand.Manifest(2, other), AckKind::kMissing, 0));
  hand.SendAll(2, other);
  ExpectReceived(receiver, other);
  ASSERT_TRUE(hand.Ask(hand.Manifest(1, bytes), AckKind::kMissing, 0));
  hand.SendAll(1, bytes);
  ExpectReceived(receiver, bytes);
}

TEST(BlobLoss, CorruptChunksRefuseTheBlobAndCount) {
  Receiving to("corrupt");
  BlobReceiver& receiver = to.receiver;
  Hand& hand = to.hand;
  const auto bytes = MakeBytes(5'000, 3);
  auto wrong = bytes;
  wrong[3'333] ^= 1;
  const auto manifest = hand.Manifest(1, bytes);
  ASSERT_TRUE(hand.Ask(manifest, AckKind::kMissing, 0));
  hand.SendAll(1, wrong);
  while (receiver.corrupt_blobs() == 0) ASSERT_FALSE(receiver.Receive(10ms));
  bool refused = false;
  while (!refused) {
    ASSERT_TRUE(hand.acks.Wait(10s));
    for (const auto& ack : hand.acks.Take()) refused = refused || ack.kind == AckKind::kRefused;
  }
  // the same id may be tried again
  ASSERT_TRUE(hand.Ask(manifest, AckKind::kMissing, 0));
  hand.SendAll(1, bytes);
  ExpectReceived(receiver, bytes);
  EXPECT_EQ(receiver.corrupt_blobs(), 1u);
}

TEST(BlobLoss, MalformedChunksAreDroppedAndCounted) {
  Receiving to("malformed");
  BlobReceiver& receiver = to.receiver;
  Hand& hand = to.hand;
  const auto bytes = MakeBytes(3'000, 4);
  ASSERT_TRUE(hand.Ask(hand.Manifest(1, bytes), AckKind::kMissing, 0));
  ASSERT_TRUE(hand.chunks.Write({"episode", "hand", 1, 0, std::vector<std::uint8_t>(999)}));
  ASSERT_TRUE(hand.chunks.Write({"episode", "hand", 1, 3, std::vector<std::uint8_t>(1000)}));
  hand.SendAll(1, bytes);
  ExpectReceived(receiver, bytes);
  EXPECT_EQ(receiver.malformed_samples(), 2u);
}

TEST(BlobLoss, AReceiverThatRestartsInTheMiddleGetsAllOfIt) {
  const auto peers = OpenTwo(kDomain);
  const auto bytes = MakeBytes(4'000'000, 5);
  SendOptions options;
  options.chunk_size = 16 * 1024;
  options.window = 4;
  auto sender = BlobSender::Open(peers.a, {"restart", "1"}, "episode", "s", options);
  ASSERT_TRUE(sender);
  auto acks = Reader<BlobAck>::Open(peers.b, PartitionOfAddress("restart/1/episode", peers.a.address()));
  ASSERT_TRUE(acks);
  auto sending = std::async(std::launch::async, [&] { return sender->Send(1, bytes, 0, "", 60s); });
  {
    auto receiver = BlobReceiver::Open(peers.b, {"restart", "1"}, "episode");
    ASSERT_TRUE(receiver);
    // some of the 245 chunks arrive, far from all
    for (std::uint32_t received = 0; received < 20;) {
      ASSERT_FALSE(receiver->Receive(0ns));
      acks->Wait(1ms);
      for (const auto& ack : acks->Take()) received = std::max(received, ack.received);
    }
  }
  auto receiver = BlobReceiver::Open(peers.b, {"restart", "1"}, "episode");
  ASSERT_TRUE(receiver);
  const auto blob = receiver->Receive(60s);
  ASSERT_TRUE(blob);
  EXPECT_EQ(blob->bytes, bytes);
  ASSERT_TRUE(receiver->Acknowledge(blob->manifest, {}));
  EXPECT_TRUE(sending.get());
}

TEST(BlobLoss, AReceiverThatRestartsBeforeItsVerdictIsAskedAgain) {
  const auto peers = OpenTwo(kDomain);
  const auto bytes = MakeBytes(60'000, 6);  // travels inside its manifest
  auto sender = BlobSender::Open(peers.a, {"again", "1"}, "episode", "s");
  ASSERT_TRUE(sender);
  auto sending = std::async(std::launch::async, [&] { return sender->Send(1, bytes, 0, "", 60s); });
  {
    auto crashing = BlobReceiver::Open(peers.b, {"again", "1"}, "episode");
    ASSERT_TRUE(crashing);
    ASSERT_TRUE(crashing->Receive(20s));  // and gone without an answer
  }
  auto receiver = BlobReceiver::Open(peers.b, {"again", "1"}, "episode");
  ASSERT_TRUE(receiver);
  const auto blob = receiver->Receive(20s);
  ASSERT_TRUE(blob);
  EXPECT_EQ(blob->bytes, bytes);
  ASSERT_TRUE(receiver->Acknowledge(blob->manifest, {AckKind::kDuplicate, ""}));
  const auto verdict = sending.get();
  ASSERT_TRUE(verdict) << verdict.error().message;
  EXPECT_EQ(verdict->kind, AckKind::kDuplicate);
}

}  // namespace blob_loss_test
}  // namespace etude::bus
