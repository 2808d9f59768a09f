// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <map>
#include <thread>

#include "services/bus/blob_transfer.h"
#include "services/bus/typed.h"
#include "services/core/clock.h"
#include "services/core/hash.h"
#include "tests/services/bus/two_processes.h"

namespace etude::bus {
namespace publish_test {

using namespace std::chrono_literals;

constexpr std::uint32_t kDomain = 74;

SendOptions SmallChunks() {
  SendOptions options;
  options.chunk_size = 10'000;
  return options;
}

TEST(Published, EverySizeArrives) {
  const auto peers = OpenTwo(kDomain);
  auto publisher = BlobPublisher::Open(peers.a, {"sizes", "1"}, SmallChunks());
  auto subscriber = BlobSubscriber::Open(peers.b, {"sizes", "1"}, "latest");
  ASSERT_TRUE(publisher && subscriber);
  std::uint64_t version = 0;
  for (const std::size_t size : {0u, 1u, 9'999u, 10'000u, 10'001u, 2'000'000u, 20'000u}) {
    const auto bytes = MakeBytes(size, 1);
    const auto published = publisher->Publish("latest", ++version, bytes, "{\"step\":3}");
    ASSERT_TRUE(published) << published.error().message;
    const auto blob = subscriber->Wait(20s);
    ASSERT_TRUE(blob) << size;
    EXPECT_EQ(blob->version, version);
    EXPECT_EQ(blob->bytes, bytes);
    EXPECT_EQ(blob->sha256, Sha256Hex(bytes));
    EXPECT_EQ(blob->meta_json, "{\"step\":3}");
    EXPECT_EQ(blob->channel, "latest");
  }
  EXPECT_EQ(subscriber->corrupt_blobs(), 0u);
  EXPECT_EQ(publisher->matched_subscribers(), 1);
}

TEST(Published, ALateSubscriberGetsTheNewestOfEachChannel) {
  const auto peers = OpenTwo(kDomain);
  auto publisher = BlobPublisher::Open(peers.a, {"late", "1"}, SmallChunks());
  ASSERT_TRUE(publisher);
  for (std::uint64_t version = 0; version < 5; ++version) {
    ASSERT_TRUE(publisher->Publish("latest", version, MakeBytes(300'000 - version * 50'000, 1), ""));
  }
  ASSERT_TRUE(publisher->Publish("best", 2, MakeBytes(70'000, 2), ""));
  auto all = BlobSubscriber::Open(peers.b, {"late", "1"}, "");
  auto best = BlobSubscriber::Open(peers.b, {"late", "1"}, "best");
  ASSERT_TRUE(all && best);
  std::map<std::string, std::uint64_t> newest;
  while (newest["latest"] != 4 || newest["best"] != 2) {
    const auto blob = all->Wait(20s);
    ASSERT_TRUE(blob);
    EXPECT_GE(blob->version, newest[blob->channel]);
    newest[blob->channel] = blob->version;
    if (blob->channel == "latest") {
      EXPECT_EQ(blob->bytes, MakeBytes(300'000 - blob->version * 50'000, 1));
    }
  }
  const auto only = best->Wait(20s);
  ASSERT_TRUE(only);
  EXPECT_EQ(only->channel, "best");
  EXPECT_FALSE(best->Wait(50ms));
}

// A publisher by hand that stops in the middle of a version.
TEST(Published, ALateSubscriberGetsTheCompleteVersionWhileTheNextIsUnderWay) {
  const auto peers = OpenTwo(kDomain);
  auto publisher = BlobPublisher::Open(peers.a, {"half", "1"}, SmallChunks());
  ASSERT_TRUE(publisher);
  ASSERT_TRUE(publisher->Publish("latest", 1, MakeBytes(100'000, 1), ""));
  ASSERT_TRUE(publisher->Publish("latest", 2, MakeBytes(100'000, 2), ""));
  const auto chunks =
      OpenWriter(peers.a, "half/1", etude_wire_PublishedChunk_desc, kPublishedChunkTopic, kPublishedWriter);
  ASSERT_TRUE(chunks);
  const auto part = MakeBytes(10'000, 3);
  for (std::uint32_t index = 0; index < 5; ++index) {
    etude_wire_PublishedChunk wire{};
    std::snprintf(wire.channel, sizeof(wire.channel), "latest");
    std::snprintf(wire.publisher, sizeof(wire.publisher), "other");
    wire.version = 3;
    wire.size = 100'000;
    wire.chunk_size = 10'000;
    wire.index = index;
    wire.data._length = wire.data._maximum = 10'000;
    wire.data._buffer = const_cast<std::uint8_t*>(part.data());
    ASSERT_EQ(dds_write(chunks->get(), &wire), DDS_RETCODE_OK);
  }
  auto subscriber = BlobSubscriber::Open(peers.b, {"half", "1"}, "latest");
  ASSERT_TRUE(subscriber);
  std::uint64_t newest = 0;
  while (newest != 2) {  // version 1 may come first
    const auto blob = subscriber->Wait(20s);
    ASSERT_TRUE(blob);
    EXPECT_EQ(blob->bytes, MakeBytes(100'000, static_cast<std::uint32_t>(blob->version)));
    newest = blob->version;
  }
  EXPECT_FALSE(subscriber->Wait(50ms));
}

TEST(Published, ASlowSubscriberSkipsSupersededVersions) {
  const auto peers = OpenTwo(kDomain);
  auto publisher = BlobPublisher::Open(peers.a, {"slow", "1"}, SmallChunks());
  auto subscriber = BlobSubscriber::Open(peers.b, {"slow", "1"}, "latest");
  ASSERT_TRUE(publisher && subscriber);
  ASSERT_TRUE(publisher->Publish("latest", 1, MakeBytes(50'000, 1), ""));
  ASSERT_TRUE(subscriber->Wait(20s));
  for (std::uint64_t version = 2; version <= 20; ++version) {
    const auto bytes = MakeBytes(50'000, static_cast<std::uint32_t>(version));
    ASSERT_TRUE(publisher->Publish("latest", version, bytes, ""));
  }
  std::uint64_t last = 1;
  int seen = 0;
  while (last < 20) {
    const auto blob = subscriber->Wait(20s);
    ASSERT_TRUE(blob);
    EXPECT_GT(blob->version, last);
    EXPECT_EQ(blob->bytes, MakeBytes(50'000, static_cast<std::uint32_t>(blob->version)));
    last = blob->version;
    ++seen;
  }
  EXPECT_LE(seen, 19);
  EXPECT_EQ(subscriber->corrupt_blobs(), 0u);
}

TEST(Published, TwoSubscribersAndLostPackets) {
  const auto peers = OpenTwo(kDomain, 20);
  auto publisher = BlobPublisher::Open(peers.a, {"loss", "1"});
  auto one = BlobSubscriber::Open(peers.b, {"loss", "1"}, "latest");
  auto two = BlobSubscriber::Open(peers.b, {"loss", "1"}, "latest");
  ASSERT_TRUE(publisher && one && two);
  const auto bytes = MakeBytes(3'000'000, 9);
  std::thread publishing([&] { EXPECT_TRUE(publisher->Publish("latest", 1, bytes, "")); });
  for (auto* subscriber : {&*one, &*two}) {
    const auto blob = subscriber->Wait(60s);
    ASSERT_TRUE(blob);
    EXPECT_EQ(blob->bytes, bytes);
  }
  publishing.join();
}

TEST(Published, VersionsMustGrow) {
  const auto peers = OpenTwo(kDomain);
  auto publisher = BlobPublisher::Open(peers.a, {"grow", "1"});
  ASSERT_TRUE(publisher);
  ASSERT_TRUE(publisher->Publish("latest", 5, {}, ""));
  for (const std::uint64_t version : {5u, 4u}) {
    const auto again = publisher->Publish("latest", version, {}, "");
    ASSERT_FALSE(again);
    EXPECT_EQ(again.error().code, Code::kInvalidArgument);
  }
  EXPECT_TRUE(publisher->Publish("best", 1, {}, ""));
  EXPECT_TRUE(publisher->Publish("latest", 6, {}, ""));
}

TEST(Published, TooLargeIsNotTaken) {
  const auto peers = OpenTwo(kDomain);
  auto publisher = BlobPublisher::Open(peers.a, {"large", "1"}, SmallChunks());
  ReceiveOptions options;
  options.max_blob_size = 100'000;
  auto subscriber = BlobSubscriber::Open(peers.b, {"large", "1"}, "", options);
  ASSERT_TRUE(publisher && subscriber);
  ASSERT_TRUE(publisher->Publish("latest", 1, MakeBytes(100'001, 1), ""));
  ASSERT_TRUE(publisher->Publish("latest", 2, MakeBytes(100'000, 2), ""));
  const auto blob = subscriber->Wait(20s);
  ASSERT_TRUE(blob);
  EXPECT_EQ(blob->version, 2u);
}

// As when the disk of the floor is full for a moment.
TEST(Published, WhatCannotBeJudgedNowIsJudgedAgain) {
  const auto peers = OpenTwo(kDomain);
  auto publisher = BlobPublisher::Open(peers.a, {"undecided", "1"}, SmallChunks());
  bool full = true;
  ReceiveOptions options;
  options.accept = [&](const PublishedBlob&) -> Status {
    return full ? Fail(Code::kUnavailable, "disk full") : Status();
  };
  auto subscriber = BlobSubscriber::Open(peers.b, {"undecided", "1"}, "", options);
  ASSERT_TRUE(publisher && subscriber);
  const auto bytes = MakeBytes(50'000, 1);
  ASSERT_TRUE(publisher->Publish("latest", 1, bytes, ""));
  EXPECT_FALSE(subscriber->Wait(1500ms));
  full = false;
  const auto blob = subscriber->Wait(20s);
  ASSERT_TRUE(blob);
  EXPECT_EQ(blob->version, 1u);
  EXPECT_EQ(blob->bytes, bytes);
  EXPECT_FALSE(subscriber->Wait(50ms)) << "it comes once";
}

// Whatever writes into the partition: the manifest says whose version it is.
TEST(Published, VersionsOfAnotherOwnerAreNotTaken) {
  const auto peers = OpenTwo(kDomain);
  const auto manifests =
      OpenWriter(peers.a, "owner/1", etude_wire_PublishedManifest_desc, kPublishedManifestTopic, kPublishedWriter);
  ASSERT_TRUE(manifests);
  etude_wire_PublishedManifest wire{};
  std::snprintf(wire.channel, sizeof(wire.channel), "latest");
  std::snprintf(wire.publisher, sizeof(wire.publisher), "other");
  std::snprintf(wire.owner, sizeof(wire.owner), "2");
  wire.version = 7;  // empty, so its manifest is all of it
  wire.chunk_size = 10;
  auto digest = Sha256Of({});
  wire.sha256._length = wire.sha256._maximum = static_cast<std::uint32_t>(digest.size());
  wire.sha256._buffer = digest.data();
  std::string meta_json;
  wire.meta_json = meta_json.data();
  ASSERT_EQ(dds_write(manifests->get(), &wire), DDS_RETCODE_OK);
  auto publisher = BlobPublisher::Open(peers.a, {"owner", "1"}, SmallChunks());
  auto subscriber = BlobSubscriber::Open(peers.b, {"owner", "1"}, "");
  ASSERT_TRUE(publisher && subscriber);
  ASSERT_TRUE(publisher->Publish("latest", 1, MakeBytes(50'000, 1), ""));
  const auto blob = subscriber->Wait(20s);
  ASSERT_TRUE(blob);
  EXPECT_EQ(blob->owner, "1");
  EXPECT_EQ(blob->version, 1u);
  EXPECT_FALSE(subscriber->Wait(50ms));
}

TEST(Published, WhatARelayPassesOnIsTakenOnceAndNotByThoseWhoListenToTheRunAlone) {
  const auto peers = OpenTwo(kDomain);
  auto relay = BlobPublisher::OpenRelay(peers.a, {"relayed", "1"}, SmallChunks());
  auto subscriber = BlobSubscriber::Open(peers.b, {"relayed", "1"}, "latest");
  ReceiveOptions alone;
  alone.from_relays = false;
  auto other = BlobSubscriber::Open(peers.b, {"relayed", "1"}, "latest", alone);
  ASSERT_TRUE(relay && subscriber && other);
  const auto bytes = MakeBytes(50'000, 1);
  ASSERT_TRUE(relay->Publish("latest", 4, bytes, "{}"));
  const auto blob = subscriber->Wait(20s);
  ASSERT_TRUE(blob);
  EXPECT_EQ(blob->bytes, bytes);
  EXPECT_FALSE(other->Wait(50ms));

  auto publisher = BlobPublisher::Open(peers.a, {"relayed", "1"}, SmallChunks());
  ASSERT_TRUE(publisher);
  ASSERT_TRUE(publisher->Publish("latest", 4, bytes, "{}"));
  EXPECT_TRUE(other->Wait(20s));
  EXPECT_FALSE(subscriber->Wait(50ms)) << "it has this version";
}

TEST(Published, WhatIsOfferedGoesWithItsPublisher) {
  const auto peers = OpenTwo(kDomain);
  auto subscriber = BlobSubscriber::Open(peers.b, {"offered", "1"}, "");
  ASSERT_TRUE(subscriber);
  const auto wait_until = [&](std::uint64_t version, bool offered) {
    for (const Stopwatch watch; subscriber->Offered("latest", version) != offered && watch.Seconds() < 20;)
      (void)subscriber->Wait(10ms);
    EXPECT_EQ(subscriber->Offered("latest", version), offered) << version;
  };
  {
    auto publisher = BlobPublisher::Open(peers.a, {"offered", "1"}, SmallChunks());
    ASSERT_TRUE(publisher);
    EXPECT_FALSE(subscriber->Offered("latest", 1));
    for (std::uint64_t version = 1; version <= 3; ++version)
      ASSERT_TRUE(publisher->Publish("latest", version, MakeBytes(50'000, 1), ""));
    wait_until(3, true);
    wait_until(2, true);  // beside the newest one, until that has a successor
    wait_until(1, false);
    EXPECT_FALSE(subscriber->Offered("best", 3));
  }
  wait_until(3, false);
  wait_until(2, false);
}

TEST(Published, ARestartedPublisherGoesOn) {
  const auto peers = OpenTwo(kDomain);
  auto subscriber = BlobSubscriber::Open(peers.b, {"again", "1"}, "");
  ASSERT_TRUE(subscriber);
  for (std::uint64_t version = 1; version <= 2; ++version) {
    auto publisher = BlobPublisher::Open(peers.a, {"again", "1"}, SmallChunks());
    ASSERT_TRUE(publisher);
    const auto bytes = MakeBytes(200'000, static_cast<std::uint32_t>(version));
    ASSERT_TRUE(publisher->Publish("latest", version, bytes, ""));
    const auto blob = subscriber->Wait(20s);
    ASSERT_TRUE(blob);
    EXPECT_EQ(blob->version, version);
    EXPECT_EQ(blob->bytes, bytes);
  }
}

// a relay wrote the whole checkpoint ten times a second onto a disk that was full
TEST(Published, WhatCannotBeJudgedNowIsJudgedOnceASecond) {
  const auto peers = OpenTwo(kDomain);
  auto publisher = BlobPublisher::Open(peers.a, {"patient", "1"}, SmallChunks());
  int judged = 0;
  ReceiveOptions options;
  options.accept = [&](const PublishedBlob&) { return ++judged, Status(Fail(Code::kUnavailable, "disk full")); };
  auto subscriber = BlobSubscriber::Open(peers.b, {"patient", "1"}, "", options);
  ASSERT_TRUE(publisher && subscriber);
  ASSERT_TRUE(publisher->Publish("latest", 1, MakeBytes(50'000, 1), ""));
  for (const Stopwatch watch; watch.Seconds() < 20 && judged == 0;) EXPECT_FALSE(subscriber->Wait(20ms));
  for (const Stopwatch watch; watch.Seconds() < 2.5;) EXPECT_FALSE(subscriber->Wait(20ms));
  EXPECT_GE(judged, 2);
  EXPECT_LE(judged, 4);
}

}  // namespace publish_test
}  // namespace etude::bus
