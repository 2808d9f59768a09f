// SPDX-License-Identifier: Apache-2.0
// What programs of this wire number have written is read by those to come: bytes of every message as they were on the
// wire, kept in fixtures/TYPE.FIELDS.cdr (how many fields it had then). A type that gets a field gets another file; the
// old ones stay, and are read with the new field at its default.
//
//   ETUDE_WRITE_FIXTURES=1 build/tests/bus_topic_test --gtest_filter='StoredBytes*'   writes those that lack
#include <dds/ddsi/ddsi_serdata.h>
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "services/bus/typed.h"
#include "services/core/clock.h"
#include "services/core/file.h"
#include "services/core/stop.h"
#include "tests/services/bus/example_message.h"
#include "tests/services/bus/two_processes.h"

namespace etude::bus {
namespace stored_bytes_test {

using namespace std::chrono_literals;

using Bytes = std::vector<std::uint8_t>;

constexpr char kFixtures[] = "tests/services/bus/fixtures";

// Between a C struct and its bytes, as the library makes them for the wire.
class Wire {
 public:
  Wire(const dds_topic_descriptor_t& type, const char* topic, const TopicQos& writer, const TopicQos& reader)
      : type_(&type),
        participant_(std::move(*Participant::Open({150, LocalProfileWith("<ExternalDomainId>71</ExternalDomainId>")}))),
        reader_(std::move(*OpenReader(participant_, "stored", type, topic, reader))),
        writer_(std::move(*OpenWriter(participant_, "stored", type, topic, writer))) {}
  ~Wire() {
    if (last_) ddsi_serdata_unref(last_);
  }
  Wire(const Wire&) = delete;
  Wire& operator=(const Wire&) = delete;

  Bytes BytesOf(const void* sample) {
    EXPECT_EQ(dds_write(writer_.get(), sample), DDS_RETCODE_OK);
    ddsi_serdata* taken = nullptr;
    dds_sample_info_t info{};
    const Stopwatch watch;
    while (dds_takecdr(reader_.get(), &taken, 1, &info, DDS_ANY_STATE) < 1)
      if (watch.Seconds() > 20 || WaitForStop(1ms)) return {};
    if (last_) ddsi_serdata_unref(last_);
    last_ = taken;
    ddsrt_iovec_t run{};
    ddsi_serdata* const held = ddsi_serdata_to_ser_ref(taken, 0, ddsi_serdata_size(taken), &run);
    const auto* begin = static_cast<const std::uint8_t*>(run.iov_base);
    Bytes bytes(begin, begin + run.iov_len);
    ddsi_serdata_to_ser_unref(held, &run);
    return bytes;
  }
  // Calls `use` with the struct; false where the bytes are none of the type. After BytesOf.
  template <class Struct, class Use>
  bool Read(Bytes bytes, const Use& use) {
    ddsrt_iovec_t run{bytes.data(), bytes.size()};
    ddsi_serdata* const data = ddsi_serdata_from_ser_iov(last_->type, SDK_DATA, 1, &run, bytes.size());
    if (data == nullptr) return false;
    Struct sample{};
    const bool good = ddsi_serdata_to_sample(data, &sample, nullptr, nullptr);
    if (good) use(sample);
    dds_sample_free(&sample, type_, DDS_FREE_CONTENTS);
    ddsi_serdata_unref(data);
    return good;
  }

 private:
  const dds_topic_descriptor_t* type_;
  Participant participant_;
  Endpoint reader_, writer_;
  ddsi_serdata* last_ = nullptr;  // knows the type
};

// TYPE of "etude::wire::TYPE"
std::string NameOf(const dds_topic_descriptor_t& type) {
  const std::string name = type.m_typename;
  return name.substr(name.rfind(':') + 1);
}

// The header says how many bytes at the end only fill it up; what they are is nobody's matter.
Bytes Unpadded(Bytes bytes) {
  const std::size_t padded = bytes.size() < 4 ? 0 : bytes[3] & 3u;
  bytes.erase(bytes.begin() + static_cast<std::ptrdiff_t>(bytes.size() - std::min(bytes.size(), padded)), bytes.end());
  return bytes;
}

struct Fixture {
  std::size_t fields = 0;
  Bytes bytes;
};

// All that are kept of a type, those of fewest fields first; with one of `fields` fields, which is written when that is
// asked for.
std::vector<Fixture> FixturesOf(const std::string& type, std::size_t fields, const Bytes& now) {
  const Path file = Path(kFixtures) / fmt::format("{}.{}.cdr", type, fields);
  if (!std::filesystem::exists(file)) {
    if (std::getenv("ETUDE_WRITE_FIXTURES") == nullptr) {
      ADD_FAILURE()
          << file << " is not there: " << type
          << " is new or has got a field. Keep its bytes with ETUDE_WRITE_FIXTURES=1, and leave the older ones";
    } else {
      EXPECT_TRUE(MakeFolders(kFixtures));
      EXPECT_TRUE(WriteFileAtomically(file, now));
    }
  }
  std::vector<Fixture> found;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(kFixtures, error)) {
    const std::string name = entry.path().filename().string();
    if (!name.starts_with(type + ".") || entry.path().extension() != ".cdr") continue;
    found.push_back({std::strtoul(name.c_str() + type.size() + 1, nullptr, 10),
                     ReadBinaryFile(entry.path(), 1 << 20).value_or(Bytes())});
  }
  std::ranges::sort(found, {}, &Fixture::fields);
  return found;
}

// What was there then is as it was written, what came later is what a message has by itself.
std::vector<std::string> Expected(const std::vector<std::string>& written, const std::vector<std::string>& unset,
                                  std::size_t fields) {
  std::vector<std::string> all(written.begin(),
                               written.begin() + static_cast<std::ptrdiff_t>(std::min(fields, written.size())));
  for (std::size_t i = all.size(); i < unset.size(); ++i) all.push_back(unset[i]);
  return all;
}

template <class Message>
std::vector<std::string> Decoded(Wire& wire, const Bytes& bytes) {
  std::vector<std::string> fields{"none of this type"};
  wire.Read<typename Traits<Message>::Wire>(bytes, [&](const auto& sample) {
    Message message;
    Decoder decoder;
    Fields(decoder, message, sample);
    fields = decoder.ok() && IsSound(message) ? List(message) : std::vector<std::string>{"out of its bounds"};
  });
  return fields;
}

template <class Message>
class StoredBytes : public testing::Test {};
TYPED_TEST_SUITE(StoredBytes, EveryMessageType);

TYPED_TEST(StoredBytes, AreReadByThisProgram) {
  using T = Traits<TypeParam>;
  Wire wire(T::descriptor(), T::kTopic, T::kQos, T::kQos);
  const auto message = MakeMessage<TypeParam>();
  const auto encoded = Encode(message);
  ASSERT_TRUE(encoded) << encoded.error().message;
  const Bytes now = wire.BytesOf(&*encoded);
  ASSERT_FALSE(now.empty());
  const auto fields = List(message), unset = List(TypeParam{});
  ASSERT_EQ(Decoded<TypeParam>(wire, now), fields);
  for (const Fixture& fixture : FixturesOf(NameOf(T::descriptor()), fields.size(), now)) {
    EXPECT_EQ(Decoded<TypeParam>(wire, fixture.bytes), Expected(fields, unset, fixture.fields)) << fixture.fields;
    if (fixture.fields == fields.size()) {
      EXPECT_EQ(Unpadded(fixture.bytes), Unpadded(now))
          << "what this program writes has changed; peers of the same wire number would see it";
    }
  }
}

// Before it counted what another host made again it ended behind control_refusal.
TEST(StoredBytesOf, AStatusOfAnOlderProgramLacksOnlyWhatCameLater) {
  using T = Traits<CampaignStatus>;
  Wire wire(T::descriptor(), T::kTopic, T::kQos, T::kQos);
  CampaignStatus status;
  status.campaign = "lab";
  status.committed = 7;
  status.control_refusal = "why";  // with its zero as long as what it is aligned to
  status.rechecked = 5;
  status.mismatched = 2;
  const auto encoded = Encode(status);
  ASSERT_TRUE(encoded);
  Bytes bytes = wire.BytesOf(&*encoded);
  // the header of four bytes, then the length of what follows: two numbers less
  constexpr std::size_t kHeader = 4;
  ASSERT_GT(bytes.size(), kHeader + 4 + 16);
  ASSERT_EQ(bytes[3] & 3, 0) << "nothing is padded";
  std::uint32_t length = 0;
  std::memcpy(&length, bytes.data() + kHeader, sizeof length);
  ASSERT_EQ(length, bytes.size() - kHeader - 4);
  length -= 16;
  std::memcpy(bytes.data() + kHeader, &length, sizeof length);
  bytes.resize(bytes.size() - 16);
  CampaignStatus expected = status;
  expected.rechecked = expected.mismatched = 0;
  EXPECT_EQ(Decoded<CampaignStatus>(wire, bytes), List(expected));
}

// ---- published blobs, whose C structs have no message ------------------------------------------------

Bytes Octets(std::span<const std::uint8_t> run) { return {run.begin(), run.end()}; }

template <class Sequence>
void Borrow(Bytes& bytes, Sequence& sequence) {
  sequence._buffer = bytes.data();
  sequence._length = sequence._maximum = static_cast<std::uint32_t>(bytes.size());
}

TEST(StoredBytesOf, APublishedManifest) {
  Wire wire(etude_wire_PublishedManifest_desc, kPublishedManifestTopic, kPublishedWriter, kPublishedReader);
  etude_wire_PublishedManifest made{};
  std::strcpy(made.channel, "latest");
  std::strcpy(made.publisher, "trainer-1");
  std::strcpy(made.owner, "00112233");
  made.slot = 1, made.version = 6500, made.size = 40'000'000, made.chunk_size = 131'072, made.chunk_count = 306;
  Bytes sha256(32, 9);
  Borrow(sha256, made.sha256);
  std::string meta = R"({"step": 6500})";
  made.meta_json = meta.data();
  const Bytes now = wire.BytesOf(&made);
  const auto found = FixturesOf("PublishedManifest", 10, now);
  for (const Fixture& fixture : found) {
    EXPECT_TRUE(wire.Read<etude_wire_PublishedManifest>(fixture.bytes, [&](const etude_wire_PublishedManifest& read) {
      EXPECT_STREQ(read.channel, made.channel);
      EXPECT_STREQ(read.publisher, made.publisher);
      EXPECT_STREQ(read.owner, made.owner);
      EXPECT_STREQ(read.meta_json, made.meta_json);
      EXPECT_EQ(read.slot, made.slot);
      EXPECT_EQ(read.version, made.version);
      EXPECT_EQ(read.size, made.size);
      EXPECT_EQ(read.chunk_size, made.chunk_size);
      EXPECT_EQ(read.chunk_count, made.chunk_count);
      EXPECT_EQ(Octets({read.sha256._buffer, read.sha256._length}), sha256);
    }));
  }
}

TEST(StoredBytesOf, APublishedChunk) {
  Wire wire(etude_wire_PublishedChunk_desc, kPublishedChunkTopic, kPublishedWriter, kPublishedReader);
  etude_wire_PublishedChunk made{};
  std::strcpy(made.channel, "best");
  std::strcpy(made.publisher, "trainer-1");
  made.slot = 1, made.version = 6500, made.size = 40'000'000, made.chunk_size = 131'072, made.index = 17;
  Bytes data = MakeBytes(100, 3);
  Borrow(data, made.data);
  const Bytes now = wire.BytesOf(&made);
  for (const Fixture& fixture : FixturesOf("PublishedChunk", 8, now)) {
    EXPECT_TRUE(wire.Read<etude_wire_PublishedChunk>(fixture.bytes, [&](const etude_wire_PublishedChunk& read) {
      EXPECT_STREQ(read.channel, made.channel);
      EXPECT_STREQ(read.publisher, made.publisher);
      EXPECT_EQ(read.slot, made.slot);
      EXPECT_EQ(read.version, made.version);
      EXPECT_EQ(read.size, made.size);
      EXPECT_EQ(read.chunk_size, made.chunk_size);
      EXPECT_EQ(read.index, made.index);
      EXPECT_EQ(Octets({read.data._buffer, read.data._length}), data);
    }));
  }
}

}  // namespace stored_bytes_test
}  // namespace etude::bus
