// SPDX-License-Identifier: Apache-2.0
// Samples that DDS accepts and that we must not.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "services/bus/serialized.h"
#include "services/bus/topic.h"
#include "services/bus/typed.h"
#include "tests/services/bus/two_processes.h"

namespace etude::bus {
namespace malformed_test {

using namespace std::chrono_literals;

template <class Message>
struct Rig {
  TwoProcesses peers = OpenTwo(70);
  Endpoint raw = std::move(*OpenWriterOf<Message>(peers.a, "bad"));
  Writer<Message> writer = std::move(*Writer<Message>::Open(peers.a, "bad"));
  Reader<Message> reader = std::move(*Reader<Message>::Open(peers.b, "bad"));

  Rig() {
    EXPECT_TRUE(writer.WaitForReaders(1, 10s));
    Waiter waiter;
    EXPECT_TRUE(waiter.Open(peers.a));
    EXPECT_TRUE(waiter.AddMatched(raw));
    while (MatchedReaders(raw) == 0) EXPECT_TRUE(waiter.Wait(10s));
  }
  void WriteRaw(const typename Traits<Message>::Wire& wire) { EXPECT_EQ(dds_write(raw.get(), &wire), DDS_RETCODE_OK); }
  // What comes of one bad sample and a good one behind it.
  void ExpectOnlyTheGoodOne(const Message& good) {
    ASSERT_TRUE(writer.Write(good));
    std::size_t taken = 0;
    while (reader.malformed() < 1 || taken < 1) {
      ASSERT_TRUE(reader.Wait(10s));
      taken += reader.Take().size();
    }
    EXPECT_EQ(taken, 1u);
    EXPECT_EQ(reader.malformed(), 1u);
  }
};

Observation MakeObservation() {
  Observation observation;
  observation.session = "good";
  observation.width = 2;
  observation.height = 2;
  observation.image.assign(12, 1);
  return observation;
}

// An observation that `spoil` made wrong is refused, and the good one behind it is not.
template <class Spoil>
void ExpectRefused(const Spoil& spoil) {
  Rig<Observation> rig;
  const auto good = MakeObservation();
  auto wire = *Encode(good);
  std::snprintf(wire.session, sizeof(wire.session), "bad");
  spoil(wire);
  rig.WriteRaw(wire);
  rig.ExpectOnlyTheGoodOne(good);
}

TEST(Malformed, ImageOfAnotherSizeThanSaid) {
  ExpectRefused([](auto& wire) { wire.width = wire.height = 4096; });
}

TEST(Malformed, SidesWhoseProductOverflows) {
  ExpectRefused([](auto& wire) {
    wire.width = 0x80000000u;
    wire.height = 0x80000004u;
  });
}

TEST(Malformed, JointsThatAreNotNumbers) {
  float joints[] = {0.5f, std::numeric_limits<float>::quiet_NaN()};
  ExpectRefused([&](auto& wire) {
    wire.joints._buffer = joints;
    wire.joints._length = wire.joints._maximum = 2;
  });
}

TEST(Malformed, UnknownKindOfLease) {
  Rig<Lease> rig;
  Lease good;
  good.worker = "good";
  auto wire = *Encode(good);
  wire.kind = 200;
  rig.WriteRaw(wire);
  rig.ExpectOnlyTheGoodOne(good);
}

TEST(Malformed, TextBeyondTheLimit) {
  Rig<AttemptReport> rig;
  AttemptReport good;
  good.worker = "good";
  auto wire = *Encode(good);
  std::string huge(kMaxText + 1, 'x');
  wire.details_json = huge.data();
  rig.WriteRaw(wire);
  rig.ExpectOnlyTheGoodOne(good);
}

TEST(Malformed, ManifestWhoseCountsContradict) {
  Rig<BlobManifest> rig;
  BlobManifest good;
  good.size = 10;
  good.chunk_size = 4;
  good.chunk_count = 3;
  good.sha256.assign(32, 1);
  auto wire = *Encode(good);
  wire.size = ~0ull;
  rig.WriteRaw(wire);
  rig.ExpectOnlyTheGoodOne(good);
}

// every prefix, and every byte changed, of a serialised sample: refused or read, never beyond its end
TEST(Malformed, ParserSurvivesEveryTruncationAndEveryByte) {
  const std::vector<std::uint8_t> good = [] {
    std::vector<std::uint8_t> cdr{0, 7, 0, 0};
    const auto number = [&](std::uint64_t value, int size) {
      for (int i = 0; i < size; ++i) cdr.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
    };
    number(77, 8);
    number(3, 4);
    for (const char* text : {"abc", "sender-"}) {
      number(std::strlen(text) + 1, 4);
      cdr.insert(cdr.end(), text, text + std::strlen(text) + 1);
    }
    number(5, 4);
    for (int i = 0; i < 5; ++i) cdr.push_back(static_cast<std::uint8_t>(i));
    return cdr;
  }();
  ChunkView view;
  ASSERT_TRUE(Parse(good, view));
  EXPECT_EQ(view.id, 77u);
  EXPECT_EQ(view.index, 3u);
  EXPECT_EQ(view.channel, "abc");
  EXPECT_EQ(view.sender, "sender-");
  EXPECT_EQ(view.data.size(), 5u);
  for (std::size_t size = 0; size < good.size(); ++size) {
    const std::vector<std::uint8_t> prefix(good.begin(), good.begin() + static_cast<long>(size));
    EXPECT_FALSE(Parse(prefix, view)) << size;
  }
  for (std::size_t i = 0; i < good.size(); ++i) {
    for (const int value : {0, 1, 0x7f, 0x80, 0xff}) {
      auto changed = good;
      changed[i] = static_cast<std::uint8_t>(value);
      if (!Parse(changed, view)) continue;
      const auto* end = changed.data() + changed.size();
      EXPECT_LE(view.data.data() + view.data.size(), end);
      EXPECT_LE(view.channel.size() + view.sender.size(), changed.size());
    }
  }
}

}  // namespace malformed_test
}  // namespace etude::bus
