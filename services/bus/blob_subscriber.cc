// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <tuple>
#include <utility>

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

// Of every channel a publisher has two, and a restarted one is another publisher.
constexpr std::size_t kMostSlots = 256;
constexpr std::chrono::seconds kJudgeAgain{1};

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

  std::uint64_t memory() const { return (assembly ? assembly->size() : 0) + (info ? info->meta_json.size() : 0); }
  // `version` stays: the rest of its chunks begins nothing
  void Clear() {
    assembly.reset();
    info.reset();
  }
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
  std::map<std::string, PublishedBlob> ready, undecided;       // by channel; undecided: `accept` could not judge it yet
  std::map<std::string, std::uint64_t> told;                   // newest undecided version that was logged, by channel
  Clock::time_point judge_again = {};                          // of the undecided
  std::map<dds_instance_handle_t, std::pair<std::string, std::uint64_t>> offered;  // channel, version; of who is there
  std::uint64_t corrupt = 0;
  std::uint64_t malformed = 0;

  int Drain();
  int DrainManifests();
  void OnManifest(const etude_wire_PublishedManifest& wire, dds_instance_handle_t instance);
  void OnChunk(const PublishedChunkView& view);
  bool Start(Slot& slot, std::uint64_t version, std::uint64_t size, std::uint32_t chunk_size);
  Slot& SlotOf(const SlotKey& key);
  std::uint64_t ReadyBytes() const;
  bool ReadyIsFull() const { return !ready.empty() && ReadyBytes() >= options.max_memory; }
  std::uint64_t Memory() const;
  void MakeRoom(std::uint64_t size, const Slot& for_slot);
  void Finish(const SlotKey& key, Slot& slot);
  void DropSuperseded(const std::string& name);
  bool IsNews(std::string_view name, std::uint64_t version) const;
  void Judge(PublishedBlob blob);
  void JudgeUndecided();
  bool Wanted(std::string_view name) const { return channel.empty() || name == channel; }
};

bool BlobSubscriber::Impl::IsNews(std::string_view name, std::uint64_t version) const {
  const auto newest = returned.find(name);
  return newest == returned.end() || version > newest->second;
}

// Of what is verified.
std::uint64_t BlobSubscriber::Impl::ReadyBytes() const {
  std::uint64_t sum = 0;
  for (const auto* blobs : {&ready, &undecided})
    for (const auto& [name, blob] : *blobs) sum += blob.bytes.size() + blob.meta_json.size();
  return sum;
}

// Of all that is held, bytes.
std::uint64_t BlobSubscriber::Impl::Memory() const {
  std::uint64_t sum = ReadyBytes();
  for (const auto& [key, slot] : slots) sum += slot.memory();
  return sum;
}

// In the place of the one that was not heard of for the longest time, when there are too many.
Slot& BlobSubscriber::Impl::SlotOf(const SlotKey& key) {
  if (slots.size() >= kMostSlots && !slots.contains(key))
    slots.erase(std::ranges::min_element(slots, {}, [](const auto& item) { return item.second.heard; }));
  Slot& slot = slots[key];
  slot.heard = Clock::now();
  return slot;
}

int BlobSubscriber::Impl::DrainManifests() {
  constexpr int kBatch = 16;
  void* samples[kBatch] = {};
  dds_sample_info_t infos[kBatch];
  const dds_return_t count = dds_take(manifests.get(), samples, infos, kBatch, kBatch);
  for (int i = 0; i < count; ++i) {
    const dds_instance_handle_t instance = infos[i].instance_handle;
    if (infos[i].valid_data) {
      manifests.traffic->Add(sizeof(etude_wire_PublishedManifest));
      OnManifest(*static_cast<etude_wire_PublishedManifest*>(samples[i]), instance);
    }
    // also of one that ended before what it wrote was taken
    if (infos[i].instance_state != DDS_IST_ALIVE) offered.erase(instance);
  }
  if (count > 0) dds_return_loan(manifests.get(), samples, count);
  return std::max(count, 0);
}

int BlobSubscriber::Impl::Drain() {
  const int taken = TakeSerialized(chunks, 64, [this](std::span<const std::uint8_t> cdr) {
    PublishedChunkView view;
    if (!Parse(cdr, view) || view.slot > 1 || view.data.empty())
      TellMalformed(kPublishedChunkTopic, ++malformed);
    else
      OnChunk(view);
  });
  return taken + DrainManifests();
}

void BlobSubscriber::Impl::OnManifest(const etude_wire_PublishedManifest& wire, dds_instance_handle_t instance) {
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
    TellMalformed(kPublishedManifestTopic, ++malformed);
    return;
  }
  if (!Wanted(key.channel) || info.owner != owner.id) return;
  if (offered.size() < kMostSlots || offered.contains(instance)) offered[instance] = {key.channel, wire.version};
  if (!IsNews(key.channel, wire.version)) return;
  key.slot = wire.slot;
  info.version = wire.version;
  info.size = wire.size;
  info.chunk_size = wire.chunk_size;
  Slot& slot = SlotOf(key);
  if (slot.info && slot.info->version > info.version) return;
  const bool is_newer = !slot.version || *slot.version < info.version;
  if (wire.size == 0 && is_newer && !Start(slot, info.version, 0, info.chunk_size)) return;
  slot.info.reset();
  MakeRoom(info.meta_json.size(), slot);
  slot.info = std::move(info);
  Finish(key, slot);
}

// False when the blob may not be taken.
bool BlobSubscriber::Impl::Start(Slot& slot, std::uint64_t version, std::uint64_t size, std::uint32_t chunk_size) {
  slot.assembly.reset();
  slot.version = version;
  if (!ShapeIsSound(size, chunk_size, chunk_size > 0 ? ChunkCount(size, chunk_size) : 0)) {
    TellMalformed(kPublishedChunkTopic, ++malformed);
    return false;
  }
  if (size > options.max_blob_size || size > options.max_memory) {
    Log().warn("published blob refused: too large version={} bytes={} most={}", version, size,
               std::min(options.max_blob_size, options.max_memory));
    return false;
  }
  MakeRoom(size, slot);
  slot.assembly.emplace(size, chunk_size);
  return true;
}

// Gives up the versions that have not moved for the longest time, such as those of a dead publisher. What is verified
// already stays: Wait takes no more from the bus while that alone fills the memory.
void BlobSubscriber::Impl::MakeRoom(std::uint64_t size, const Slot& for_slot) {
  while (Memory() + size > options.max_memory) {
    Slot* stalest = nullptr;
    for (auto& [key, slot] : slots) {
      const bool is_staler = stalest == nullptr || slot.heard < stalest->heard;
      if (&slot != &for_slot && slot.memory() > 0 && is_staler) stalest = &slot;
    }
    if (stalest == nullptr) return;
    stalest->Clear();
  }
}

void BlobSubscriber::Impl::OnChunk(const PublishedChunkView& view) {
  if (!Wanted(view.channel) || !IsNews(view.channel, view.version)) return;
  const SlotKey key{std::string(view.channel), std::string(view.publisher), view.slot};
  Slot& slot = SlotOf(key);
  const bool is_newer = !slot.version || *slot.version < view.version;
  if (is_newer && !Start(slot, view.version, view.size, view.chunk_size)) return;
  if (!slot.assembly || *slot.version != view.version) return;
  if (slot.assembly->size() != view.size || slot.assembly->chunk_size() != view.chunk_size ||
      slot.assembly->Add(view.index, view.data) == Assembly::Added::kMalformed) {
    TellMalformed(kPublishedChunkTopic, ++malformed);
    return;
  }
  Finish(key, slot);
}

// Verifies the version when all of it is there.
void BlobSubscriber::Impl::Finish(const SlotKey& key, Slot& slot) {
  if (!slot.assembly || !slot.assembly->complete() || !slot.info) return;
  if (slot.info->version != *slot.version) return;
  const auto digest = slot.assembly->Digest();
  if (slot.info->size == slot.assembly->size() && std::equal(digest.begin(), digest.end(), slot.info->sha256.begin())) {
    PublishedBlob blob{key.channel,          *slot.version, slot.info->owner,
                       slot.info->meta_json, ToHex(digest), slot.assembly->TakeBytes()};
    slot.Clear();
    return Judge(std::move(blob));  // which may remove the slot
  }
  ++corrupt;
  Log().warn("published blob dropped: its bytes do not fit its checksum channel={} version={}", key.channel,
             *slot.version);
  slot.Clear();
}

// Takes it, refuses it, or keeps it aside when it cannot be judged now (a disk is full): it is not sent again.
void BlobSubscriber::Impl::Judge(PublishedBlob blob) {
  const std::string name = blob.channel;
  const Status judged = options.accept ? options.accept(blob) : Status();
  if (judged) {
    returned[name] = blob.version;
    ready[name] = std::move(blob);
    return DropSuperseded(name);
  }
  if (judged.error().code != Code::kUnavailable) {
    Log().warn("published blob refused channel={} version={}: {}", name, blob.version, judged.error().message);
    return;
  }
  const auto [known, is_first] = told.try_emplace(name, blob.version);
  if (is_first || blob.version > known->second)
    Log().warn("published blob waits, it is judged again and again channel={} version={}: {}", name, blob.version,
               judged.error().message);
  known->second = std::max(known->second, blob.version);
  if (undecided.empty()) judge_again = Clock::now() + kJudgeAgain;
  auto& kept = undecided[name];
  if (kept.version <= blob.version) kept = std::move(blob);
}

void BlobSubscriber::Impl::JudgeUndecided() {
  if (Clock::now() < judge_again) return;
  for (auto& [name, blob] : std::exchange(undecided, {}))
    if (IsNews(name, blob.version)) Judge(std::move(blob));
}

// Slots too: a publisher that is gone leaves nothing behind.
void BlobSubscriber::Impl::DropSuperseded(const std::string& name) {
  std::erase_if(slots, [&](const auto& item) {
    const auto& [key, slot] = item;
    const std::uint64_t newest = std::max(slot.version.value_or(0), slot.info ? slot.info->version : 0);
    return key.channel == name && !IsNews(name, newest);
  });
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
  std::vector<std::string> partitions{owner.partition()};
  if (options.from_relays) partitions.push_back(owner.relay_partition());
  ETUDE_ASSIGN_OR_RETURN(impl->chunks, OpenReaderIn(participant, partitions, etude_wire_PublishedChunk_desc,
                                                    kPublishedChunkTopic, kPublishedReader));
  ETUDE_ASSIGN_OR_RETURN(impl->manifests, OpenReaderIn(participant, partitions, etude_wire_PublishedManifest_desc,
                                                       kPublishedManifestTopic, kPublishedReader));
  ETUDE_RETURN_IF_ERROR(impl->waiter.Open(participant));
  ETUDE_RETURN_IF_ERROR(impl->waiter.AddReader(impl->chunks));
  ETUDE_RETURN_IF_ERROR(impl->waiter.AddReader(impl->manifests));
  return BlobSubscriber(std::move(impl));
}

std::optional<PublishedBlob> BlobSubscriber::Wait(std::chrono::nanoseconds timeout) {
  const auto end = Deadline(timeout);
  for (;;) {
    impl_->JudgeUndecided();
    // whoever sends without an end does not hold up the caller
    while (!impl_->ReadyIsFull() && impl_->Drain() > 0 && Clock::now() < end && !StopRequested()) {
    }
    if (!impl_->ready.empty()) {
      auto first = impl_->ready.extract(impl_->ready.begin());
      return std::move(first.mapped());
    }
    const auto left = end - Clock::now();
    if (left.count() <= 0 || StopRequested()) return std::nullopt;
    impl_->waiter.Wait(impl_->undecided.empty() ? left : std::min<std::chrono::nanoseconds>(left, kJudgeAgain));
  }
}

bool BlobSubscriber::Offered(const std::string& channel, std::uint64_t version) const {
  return std::ranges::any_of(impl_->offered,
                             [&](const auto& item) { return item.second == std::pair(channel, version); });
}

std::uint64_t BlobSubscriber::corrupt_blobs() const { return impl_->corrupt; }

}  // namespace etude::bus
