// SPDX-License-Identifier: Apache-2.0
// A program of this version understands what programs of its wire number have put on the bus since that number is in use:
// tests/data/wire_N keeps the bytes of a message of each kind, as DDS carried them, and what they mean. A change that makes
// one of them unreadable needs another wire number (services/bus/messages.h), and another folder:
//   ETUDE_KEEP_WIRE_BYTES=1 build/tests/wire_bytes_test      writes what is not kept yet, and nothing else
#include <dds/dds.h>
#include <dds/ddsi/ddsi_serdata.h>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <nlohmann/json.hpp>

#include "services/bus/topic.h"
#include "services/bus/topology.h"
#include "services/bus/typed.h"
#include "services/core/file.h"
#include "tests/support/matchers.h"

namespace etude::bus {
namespace {

using namespace std::chrono_literals;
using Json = nlohmann::ordered_json;

constexpr std::uint32_t kDomain = 102;

// ---- a message whose fields are told apart -----------------------------------------------------------

class Filler {
 public:
  template <class W>
  void operator()(const char* name, std::string& value, const W&) {
    value = std::string(name).substr(0, 15);
  }
  template <class T, class W>
  requires std::is_arithmetic_v<T>
  void operator()(const char*, T& value, const W&) {
    if constexpr (std::is_same_v<T, bool>)
      value = true;
    else
      value = static_cast<T>(++count_);
  }
  template <class E, class W>
  requires std::is_enum_v<E>
  void operator()(const char*, E& value, const W&, E last) { value = last; }
  template <class T, class W>
  void operator()(const char*, std::vector<T>& value, const W&, std::size_t bound) {
    for (std::size_t i = 0; i < std::min<std::size_t>(bound, 3); ++i) value.push_back(static_cast<T>(++count_));
  }

 private:
  int count_ = 0;
};

template <class Message>
void MakeSound(Message&) {}
void MakeSound(Observation& observation) {
  observation.width = observation.height = 1;
  observation.image = {1, 2, 3};
}
void MakeSound(BlobManifest& manifest) {
  manifest.size = 3;
  manifest.chunk_size = 3;
  manifest.chunk_count = 1;
  manifest.data = {1, 2, 3};
  manifest.sha256.assign(32, 7);
}

template <class Message>
Message Example() {
  Message message;
  const typename Traits<Message>::Wire wire{};
  Filler filler;
  Fields(filler, message, wire);
  MakeSound(message);
  return message;
}

class FieldsOf {
 public:
  template <class Message>
  static Json Of(const Message& message) {
    FieldsOf fields;
    const typename Traits<Message>::Wire wire{};
    Fields(fields, message, wire);
    return std::move(fields.json_);
  }
  template <class T, class W>
  void operator()(const char* name, const T& value, const W&) {
    json_[name] = value;
  }
  template <class E, class W>
  requires std::is_enum_v<E>
  void operator()(const char* name, const E& value, const W&, E) { json_[name] = static_cast<int>(value); }
  template <class T, class W>
  void operator()(const char* name, const std::vector<T>& value, const W&, std::size_t) {
    json_[name] = value;
  }

 private:
  Json json_ = Json::object();
};

// ---- bytes ---------------------------------------------------------------------------------------------

using Bytes = std::vector<std::uint8_t>;

std::string ToHexText(const Bytes& bytes) {
  std::string text;
  for (const std::uint8_t byte : bytes) text += fmt::format("{:02x}", byte);
  return text;
}

Bytes FromHexText(const std::string& text) {
  Bytes bytes;
  for (std::size_t i = 0; i + 1 < text.size(); i += 2)
    bytes.push_back(static_cast<std::uint8_t>(std::stoul(text.substr(i, 2), nullptr, 16)));
  return bytes;
}

// A kind of message as DDS serialises it: its type is that of a sample which went over the bus.
template <class Message>
class Kind {
 public:
  explicit Kind(const Participant& participant) {
    const std::string partition = "wire-bytes";
    auto reader = OpenReaderOf<Message>(participant, partition);
    auto writer = Writer<Message>::Open(participant, partition);
    Waiter waiter;
    const bool works = reader && writer && waiter.Open(participant) && waiter.AddReader(*reader) &&
                       writer->WaitForReaders(1, 10s) && writer->Write(Example<Message>()) && waiter.Wait(10s);
    dds_sample_info_t info;
    if (works && dds_takecdr(reader->get(), &sample_, 1, &info, DDS_ANY_STATE) != 1) sample_ = nullptr;
  }
  ~Kind() {
    if (sample_ != nullptr) ddsi_serdata_unref(sample_);
  }
  Kind(const Kind&) = delete;
  Kind& operator=(const Kind&) = delete;

  bool works() const { return sample_ != nullptr; }
  Bytes ExampleBytes() const {
    ddsrt_iovec_t part{};
    ddsi_serdata* const held = ddsi_serdata_to_ser_ref(sample_, 0, ddsi_serdata_size(sample_), &part);
    const auto* begin = static_cast<const std::uint8_t*>(part.iov_base);
    const Bytes bytes(begin, begin + part.iov_len);
    ddsi_serdata_to_ser_unref(held, &part);
    return bytes;
  }

  // As a reader decodes what comes from the network; nothing when it would drop it.
  std::optional<Message> Decode(Bytes bytes) const {
    const ddsrt_iovec_t part{bytes.data(), bytes.size()};
    ddsi_serdata* const data = ddsi_serdata_from_ser_iov(sample_->type, SDK_DATA, 1, &part, bytes.size());
    if (data == nullptr) return std::nullopt;
    typename Traits<Message>::Wire wire{};
    const bool fits = ddsi_serdata_to_sample(data, &wire, nullptr, nullptr);
    ddsi_serdata_unref(data);
    Message message;
    Decoder decoder;
    if (fits) Fields(decoder, message, wire);
    const bool is_good = fits && decoder.ok() && IsSound(message);
    dds_sample_free(&wire, &Traits<Message>::descriptor(), DDS_FREE_CONTENTS);
    return is_good ? std::optional<Message>(std::move(message)) : std::nullopt;
  }

 private:
  ddsi_serdata* sample_ = nullptr;
};

Path FileOf(const std::string& topic) {
  std::string name = topic.substr(std::strlen("etude/"));
  std::ranges::replace(name, '/', '.');
  return Path("tests/data") / fmt::format("wire_{}", kWireVersion) / (name + ".json");
}

// Whether all that was kept is there again; what has been appended since is not in it.
void ExpectKept(const Json& kept, const Json& decoded, const std::string& topic) {
  for (const auto& [field, value] : kept.items()) {
    ASSERT_TRUE(decoded.contains(field)) << topic << ": the field " << field << " is gone";
    EXPECT_EQ(decoded[field], value) << topic << ": " << field;
  }
}

// What a later version of the wire number may do: append fields. Samples of appendable types begin with their length.
Bytes WithAnotherField(Bytes bytes) {
  constexpr std::size_t kHeader = 4;
  // the last two bits of the header say how many bytes at the end are padding
  const std::size_t padding = bytes[3] & 3u;
  bytes.resize(bytes.size() - padding);
  bytes[3] &= static_cast<std::uint8_t>(~3u);
  while (bytes.size() % 4 != 0) bytes.push_back(0);
  for (const std::uint8_t byte : {1, 2, 3, 4, 5, 6, 7, 8}) bytes.push_back(byte);
  const auto length = static_cast<std::uint32_t>(bytes.size() - kHeader - sizeof(std::uint32_t));
  std::memcpy(bytes.data() + kHeader, &length, sizeof length);
  return bytes;
}

template <class Message>
class WireBytes : public ::testing::Test {
 protected:
  static const Participant& Bus() {
    static const auto* const participant = new Participant(std::move(*Participant::Open({kDomain, ""})));
    return *participant;
  }
  const std::string topic_ = Traits<Message>::kTopic;
  const Kind<Message> kind_{Bus()};
};

using Messages =
    ::testing::Types<Presence, CampaignAnnouncement, WorkRequest, Lease, WorkerStatus, AttemptReport, ValidationErrors,
                     CampaignStatus, CampaignControl, BlobManifest, BlobChunk, BlobAck, Observation, Action, InsightWish,
                     Insight, PolicyStatus, ProcessStatus, ProcessEvent, TrainStatus>;
TYPED_TEST_SUITE(WireBytes, Messages);

TYPED_TEST(WireBytes, OfThisWireNumberAreUnderstood) {
  ASSERT_TRUE(this->kind_.works());
  const Path file = FileOf(this->topic_);
  if (std::getenv("ETUDE_KEEP_WIRE_BYTES") != nullptr && !std::filesystem::exists(file)) {
    const Json kept{{"topic", this->topic_},
                    {"wire", kWireVersion},
                    {"bytes", ToHexText(this->kind_.ExampleBytes())},
                    {"fields", FieldsOf::Of(Example<TypeParam>())}};
    ASSERT_THAT(MakeFolders(file.parent_path()), IsOk());
    ASSERT_THAT(WriteFileAtomically(file, kept.dump(1) + "\n"), IsOk());
  }
  const auto text = ReadTextFile(file);
  ASSERT_THAT(text, IsOk()) << "no bytes are kept of this message: see the head of this test";
  const Json kept = Json::parse(*text);
  const auto decoded = this->kind_.Decode(FromHexText(kept["bytes"]));
  ASSERT_TRUE(decoded) << this->topic_ << ": bytes of wire number " << kWireVersion << " are not understood any more";
  ExpectKept(kept["fields"], FieldsOf::Of(*decoded), this->topic_);
}

TYPED_TEST(WireBytes, OfAMinorReleaseThatAppendsAFieldAreUnderstood) {
  ASSERT_TRUE(this->kind_.works());
  const Json kept = Json::parse(ReadTextFile(FileOf(this->topic_)).value_or("{}"));
  ASSERT_TRUE(kept.contains("bytes"));
  const auto decoded = this->kind_.Decode(WithAnotherField(FromHexText(kept["bytes"])));
  ASSERT_TRUE(decoded) << this->topic_ << ": would have to become appendable";
  ExpectKept(kept["fields"], FieldsOf::Of(*decoded), this->topic_);
}

TYPED_TEST(WireBytes, CutShortAreRefused) {
  ASSERT_TRUE(this->kind_.works());
  Bytes bytes = FromHexText(Json::parse(ReadTextFile(FileOf(this->topic_)).value_or("{}")).value("bytes", ""));
  ASSERT_GT(bytes.size(), 16u);
  bytes.resize(bytes.size() / 8 * 4);
  EXPECT_FALSE(this->kind_.Decode(bytes));
}

TEST(WireBytesKept, AreThereForEveryTopic) {
  for (const auto& topic : KnownTopics()) EXPECT_TRUE(std::filesystem::exists(FileOf(topic))) << topic;
}

}  // namespace
}  // namespace etude::bus
