// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <tuple>

#include "services/bus/assembly.h"
#include "services/bus/blob_transfer.h"
#include "services/bus/serialized.h"
#include "services/bus/typed.h"
#include "services/core/clock.h"
#include "services/core/log.h"
#include "services/core/stop.h"

namespace etude::bus {
namespace {

using Clock = MonotonicClock;

struct SlotKey {
  std::string channel;
  std::string publisher;
  std::uint8_t slot = 0;
  auto operator<=>(const SlotKey&) const = default;
};

struct PublishedInfo {
  std::uint64_t version = 0;
  std::uint64_t size = 0;
  std::uint32_t chunk_size = 0;
  std::vector<std::uint8_t> sha256;
  std::string owner;
  std::string meta_json;
};

// One of the two versions that a publisher keeps of a channel.
struct Slot {
  std::optional<Assembly> assembly;  // of `version`; empty once finished, refused or dropped
  std::optional<std::uint64_t> version;
  Clock::time_point heard;
  std::optional<PublishedInfo> info;  // may be of another version for a while
};

}  // namespace

struct BlobSubscriber::Impl {
  Owner owner;
  std::string channel;
  ReceiveOptions options;
  Endpoint manifests;
  Endpoint chunks;
  Waiter waiter;
  std::map<SlotKey, Slot> slots;
  std::map<std::string, std::uint64_t, std::less<>> returned;  // newest version of each channel
  std::map<std::string, PublishedBlob> ready;
  std::uint64_t memory = 0;
  std::uint64_t corrupt = 0;
  std::uint64_t malformed = 0;

  int Drain();
  int DrainManifests();
  void OnManifest(const etude_wire_PublishedManifest& wire);
  void OnChunk(const PublishedChunkView& view);
  bool Start(Slot& slot, std::uint64_t version, std::uint64_t size, std::uint32_t chunk_size);
  void MakeRoom(std::uint64_t size);
  void Finish(const SlotKey& key, Slot& slot);
  void DropSuperseded(const std::string& name);
  void Clear(Slot& slot);
  bool IsNews(std::string_view name, std::uint64_t version) const;
  bool Accept(const PublishedBlob& blob) const;
  bool Wanted(std::string_view name) const { return channel.empty() || name == channel; }
};

bool BlobSubscriber::Impl::IsNews(std::string_view name, std::uint64_t version) const {
  const auto newest = returned.find(name);
  return newest == returned.end() || version > newest->second;
}

void BlobSubscriber::Impl::Clear(Slot& slot) {
  if (slot.assembly) memory -= slot.assembly->size();
  slot.assembly.reset();
}

int BlobSubscriber::Impl::DrainManifests() {
  constexpr int kBatch = 16;
  void* samples[kBatch] = {};
  dds_sample_info_t infos[kBatch];
  const dds_return_t count = dds_take(manifests.get(), samples, infos, kBatch, kBatch);
  for (int i = 0; i < count; ++i) {
    if (!infos[i].valid_data) continue;
    manifests.traffic->Add(sizeof(etude_wire_PublishedManifest));
    OnManifest(*static_cast<etude_wire_PublishedManifest*>(samples[i]));
  }
  if (count > 0) dds_return_loan(manifests.get(), samples, count);
  return std::max(count, 0);
}

int BlobSubscriber::Impl::Drain() {
  const int taken = TakeSerialized(chunks, 64, [this](std::span<const std::uint8_t> cdr) {
    PublishedChunkView view;
    if (!Parse(cdr, view) || view.slot > 1 || view.data.empty())
      ++malformed;
    else
      OnChunk(view);
  });
  return taken + DrainManifests();
}

void BlobSubscriber::Impl::OnManifest(const etude_wire_PublishedManifest& wire) {
  PublishedInfo info;
  SlotKey key;
  Decoder decode;
  decode("channel", key.channel, wire.channel);
  decode("publisher", key.publisher, wire.publisher);
  decode("owner", info.owner, wire.owner);
  decode("meta_json", info.meta_json, wire.meta_json);
  decode("sha256", info.sha256, wire.sha256, 32);
  if (!decode.ok() || info.sha256.size() != 32 || wire.slot > 1 ||
      !ShapeIsSound(wire.size, wire.chunk_size, wire.chunk_count)) {
    ++malformed;
    return;
  }
  if (!Wanted(key.channel) || info.owner != owner.id || !IsNews(key.channel, wire.version)) return;
  key.slot = wire.slot;
  info.version = wire.version;
  info.size = wire.size;
  info.chunk_size = wire.chunk_size;
  Slot& slot = slots[key];
  if (slot.info && slot.info->version > info.version) return;
  const bool is_newer = !slot.version || *slot.version < info.version;
  if (wire.size == 0 && is_newer && !Start(slot, info.version, 0, info.chunk_size)) return;
  slot.info = std::move(info);
  Finish(key, slot);
}

// False when the blob may not be taken.
bool BlobSubscriber::Impl::Start(Slot& slot, std::uint64_t version, std::uint64_t size, std::uint32_t chunk_size) {
  Clear(slot);
  slot.version = version;
  if (!ShapeIsSound(size, chunk_size, chunk_size > 0 ? ChunkCount(size, chunk_size) : 0)) {
    ++malformed;
    return false;
  }
  if (size > options.max_blob_size || size > options.max_memory) {
    Log().warn("published blob refused: too large version={} bytes={} most={}", version, size,
               std::min(options.max_blob_size, options.max_memory));
    return false;
  }
  MakeRoom(size);
  slot.heard = Clock::now();
  slot.assembly.emplace(size, chunk_size);
  memory += size;
  return true;
}

// Gives up the versions that have not moved for the longest time, such as those of a dead publisher.
void BlobSubscriber::Impl::MakeRoom(std::uint64_t size) {
  while (memory > 0 && memory + size > options.max_memory) {
    Slot* stalest = nullptr;
    for (auto& [key, slot] : slots) {
      const bool is_staler = stalest == nullptr || slot.heard < stalest->heard;
      if (slot.assembly && slot.assembly->size() > 0 && is_staler) stalest = &slot;
    }
    Clear(*stalest);
  }
}

void BlobSubscriber::Impl::OnChunk(const PublishedChunkView& view) {
  if (!Wanted(view.channel) || !IsNews(view.channel, view.version)) return;
  const SlotKey key{std::string(view.channel), std::string(view.publisher), view.slot};
  Slot& slot = slots[key];
  const bool is_newer = !slot.version || *slot.version < view.version;
  if (is_newer && !Start(slot, view.version, view.size, view.chunk_size)) return;
  if (!slot.assembly || *slot.version != view.version) return;
  slot.heard = Clock::now();
  if (slot.assembly->size() != view.size || slot.assembly->chunk_size() != view.chunk_size ||
      slot.assembly->Add(view.index, view.data) == Assembly::Added::kMalformed) {
    ++malformed;
    return;
  }
  Finish(key, slot);
}

// Verifies the version when all of it is there.
void BlobSubscriber::Impl::Finish(const SlotKey& key, Slot& slot) {
  if (!slot.assembly || !slot.assembly->complete() || !slot.info) return;
  if (slot.info->version != *slot.version) return;
  const auto digest = slot.assembly->Digest();
  bool fits =
      slot.info->size == slot.assembly->size() && std::equal(digest.begin(), digest.end(), slot.info->sha256.begin());
  if (fits) {
    PublishedBlob blob{key.channel,          *slot.version, slot.info->owner,
                       slot.info->meta_json, ToHex(digest), slot.assembly->TakeBytes()};
    fits = Accept(blob);
    if (fits) {
      returned[key.channel] = blob.version;
      ready[key.channel] = std::move(blob);
    }
  } else {
    ++corrupt;
    Log().warn("published blob dropped: its bytes do not fit its checksum channel={} version={}", key.channel,
               *slot.version);
  }
  Clear(slot);
  slot.info.reset();
  if (fits) DropSuperseded(key.channel);
}

bool BlobSubscriber::Impl::Accept(const PublishedBlob& blob) const {
  if (!options.accept) return true;
  const Status judged = options.accept(blob);
  if (!judged)
    Log().warn("published blob refused channel={} version={}: {}", blob.channel, blob.version, judged.error().message);
  return judged.has_value();
}

void BlobSubscriber::Impl::DropSuperseded(const std::string& name) {
  for (auto& [key, slot] : slots) {
    if (key.channel == name && slot.version && !IsNews(name, *slot.version)) Clear(slot);
  }
}

std::function<Status(const PublishedBlob&)> AcceptSigned(std::shared_ptr<security::CheckpointVerifier> verifier) {
  if (!verifier) return {};
  return [verifier = std::move(verifier)](const PublishedBlob& blob) {
    return verifier->Check({blob.owner, blob.channel, blob.version, blob.sha256}, blob.meta_json);
  };
}

BlobSubscriber::BlobSubscriber(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
BlobSubscriber::BlobSubscriber(BlobSubscriber&&) noexcept = default;
BlobSubscriber& BlobSubscriber::operator=(BlobSubscriber&&) noexcept = default;
BlobSubscriber::~BlobSubscriber() = default;

Result<BlobSubscriber> BlobSubscriber::Open(const Participant& participant, const Owner& owner,
                                            const std::string& channel, const ReceiveOptions& options) {
  auto impl = std::make_unique<Impl>();
  impl->owner = owner;
  impl->channel = channel;
  impl->options = options;
  const std::string partition = owner.partition();
  ETUDE_ASSIGN_OR_RETURN(impl->chunks, OpenReader(participant, partition, etude_wire_PublishedChunk_desc,
                                                  kPublishedChunkTopic, kPublishedReader));
  ETUDE_ASSIGN_OR_RETURN(impl->manifests, OpenReader(participant, partition, etude_wire_PublishedManifest_desc,
                                                     kPublishedManifestTopic, kPublishedReader));
  ETUDE_RETURN_IF_ERROR(impl->waiter.Open(participant));
  ETUDE_RETURN_IF_ERROR(impl->waiter.AddReader(impl->chunks));
  ETUDE_RETURN_IF_ERROR(impl->waiter.AddReader(impl->manifests));
  return BlobSubscriber(std::move(impl));
}

std::optional<PublishedBlob> BlobSubscriber::Wait(std::chrono::nanoseconds timeout) {
  const auto now = Clock::now();
  const auto latest = Clock::time_point::max();
  const auto end = timeout > latest - now ? latest : now + timeout;
  for (;;) {
    while (impl_->Drain() > 0) {
    }
    if (!impl_->ready.empty()) {
      auto first = impl_->ready.extract(impl_->ready.begin());
      return std::move(first.mapped());
    }
    const auto left = end - Clock::now();
    if (left.count() <= 0 || StopRequested()) return std::nullopt;
    impl_->waiter.Wait(left);
  }
}

std::uint64_t BlobSubscriber::corrupt_blobs() const { return impl_->corrupt; }

}  // namespace etude::bus
