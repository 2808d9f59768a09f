// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <atomic>
#include <future>
#include <map>
#include <thread>

#include "services/bus/blob_transfer.h"
#include "services/bus/topic.h"
#include "services/core/hash.h"
#include "tests/services/bus/two_processes.h"

namespace etude::bus {
namespace blob_test {

using namespace std::chrono_literals;

constexpr std::uint32_t kDomain = 73;

// Receives and acknowledges in a thread until it is destroyed.
class Collector {
 public:
  Collector(const Participant& participant, const std::string& name, const ReceiveOptions& options = {})
      : receiver_(std::move(*BlobReceiver::Open(participant, {name, "1"}, "episode", options))) {
    thread_ = std::thread([this] { Run(); });
  }
  ~Collector() {
    done_ = true;
    thread_.join();
  }
  const std::map<std::string, std::vector<ReceivedBlob>>& Stop() {
    done_ = true;
    if (thread_.joinable()) thread_.join();
    thread_ = std::thread([] {});
    return objects_;
  }
  std::uint64_t corrupt() const { return receiver_.corrupt_blobs(); }

 private:
  void Run() {
    while (!done_) {
      auto blob = receiver_.Receive(20ms);
      if (!blob) continue;
      EXPECT_TRUE(receiver_.Acknowledge(blob->manifest, {AckKind::kDone, ""}));
      objects_[blob->manifest.sender].push_back(std::move(*blob));
    }
  }
  BlobReceiver receiver_;
  std::atomic<bool> done_{false};
  std::map<std::string, std::vector<ReceivedBlob>> objects_;
  std::thread thread_;
};

TEST(BlobTransfer, BlobsOfManySizesArriveWhole) {
  const auto peers = OpenTwo(kDomain);
  Collector collector(peers.b, "sizes");
  SendOptions options;
  options.chunk_size = 4096;
  options.window = 8;
  auto sender = BlobSender::Open(peers.a, {"sizes", "1"}, "episode", "s", options);
  ASSERT_TRUE(sender);
  const std::vector<std::size_t> sizes{0, 1, 4095, 4096, 4097, 8192, 100'000, 1'000'003};
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    const auto verdict = sender->Send(i, MakeBytes(sizes[i], 1), 40 + i, "{\"i\":1}", 20s);
    ASSERT_TRUE(verdict) << verdict.error().message;
    EXPECT_EQ(verdict->kind, AckKind::kDone);
  }
  const auto& blobs = collector.Stop().at("s");
  ASSERT_EQ(blobs.size(), sizes.size());
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    EXPECT_EQ(blobs[i].bytes, MakeBytes(sizes[i], 1)) << sizes[i];
    EXPECT_EQ(blobs[i].manifest.id, i);
    EXPECT_EQ(blobs[i].manifest.token, 40 + i);
    EXPECT_EQ(blobs[i].manifest.meta_json, "{\"i\":1}");
    EXPECT_EQ(blobs[i].manifest.sha256.size(), 32u);
  }
}

TEST(BlobTransfer, TwoSendersAtOnce) {
  const auto peers = OpenTwo(kDomain);
  Collector collector(peers.b, "two");
  std::vector<std::thread> threads;
  for (const char* name : {"left", "right"}) {
    threads.emplace_back([&peers, name] {
      SendOptions options;
      options.chunk_size = 32 * 1024;
      auto sender = BlobSender::Open(peers.a, {"two", "1"}, "episode", name, options);
      ASSERT_TRUE(sender);
      for (std::uint64_t id = 0; id < 10; ++id) {
        const auto bytes = MakeBytes(300'000 + id, *name);
        const auto verdict = sender->Send(id, bytes, 0, "", 20s);
        ASSERT_TRUE(verdict) << verdict.error().message;
        EXPECT_EQ(verdict->kind, AckKind::kDone);
      }
    });
  }
  for (auto& thread : threads) thread.join();
  const auto& blobs = collector.Stop();
  for (const char* name : {"left", "right"}) {
    ASSERT_EQ(blobs.at(name).size(), 10u);
    for (std::uint64_t id = 0; id < 10; ++id) {
      EXPECT_EQ(blobs.at(name)[id].bytes, MakeBytes(300'000 + id, *name));
    }
  }
}

TEST(BlobTransfer, RepeatsAreAnsweredWithoutAnotherReceive) {
  const auto peers = OpenTwo(kDomain);
  Collector collector(peers.b, "repeat");
  const auto bytes = MakeBytes(500'000, 4);
  for (int round = 0; round < 3; ++round) {  // a worker that did not see the ack sends again
    auto sender = BlobSender::Open(peers.a, {"repeat", "1"}, "episode", "same");
    ASSERT_TRUE(sender);
    const auto verdict = sender->Send(7, bytes, 0, "", 20s);
    ASSERT_TRUE(verdict) << verdict.error().message;
    EXPECT_EQ(verdict->kind, AckKind::kDone);
  }
  EXPECT_EQ(collector.Stop().at("same").size(), 1u);
}

TEST(BlobTransfer, OnlyTheLastVerdictsOfASenderAreKept) {
  const auto peers = OpenTwo(kDomain);
  ReceiveOptions options;
  options.verdicts_kept = 2;
  Collector collector(peers.b, "kept", options);
  auto sender = BlobSender::Open(peers.a, {"kept", "1"}, "episode", "s");
  ASSERT_TRUE(sender);
  for (const std::uint64_t id : {1, 2, 3, 3, 2, 1}) {
    const auto verdict = sender->Send(id, MakeBytes(1000, static_cast<std::uint32_t>(id)), 0, "", 20s);
    ASSERT_TRUE(verdict) << verdict.error().message;
    EXPECT_EQ(verdict->kind, AckKind::kDone);
  }
  std::vector<std::uint64_t> received;
  for (const auto& blob : collector.Stop().at("s")) received.push_back(blob.manifest.id);
  EXPECT_EQ(received, (std::vector<std::uint64_t>{1, 2, 3, 1})) << "2 and 3 were answered from memory";
}

TEST(BlobTransfer, OwnersOfOneNameAreApart) {
  const auto peers = OpenTwo(kDomain);
  Collector collector(peers.b, "owner");
  const auto send = [&](const std::string& id, std::chrono::milliseconds patience) {
    auto sender = BlobSender::Open(peers.a, {"owner", id}, "episode", "of-" + id);
    EXPECT_TRUE(sender);
    return sender->Send(1, MakeBytes(300'000, 1), 0, "", patience);
  };
  const auto ours = send("1", 20s);
  ASSERT_TRUE(ours) << ours.error().message;
  EXPECT_EQ(ours->kind, AckKind::kDone);
  EXPECT_FALSE(send("2", 300ms));
  const auto& received = collector.Stop();
  EXPECT_EQ(received.size(), 1u);
  EXPECT_EQ(received.at("of-1")[0].manifest.owner, "1");
}

// Of a blob that needs no chunks; whose it is, and of which host, is to be said.
BlobManifest SmallManifest() {
  BlobManifest manifest;
  manifest.channel = "episode";
  manifest.sender = "hand";
  manifest.data = MakeBytes(100, 1);
  manifest.size = manifest.chunk_size = 100;
  manifest.chunk_count = 1;
  const auto digest = Sha256Of(manifest.data);
  manifest.sha256.assign(digest.begin(), digest.end());
  return manifest;
}

// Whatever writes into the partition: the manifest says whose it is.
TEST(BlobTransfer, BlobsOfAnotherOwnerAreNotTaken) {
  const auto peers = OpenTwo(kDomain);
  auto receiver = BlobReceiver::Open(peers.b, {"mixed", "1"}, "episode");
  auto manifests = Writer<BlobManifest>::Open(peers.a, "mixed/1/episode");
  ASSERT_TRUE(receiver && manifests);
  ASSERT_TRUE(manifests->WaitForReaders(1, 10s));
  BlobManifest manifest = SmallManifest();
  manifest.host = peers.a.address();
  for (const char* owner : {"2", "1"}) {
    manifest.owner = owner;
    ++manifest.id;
    ASSERT_TRUE(manifests->Write(manifest));
  }
  const auto blob = receiver->Receive(10s);
  ASSERT_TRUE(blob);
  EXPECT_EQ(blob->manifest.owner, "1");
  EXPECT_EQ(blob->manifest.id, 2u);
}

// Whose partition a manifest names is anybody's word.
TEST(BlobTransfer, ManifestsOfImpossibleHostsAreDroppedAndCounted) {
  const auto peers = OpenTwo(kDomain);
  auto receiver = BlobReceiver::Open(peers.b, {"hosts", "1"}, "episode");
  auto manifests = Writer<BlobManifest>::Open(peers.a, "hosts/1/episode");
  ASSERT_TRUE(receiver && manifests);
  ASSERT_TRUE(manifests->WaitForReaders(1, 10s));
  BlobManifest manifest = SmallManifest();
  manifest.owner = "1";
  for (const char* host : {"", "*", "../other", "a/b", "good"}) {
    manifest.host = host;
    ++manifest.id;
    ASSERT_TRUE(manifests->Write(manifest));
  }
  const auto blob = receiver->Receive(10s);
  ASSERT_TRUE(blob);
  EXPECT_EQ(blob->manifest.host, "good");
  EXPECT_EQ(receiver->malformed_samples(), 4u);
}

// Two senders under one name would take each other's answers if those went to everybody.
TEST(BlobTransfer, AcknowledgementsComeToTheSendersHostAlone) {
  const auto peers = OpenTwo(kDomain);
  Collector collector(peers.b, "answers");
  auto neighbour = Reader<BlobAck>::Open(peers.a, PartitionOfAddress("answers/1/episode", "neighbour"));
  auto everybody = Reader<BlobAck>::Open(peers.a, "answers/1/episode");
  ASSERT_TRUE(neighbour && everybody);
  auto sender = BlobSender::Open(peers.a, {"answers", "1"}, "episode", "s");
  ASSERT_TRUE(sender);
  for (std::uint64_t id = 0; id < 5; ++id) {
    const auto verdict = sender->Send(id, MakeBytes(300'000, 2), 0, "", 20s);
    ASSERT_TRUE(verdict) << verdict.error().message;
    EXPECT_EQ(verdict->kind, AckKind::kDone);
  }
  EXPECT_TRUE(neighbour->Take().empty());
  EXPECT_TRUE(everybody->Take().empty());
  EXPECT_EQ(neighbour->matched_writers() + everybody->matched_writers(), 0);
}

TEST(BlobTransfer, TheVerdictsAndReasonsTravel) {
  const auto peers = OpenTwo(kDomain);
  auto receiver = BlobReceiver::Open(peers.b, {"verdict", "1"}, "episode");
  auto sender = BlobSender::Open(peers.a, {"verdict", "1"}, "episode", "s");
  ASSERT_TRUE(receiver && sender);
  const auto bytes = MakeBytes(200'000, 5);
  auto sending = std::async(std::launch::async, [&] { return sender->Send(1, bytes, 9, "", 20s); });
  const auto blob = receiver->Receive(20s);
  ASSERT_TRUE(blob);
  ASSERT_TRUE(receiver->Acknowledge(blob->manifest, {AckKind::kRefused, "token 9 is fenced off"}));
  const auto verdict = sending.get();
  ASSERT_TRUE(verdict) << verdict.error().message;
  EXPECT_EQ(verdict->kind, AckKind::kRefused);
  EXPECT_EQ(verdict->reason, "token 9 is fenced off");
}

TEST(BlobTransfer, WhoeverCollectsIsToldWhatWasRefused) {
  const auto peers = OpenTwo(kDomain);
  ReceiveOptions receive;
  receive.max_blob_size = 1000;
  auto receiver = BlobReceiver::Open(peers.b, {"refused", "1"}, "episode", receive);
  auto sender = BlobSender::Open(peers.a, {"refused", "1"}, "episode", "s", {});
  ASSERT_TRUE(receiver && sender);
  auto sending = std::async(std::launch::async, [&] { return sender->Send(1, MakeBytes(1001, 1), 7, "", 20s); });
  std::vector<RefusedBlob> refused;
  while (refused.empty() && sending.wait_for(0s) != std::future_status::ready) {
    EXPECT_FALSE(receiver->Receive(20ms));
    refused = receiver->TakeRefused();
  }
  EXPECT_EQ(sending.get()->kind, AckKind::kRefused);
  if (refused.empty()) refused = receiver->TakeRefused();
  ASSERT_EQ(refused.size(), 1u);
  EXPECT_EQ(refused[0].manifest.sender, "s");
  EXPECT_EQ(refused[0].manifest.token, 7u);
  EXPECT_NE(refused[0].reason.find("1001"), std::string::npos) << refused[0].reason;
  EXPECT_TRUE(receiver->TakeRefused().empty());
}

TEST(BlobTransfer, OversizeIsRefusedBeforeAnyMemory) {
  const auto peers = OpenTwo(kDomain);
  ReceiveOptions receive;
  receive.max_blob_size = 100'000;
  Collector collector(peers.b, "large", receive);
  SendOptions options;
  options.chunk_size = 16 * 1024;
  auto sender = BlobSender::Open(peers.a, {"large", "1"}, "episode", "s", options);
  ASSERT_TRUE(sender);
  const auto verdict = sender->Send(1, MakeBytes(100'001, 1), 0, "", 20s);
  ASSERT_TRUE(verdict) << verdict.error().message;
  EXPECT_EQ(verdict->kind, AckKind::kRefused);
  EXPECT_NE(verdict->reason.find("100001"), std::string::npos) << verdict->reason;
  const auto fits = sender->Send(2, MakeBytes(100'000, 1), 0, "", 20s);
  ASSERT_TRUE(fits);
  EXPECT_EQ(fits->kind, AckKind::kDone);
  EXPECT_EQ(collector.Stop().at("s").size(), 1u);
}

TEST(BlobTransfer, AManifestMayNotReserveMoreThanAllowed) {
  const auto peers = OpenTwo(kDomain);
  auto receiver = BlobReceiver::Open(peers.b, {"liar", "1"}, "episode");
  auto manifests = Writer<BlobManifest>::Open(peers.a, "liar/1/episode");
  auto acks = Reader<BlobAck>::Open(peers.a, PartitionOfAddress("liar/1/episode", peers.a.address()));
  ASSERT_TRUE(receiver && manifests && acks);
  ASSERT_TRUE(manifests->WaitForReaders(1, 10s));
  BlobManifest manifest;
  manifest.channel = "episode";
  manifest.sender = "liar";
  manifest.owner = "1";
  manifest.host = peers.a.address();
  manifest.size = 1ull << 39;
  manifest.chunk_size = kMaxChunkSize;
  manifest.chunk_count = static_cast<std::uint32_t>(manifest.size / kMaxChunkSize);
  manifest.sha256.assign(32, 0);
  std::vector<BlobAck> answers;
  while (answers.empty()) {
    ASSERT_TRUE(manifests->Write(manifest));
    EXPECT_FALSE(receiver->Receive(20ms));
    if (acks->Wait(20ms)) answers = acks->Take();
  }
  EXPECT_EQ(answers[0].kind, AckKind::kRefused);
}

TEST(BlobTransfer, OthersWaitWhenMemoryIsFull) {
  const auto peers = OpenTwo(kDomain);
  ReceiveOptions receive;
  receive.max_memory = 300'000;  // one blob of the two
  Collector collector(peers.b, "memory", receive);
  std::vector<std::thread> threads;
  for (const char* name : {"left", "right"}) {
    threads.emplace_back([&peers, name] {
      SendOptions options;
      options.chunk_size = 16 * 1024;
      options.window = 2;
      options.resend_after = 50ms;
      auto sender = BlobSender::Open(peers.a, {"memory", "1"}, "episode", name, options);
      ASSERT_TRUE(sender);
      for (std::uint64_t id = 0; id < 3; ++id) {
        const auto verdict = sender->Send(id, MakeBytes(250'000, *name), 0, "", 30s);
        ASSERT_TRUE(verdict) << verdict.error().message;
        EXPECT_EQ(verdict->kind, AckKind::kDone);
      }
    });
  }
  for (auto& thread : threads) thread.join();
  EXPECT_EQ(collector.Stop().at("left").size(), 3u);
  EXPECT_EQ(collector.Stop().at("right").size(), 3u);
}

TEST(BlobTransfer, SendTimesOutWithoutAReceiverAndMaySendAgain) {
  const auto peers = OpenTwo(kDomain);
  auto sender = BlobSender::Open(peers.a, {"alone", "1"}, "episode", "s");
  ASSERT_TRUE(sender);
  const auto bytes = MakeBytes(300'000, 6);
  const auto nobody = sender->Send(1, bytes, 0, "", 50ms);
  ASSERT_FALSE(nobody);
  EXPECT_EQ(nobody.error().code, Code::kTimeout);
  Collector collector(peers.b, "alone");
  const auto verdict = sender->Send(1, bytes, 0, "", 20s);
  ASSERT_TRUE(verdict) << verdict.error().message;
  EXPECT_EQ(collector.Stop().at("s").at(0).bytes, bytes);
}

TEST(BlobTransfer, RefusesBadOptions) {
  const auto peers = OpenTwo(kDomain);
  SendOptions options;
  options.chunk_size = kMaxChunkSize + 1;
  EXPECT_FALSE(BlobSender::Open(peers.a, {"p", "1"}, "c", "s", options));
  options = {};
  options.window = 0;
  EXPECT_FALSE(BlobSender::Open(peers.a, {"p", "1"}, "c", "s", options));
}

}  // namespace blob_test
}  // namespace etude::bus
