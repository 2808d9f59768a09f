// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <deque>
#include <map>
#include <utility>

#include "services/bus/assembly.h"
#include "services/bus/blob_transfer.h"
#include "services/bus/manifest_intake.h"
#include "services/bus/serialized.h"
#include "services/bus/typed.h"
#include "services/core/clock.h"
#include "services/core/hash.h"
#include "services/core/log.h"
#include "services/core/stop.h"

namespace etude::bus {
namespace {

using Clock = MonotonicClock;

constexpr std::uint32_t kAckEvery = 8;     // chunks
constexpr std::size_t kMaxMissing = 1024;  // indices in one ack
constexpr std::size_t kMaxPeers = 4096;
constexpr std::chrono::microseconds kBatchDelay{500};  // a verdict waits for others at most
constexpr std::chrono::seconds kForgetAfter{60};       // an unfinished blob nobody sends any more

struct Entry {
  enum class State { kReceiving, kReady, kJudging, kJudged };
  State state = State::kReceiving;
  BlobManifest manifest;             // data is empty
  std::optional<Assembly> assembly;  // kReceiving
  std::vector<std::uint8_t> bytes;   // kReady, of a blob that came in chunks
  Serialized whole;                  // kReady, of one that came in its manifest: DDS's own memory
  std::span<const std::uint8_t> whole_bytes;
  Verdict verdict;                 // kJudged
  std::uint32_t acknowledged = 0;  // chunks reported to the sender
  Clock::time_point heard;
};

struct Peer {
  std::map<std::uint64_t, Entry> blobs;
  std::deque<std::uint64_t> judged;  // oldest first
  std::vector<std::uint64_t> done;   // kDone verdicts not yet sent
  Clock::time_point heard;
};

struct BlobKey {
  std::string sender;
  std::uint64_t id = 0;
};

bool Equal(std::span<const std::uint8_t> a, const std::vector<std::uint8_t>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end());
}

bool IsSame(const ManifestView& view, const BlobManifest& manifest) {
  return view.size == manifest.size && view.chunk_size == manifest.chunk_size && Equal(view.sha256, manifest.sha256);
}

BlobManifest ToManifest(const ManifestView& view) {
  BlobManifest manifest;
  manifest.channel = view.channel;
  manifest.sender = view.sender;
  manifest.owner = view.owner;
  manifest.id = view.id;
  manifest.size = view.size;
  manifest.chunk_size = view.chunk_size;
  manifest.chunk_count = view.chunk_count;
  manifest.sha256.assign(view.sha256.begin(), view.sha256.end());
  manifest.token = view.token;
  manifest.meta_json = view.meta_json;
  return manifest;
}

}  // namespace

struct BlobReceiver::Impl {
  std::string channel;
  ReceiveOptions options;
  std::unique_ptr<ManifestIntake> manifests;
  Endpoint chunks;
  Endpoint acks;
  Waiter waiter;
  std::map<std::string, Peer, std::less<>> peers;
  std::deque<BlobKey> ready;
  std::vector<BlobKey> unreported;  // progress that the sender does not know
  ReceivedBlob current;             // what ReceiveView shows
  Serialized current_whole;
  std::uint64_t memory = 0;  // of unfinished and ready blobs
  std::uint64_t corrupt = 0;
  std::uint64_t malformed = 0;
  Clock::time_point next_cleaning;
  std::uint32_t batched = 0;          // kDone verdicts not yet sent, of all peers
  Clock::time_point batch_leaves_at;  // when batched > 0

  Status OpenAll(const Participant& participant, const std::string& partition);
  int Drain();
  int DrainManifests();
  void OnManifest(TakenManifest& taken);
  void AnswerKnown(TakenManifest& taken, Entry& entry);
  void Start(TakenManifest& taken, Peer& peer);
  void StartWhole(TakenManifest& taken, Entry& entry);
  void OnChunk(const ChunkView& view);
  void OnComplete(Entry& entry);
  void RefuseCorrupt(const BlobManifest& manifest);
  void SendAck(BlobAck ack);
  void SendProgress(Entry& entry, AckKind kind);
  void FlushProgress();
  void FlushDone(const std::string& sender, Peer& peer);
  void FlushAllDone();
  void Remember(Peer& peer, Entry& entry, const Verdict& verdict);
  void Clean();
  Entry* Find(std::string_view sender, std::uint64_t id);
  bool Receive(ReceivedBlob& blob, std::chrono::nanoseconds timeout);
  bool WaitReady(std::chrono::nanoseconds timeout);
  bool Pop(ReceivedBlob& blob, Serialized& whole, std::span<const std::uint8_t>& whole_bytes);
};

Status BlobReceiver::Impl::OpenAll(const Participant& participant, const std::string& partition) {
  const std::string own = partition + "/" + channel;
  // acks first: a sender that finds our readers can then be answered
  ETUDE_ASSIGN_OR_RETURN(acks, OpenWriterOf<BlobAck>(participant, own));
  ETUDE_ASSIGN_OR_RETURN(chunks, OpenReaderOf<BlobChunk>(participant, own));
  ETUDE_ASSIGN_OR_RETURN(manifests, ManifestIntake::Open(participant, own));
  ETUDE_RETURN_IF_ERROR(waiter.Open(participant));
  ETUDE_RETURN_IF_ERROR(manifests->Attach(waiter));
  return waiter.AddReader(chunks);
}

Entry* BlobReceiver::Impl::Find(std::string_view sender, std::uint64_t id) {
  const auto peer = peers.find(sender);
  if (peer == peers.end()) return nullptr;
  const auto entry = peer->second.blobs.find(id);
  return entry == peer->second.blobs.end() ? nullptr : &entry->second;
}

int BlobReceiver::Impl::DrainManifests() {
  auto taken = manifests->Take();
  for (auto& item : taken) {
    if (!item.is_sound)
      ++malformed;
    else if (item.view.channel == channel && item.view.owner == options.owner)
      OnManifest(item);
  }
  return static_cast<int>(taken.size());
}

// Returns the number of samples taken.
int BlobReceiver::Impl::Drain() {
  const int announced = DrainManifests();
  const int taken = TakeSerialized(chunks, 64, [this](Serialized& sample) {
    ChunkView view;
    if (!Parse(sample.bytes(), view) || view.data.empty())
      ++malformed;
    else if (view.channel == channel)
      OnChunk(view);
  });
  return announced + taken;
}

void BlobReceiver::Impl::OnManifest(TakenManifest& taken) {
  const ManifestView& view = taken.view;
  auto found = peers.find(view.sender);
  if (found == peers.end()) found = peers.emplace(std::string(view.sender), Peer{}).first;
  Peer& peer = found->second;
  peer.heard = Clock::now();
  const auto known = peer.blobs.find(view.id);
  if (known != peer.blobs.end()) {
    Entry& entry = known->second;
    const bool changed = entry.state == Entry::State::kReceiving && !IsSame(view, entry.manifest);
    if (!changed) return AnswerKnown(taken, entry);
    memory -= entry.manifest.size;
    peer.blobs.erase(known);
  }
  Start(taken, peer);
}

void BlobReceiver::Impl::AnswerKnown(TakenManifest& taken, Entry& entry) {
  const ManifestView& view = taken.view;
  entry.heard = Clock::now();
  switch (entry.state) {
    case Entry::State::kReceiving:
      if (view.data.size() == view.size && view.size > 0) return StartWhole(taken, entry);
      return SendProgress(entry, AckKind::kMissing);
    case Entry::State::kReady:
    case Entry::State::kJudging:
      return SendProgress(entry, AckKind::kProgress);
    case Entry::State::kJudged: {
      BlobAck ack;
      ack.sender = view.sender;
      ack.id = view.id;
      ack.kind = entry.verdict.kind;
      ack.reason = entry.verdict.reason;
      return SendAck(std::move(ack));
    }
  }
}

void BlobReceiver::Impl::Start(TakenManifest& taken, Peer& peer) {
  const ManifestView& view = taken.view;
  if (view.size > options.max_blob_size) {
    Entry& entry = peer.blobs[view.id];
    entry.manifest = ToManifest(view);
    Remember(peer, entry,
             {AckKind::kRefused, fmt::format("{} bytes, at most {} are taken", view.size, options.max_blob_size)});
    return AnswerKnown(taken, entry);
  }
  // no room: say nothing, and the sender announces it again
  if (memory > 0 && memory + view.size > options.max_memory) return;
  memory += view.size;
  Entry& entry = peer.blobs[view.id];
  entry.manifest = ToManifest(view);
  entry.heard = Clock::now();
  if (view.data.size() == view.size) return StartWhole(taken, entry);
  entry.assembly.emplace(view.size, view.chunk_size);
  SendProgress(entry, AckKind::kMissing);
}

void BlobReceiver::Impl::StartWhole(TakenManifest& taken, Entry& entry) {
  if (!Equal(Sha256Of(taken.view.data), entry.manifest.sha256)) return RefuseCorrupt(entry.manifest);
  entry.whole_bytes = taken.view.data;
  entry.whole = std::move(taken.sample);
  entry.assembly.reset();
  entry.acknowledged = entry.manifest.chunk_count;
  entry.state = Entry::State::kReady;
  ready.push_back({entry.manifest.sender, entry.manifest.id});
}

void BlobReceiver::Impl::OnChunk(const ChunkView& view) {
  Entry* entry = Find(view.sender, view.id);
  if (entry == nullptr) {  // the manifest travels on another topic and may be just behind
    DrainManifests();
    entry = Find(view.sender, view.id);
  }
  if (entry == nullptr || entry->state != Entry::State::kReceiving) return;
  entry->heard = Clock::now();
  const auto added = entry->assembly->Add(view.index, view.data);
  if (added == Assembly::Added::kMalformed) ++malformed;
  if (added != Assembly::Added::kNew) return;
  if (entry->assembly->complete()) return OnComplete(*entry);
  const std::uint32_t unreported_chunks = entry->assembly->next() - entry->acknowledged;
  if (unreported_chunks >= kAckEvery) return SendProgress(*entry, AckKind::kProgress);
  if (unreported_chunks == 1) unreported.push_back({std::string(view.sender), view.id});
}

void BlobReceiver::Impl::OnComplete(Entry& entry) {
  if (!Equal(entry.assembly->Digest(), entry.manifest.sha256)) return RefuseCorrupt(entry.manifest);
  entry.bytes = entry.assembly->TakeBytes();
  entry.assembly.reset();
  entry.state = Entry::State::kReady;
  ready.push_back({entry.manifest.sender, entry.manifest.id});
  SendProgress(entry, AckKind::kProgress);
}

// Not remembered: the sender may try again with the same id.
void BlobReceiver::Impl::RefuseCorrupt(const BlobManifest& manifest) {
  ++corrupt;
  Log().warn("blob refused: its bytes do not fit its checksum channel={} sender={} id={}", channel, manifest.sender,
             manifest.id);
  BlobAck ack;
  ack.sender = manifest.sender;
  ack.id = manifest.id;
  ack.kind = AckKind::kRefused;
  ack.reason = "the bytes do not fit the checksum";
  memory -= manifest.size;
  peers.find(ack.sender)->second.blobs.erase(ack.id);
  SendAck(std::move(ack));
}

void BlobReceiver::Impl::SendAck(BlobAck ack) {
  ack.channel = channel;
  ack.owner = options.owner;
  // a lost ack is asked for again by the sender's next announcement
  if (auto written = WriteMessage(acks, ack); !written) {
    Log().warn("ack not sent: {}", written.error().message);
  }
}

void BlobReceiver::Impl::SendProgress(Entry& entry, AckKind kind) {
  BlobAck ack;
  ack.sender = entry.manifest.sender;
  ack.id = entry.manifest.id;
  ack.kind = kind;
  ack.received = entry.assembly ? entry.assembly->next() : entry.manifest.chunk_count;
  if (kind == AckKind::kMissing) ack.missing = entry.assembly->Missing(kMaxMissing);
  entry.acknowledged = ack.received;
  SendAck(std::move(ack));
}

void BlobReceiver::Impl::FlushProgress() {
  for (const auto& key : unreported) {
    Entry* const entry = Find(key.sender, key.id);
    if (entry == nullptr || entry->state != Entry::State::kReceiving) continue;
    if (entry->assembly->next() > entry->acknowledged) SendProgress(*entry, AckKind::kProgress);
  }
  unreported.clear();
}

void BlobReceiver::Impl::FlushDone(const std::string& sender, Peer& peer) {
  if (peer.done.empty()) return;
  BlobAck ack;
  ack.sender = sender;
  ack.kind = AckKind::kDone;
  ack.id = peer.done.front();
  ack.also.assign(peer.done.begin() + 1, peer.done.end());
  batched -= static_cast<std::uint32_t>(peer.done.size());
  peer.done.clear();
  SendAck(std::move(ack));
}

void BlobReceiver::Impl::FlushAllDone() {
  if (batched == 0) return;
  for (auto& [sender, peer] : peers) FlushDone(sender, peer);
}

void BlobReceiver::Impl::Remember(Peer& peer, Entry& entry, const Verdict& verdict) {
  if (entry.state != Entry::State::kJudged) peer.judged.push_back(entry.manifest.id);
  entry.state = Entry::State::kJudged;
  entry.verdict = verdict;
  while (peer.judged.size() > options.verdicts_kept) {
    peer.blobs.erase(peer.judged.front());
    peer.judged.pop_front();
  }
}

// Frees what dead senders left behind.
void BlobReceiver::Impl::Clean() {
  const auto now = Clock::now();
  if (now < next_cleaning) return;
  next_cleaning = now + std::chrono::seconds(5);
  for (auto& [sender, peer] : peers) {
    std::erase_if(peer.blobs, [&](const auto& item) {
      const Entry& entry = item.second;
      if (entry.state != Entry::State::kReceiving || now - entry.heard < kForgetAfter) return false;
      memory -= entry.manifest.size;
      return true;
    });
  }
  while (peers.size() > kMaxPeers) {
    const auto oldest = std::min_element(peers.begin(), peers.end(),
                                         [](const auto& a, const auto& b) { return a.second.heard < b.second.heard; });
    const bool only_judged = oldest->second.blobs.size() == oldest->second.judged.size();
    if (!only_judged) return;
    FlushDone(oldest->first, oldest->second);
    peers.erase(oldest);
  }
}

// The oldest verified blob. Its bytes are those of `whole`, or, when that is empty, `blob.bytes`.
bool BlobReceiver::Impl::Pop(ReceivedBlob& blob, Serialized& whole, std::span<const std::uint8_t>& whole_bytes) {
  if (ready.empty()) return false;
  const BlobKey key = std::move(ready.front());
  ready.pop_front();
  Entry& entry = *Find(key.sender, key.id);
  entry.state = Entry::State::kJudging;
  memory -= entry.manifest.size;
  blob.manifest = entry.manifest;
  whole = std::exchange(entry.whole, {});
  whole_bytes = std::exchange(entry.whole_bytes, {});
  if (whole.bytes().empty()) blob.bytes = std::exchange(entry.bytes, {});
  return true;
}

// Until a blob is ready; false after `timeout` or on a stop request.
bool BlobReceiver::Impl::WaitReady(std::chrono::nanoseconds timeout) {
  const auto now = Clock::now();
  const auto latest = Clock::time_point::max();
  const auto end = timeout > latest - now ? latest : now + timeout;
  while (ready.empty()) {
    if (Drain() > 0) continue;
    FlushProgress();
    Clean();
    const auto before = Clock::now();
    if (before >= std::min(end, batch_leaves_at) || StopRequested()) FlushAllDone();
    if (before >= end || StopRequested()) return false;
    // in the middle of a stream one wake for a whole batch; else at once
    manifests->WakeAfter(batched > 0 ? options.ack_batch - std::min(batched, options.ack_batch - 1) : 1);
    const auto until = batched > 0 ? std::min(end, batch_leaves_at) : end;
    waiter.Wait(std::min<std::chrono::nanoseconds>(until - before, std::chrono::seconds(5)));
  }
  return true;
}

bool BlobReceiver::Impl::Receive(ReceivedBlob& blob, std::chrono::nanoseconds timeout) {
  if (!WaitReady(timeout)) return false;
  Serialized whole;
  std::span<const std::uint8_t> whole_bytes;
  Pop(blob, whole, whole_bytes);
  if (!whole.bytes().empty()) blob.bytes.assign(whole_bytes.begin(), whole_bytes.end());
  return true;
}

BlobReceiver::BlobReceiver(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
BlobReceiver::BlobReceiver(BlobReceiver&&) noexcept = default;
BlobReceiver& BlobReceiver::operator=(BlobReceiver&&) noexcept = default;
BlobReceiver::~BlobReceiver() {
  if (impl_) impl_->FlushAllDone();
}

Result<BlobReceiver> BlobReceiver::Open(const Participant& participant, const std::string& partition,
                                        const std::string& channel, const ReceiveOptions& options) {
  auto impl = std::make_unique<Impl>();
  impl->channel = channel;
  impl->options = options;
  impl->options.ack_batch = std::clamp<std::uint32_t>(options.ack_batch, 1, 1024);
  impl->options.verdicts_kept = std::max({1u, options.verdicts_kept, impl->options.ack_batch});
  ETUDE_RETURN_IF_ERROR(impl->OpenAll(participant, partition));
  return BlobReceiver(std::move(impl));
}

std::optional<ReceivedBlob> BlobReceiver::Receive(std::chrono::nanoseconds timeout) {
  ReceivedBlob blob;
  if (!impl_->Receive(blob, timeout)) return std::nullopt;
  return blob;
}

bool BlobReceiver::Receive(ReceivedBlob& blob, std::chrono::nanoseconds timeout) {
  return impl_->Receive(blob, timeout);
}

std::optional<BlobView> BlobReceiver::ReceiveView(std::chrono::nanoseconds timeout) {
  impl_->current_whole.Release();
  if (!impl_->WaitReady(timeout)) return std::nullopt;
  std::span<const std::uint8_t> bytes;
  impl_->Pop(impl_->current, impl_->current_whole, bytes);
  if (impl_->current_whole.bytes().empty()) bytes = impl_->current.bytes;
  return BlobView{&impl_->current.manifest, bytes};
}

Status BlobReceiver::Acknowledge(const BlobManifest& manifest, const Verdict& verdict) {
  const auto peer = impl_->peers.find(manifest.sender);
  if (peer != impl_->peers.end()) {
    const auto entry = peer->second.blobs.find(manifest.id);
    if (entry != peer->second.blobs.end()) {
      impl_->Remember(peer->second, entry->second, verdict);
      if (verdict.kind == AckKind::kDone && impl_->options.ack_batch > 1) {
        if (impl_->batched++ == 0) impl_->batch_leaves_at = Clock::now() + kBatchDelay;
        peer->second.done.push_back(manifest.id);
        if (peer->second.done.size() >= impl_->options.ack_batch) {
          impl_->FlushDone(peer->first, peer->second);
        }
        return {};
      }
    }
  }
  BlobAck ack;
  ack.channel = impl_->channel;
  ack.owner = impl_->options.owner;
  ack.sender = manifest.sender;
  ack.id = manifest.id;
  ack.kind = verdict.kind;
  ack.reason = verdict.reason;
  return WriteMessage(impl_->acks, ack);
}

std::uint64_t BlobReceiver::corrupt_blobs() const { return impl_->corrupt; }
std::uint64_t BlobReceiver::malformed_samples() const { return impl_->malformed; }

}  // namespace etude::bus
