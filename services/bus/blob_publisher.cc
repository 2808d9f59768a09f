// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <map>

#include "services/bus/assembly.h"
#include "services/bus/blob_transfer.h"
#include "services/bus/typed.h"
#include "services/core/clock.h"
#include "services/core/hash.h"
#include "services/core/stop.h"

namespace etude::bus {
namespace {

// A subscriber that hangs is dropped by DDS after its lease (10 s); until then writing waits for it.
constexpr double kGiveUpAfterS = 30;

struct Channel {
  std::uint64_t version = 0;
  bool published = false;
  std::uint8_t slot = 1;             // of the newest version
  std::uint32_t chunks[2] = {0, 0};  // written in each slot
};

}  // namespace

struct BlobPublisher::Impl {
  Owner owner;
  SendOptions options;
  std::string name = UniquePeerName();
  Endpoint manifests;
  Endpoint chunks;
  std::map<std::string, Channel> channels;

  Status WriteChunks(const std::string& channel, std::uint64_t version, std::uint8_t slot,
                     std::span<const std::uint8_t> bytes, Sha256& hash);
  Status WriteManifest(const std::string& channel, std::uint64_t version, std::uint8_t slot, std::uint64_t size,
                       const Sha256Digest& digest, const std::string& meta_json);
  void DropChunks(const std::string& channel, std::uint8_t slot, std::uint32_t begin, std::uint32_t end);
};

namespace {

// Writes, and waits for slow subscribers for as long as allowed.
template <class Wire>
Status WritePatiently(const Endpoint& writer, const Wire& wire, std::uint64_t bytes, std::string_view what) {
  const Stopwatch watch;
  for (;;) {
    const dds_return_t code = dds_write(writer.get(), &wire);
    if (code == DDS_RETCODE_OK) {
      writer.traffic->Add(bytes);
      return {};
    }
    if (code != DDS_RETCODE_TIMEOUT || watch.Seconds() > kGiveUpAfterS || StopRequested()) {
      return Fail(DdsError(code, what));
    }
  }
}

etude_wire_PublishedChunk MakeChunk(const std::string& channel, const std::string& publisher, std::uint8_t slot,
                                    std::uint32_t index) {
  etude_wire_PublishedChunk wire{};
  Encoder encode;
  encode("channel", channel, wire.channel);
  encode("publisher", publisher, wire.publisher);
  wire.slot = slot;
  wire.index = index;
  return wire;
}

}  // namespace

Status BlobPublisher::Impl::WriteChunks(const std::string& channel, std::uint64_t version, std::uint8_t slot,
                                        std::span<const std::uint8_t> bytes, Sha256& hash) {
  const std::uint32_t count = ChunkCount(bytes.size(), options.chunk_size);
  for (std::uint32_t index = 0; index < count; ++index) {
    const auto data = ChunkOf(bytes, options.chunk_size, index);
    auto wire = MakeChunk(channel, name, slot, index);
    wire.version = version;
    wire.size = bytes.size();
    wire.chunk_size = options.chunk_size;
    wire.data._maximum = wire.data._length = static_cast<std::uint32_t>(data.size());
    wire.data._buffer = const_cast<std::uint8_t*>(data.data());
    ETUDE_RETURN_IF_ERROR(WritePatiently(chunks, wire, data.size(),
                                         fmt::format("publish chunk {} of {} on channel '{}'", index, count, channel)));
    hash.Update(data);  // while the subscribers are already at work on it
  }
  return {};
}

Status BlobPublisher::Impl::WriteManifest(const std::string& channel, std::uint64_t version, std::uint8_t slot,
                                          std::uint64_t size, const Sha256Digest& digest,
                                          const std::string& meta_json) {
  etude_wire_PublishedManifest wire{};
  Encoder encode;
  encode("channel", channel, wire.channel);
  encode("publisher", name, wire.publisher);
  encode("owner", owner.id, wire.owner);
  wire.slot = slot;
  wire.version = version;
  wire.size = size;
  wire.chunk_size = options.chunk_size;
  wire.chunk_count = ChunkCount(size, options.chunk_size);
  wire.sha256._maximum = wire.sha256._length = static_cast<std::uint32_t>(digest.size());
  wire.sha256._buffer = const_cast<std::uint8_t*>(digest.data());
  encode("meta_json", meta_json, wire.meta_json);
  return WritePatiently(manifests, wire, sizeof wire + meta_json.size(),
                        fmt::format("publish on channel '{}'", channel));
}

// Chunks of a longer version that was in this slot before: the bus need not keep them.
void BlobPublisher::Impl::DropChunks(const std::string& channel, std::uint8_t slot, std::uint32_t begin,
                                     std::uint32_t end) {
  for (std::uint32_t index = begin; index < end; ++index) {
    const auto wire = MakeChunk(channel, name, slot, index);
    dds_dispose(chunks.get(), &wire);
  }
}

BlobPublisher::BlobPublisher(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
BlobPublisher::BlobPublisher(BlobPublisher&&) noexcept = default;
BlobPublisher& BlobPublisher::operator=(BlobPublisher&&) noexcept = default;
BlobPublisher::~BlobPublisher() = default;

Result<BlobPublisher> BlobPublisher::Open(const Participant& participant, const Owner& owner,
                                          const SendOptions& options) {
  return OpenIn(participant, owner, owner.partition(), options);
}

Result<BlobPublisher> BlobPublisher::OpenRelay(const Participant& participant, const Owner& owner,
                                               const SendOptions& options) {
  return OpenIn(participant, owner, owner.relay_partition(), options);
}

Result<BlobPublisher> BlobPublisher::OpenIn(const Participant& participant, const Owner& owner,
                                            const std::string& partition, const SendOptions& options) {
  if (options.chunk_size == 0 || options.chunk_size > kMaxChunkSize) {
    return Fail(Code::kInvalidArgument,
                fmt::format("blob publisher: chunk_size {} (1 to {})", options.chunk_size, kMaxChunkSize));
  }
  auto impl = std::make_unique<Impl>();
  impl->owner = owner;
  impl->options = options;
  ETUDE_ASSIGN_OR_RETURN(impl->manifests, OpenWriter(participant, partition, etude_wire_PublishedManifest_desc,
                                                     kPublishedManifestTopic, kPublishedWriter));
  ETUDE_ASSIGN_OR_RETURN(impl->chunks, OpenWriter(participant, partition, etude_wire_PublishedChunk_desc,
                                                  kPublishedChunkTopic, kPublishedWriter));
  return BlobPublisher(std::move(impl));
}

Status BlobPublisher::Publish(const std::string& channel, std::uint64_t version, std::span<const std::uint8_t> bytes,
                              const std::string& meta_json) {
  etude_wire_PublishedManifest trial{};
  Encoder encode;
  encode("channel", channel, trial.channel);
  encode("meta_json", meta_json, trial.meta_json);
  encode("owner", impl_->owner.id, trial.owner);
  Channel& state = impl_->channels[channel];
  std::string problem = encode.problem();
  if (state.published && version <= state.version) {
    problem = fmt::format("it must be greater than {}", state.version);
  }
  if (!problem.empty()) {
    return Fail(Code::kInvalidArgument,
                fmt::format("publish version {} on channel '{}': {}", version, channel, problem));
  }
  // the slot that does not hold the newest complete version
  const auto slot = static_cast<std::uint8_t>(1 - state.slot);
  const std::uint32_t count = ChunkCount(bytes.size(), impl_->options.chunk_size);
  const std::uint32_t before = std::exchange(state.chunks[slot], std::max(state.chunks[slot], count));
  Sha256 hash;
  ETUDE_RETURN_IF_ERROR(impl_->WriteChunks(channel, version, slot, bytes, hash));
  ETUDE_RETURN_IF_ERROR(impl_->WriteManifest(channel, version, slot, bytes.size(), hash.Finish(), meta_json));
  impl_->DropChunks(channel, slot, count, before);
  state.chunks[slot] = count;
  state.slot = slot;
  state.version = version;
  state.published = true;
  return {};
}

bool BlobPublisher::AwaitTaken(std::chrono::nanoseconds timeout) {
  const auto end = MonotonicClock::now() + timeout;
  for (const Endpoint* writer : {&impl_->chunks, &impl_->manifests}) {
    const auto left = std::max<std::chrono::nanoseconds>(end - MonotonicClock::now(), std::chrono::nanoseconds(0));
    if (dds_wait_for_acks(writer->get(), left.count()) != DDS_RETCODE_OK) return false;
  }
  return true;
}

int BlobPublisher::matched_subscribers() const { return MatchedReaders(impl_->manifests); }

}  // namespace etude::bus
