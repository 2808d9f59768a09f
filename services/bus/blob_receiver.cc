// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <deque>
#include <map>
#include <utility>

#include "services/bus/assembly.h"
#include "services/bus/blob_transfer.h"
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
constexpr std::chrono::seconds kForgetAfter{60};  // an unfinished blob nobody sends any more

struct Entry {
  enum class State { kReceiving, kReady, kJudging, kJudged };
  State state = State::kReceiving;
  BlobManifest manifest;             // data is empty
  std::optional<Assembly> assembly;  // kReceiving
  std::vector<std::uint8_t> bytes;   // kReady
  Verdict verdict;                   // kJudged
  std::uint32_t acknowledged = 0;    // chunks reported to the sender
  Clock::time_point heard;
};

struct Peer {
  std::map<std::uint64_t, Entry> blobs;
  std::deque<std::uint64_t> judged;  // oldest first
  Clock::time_point heard;
};

struct BlobKey {
  std::string sender;
  std::uint64_t id = 0;
};

bool Equal(std::span<const std::uint8_t> a, const std::vector<std::uint8_t>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end());
}

bool IsSound(const ManifestView& view) {
  return view.sha256.size() == 32 && ShapeIsSound(view.size, view.chunk_size, view.chunk_count) &&
         (view.data.empty() || view.data.size() == view.size) && view.meta_json.size() <= kMaxText;
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
  Owner owner;
  std::string channel;
  ReceiveOptions options;
  Endpoint manifests;
  Endpoint chunks;
  Endpoint acks;
  Waiter waiter;
  std::map<std::string, Peer, std::less<>> peers;
  std::deque<BlobKey> ready;
  std::vector<BlobKey> unreported;  // progress that the sender does not know
  std::uint64_t memory = 0;         // of unfinished and ready blobs
  std::uint64_t corrupt = 0;
  std::uint64_t malformed = 0;
  Clock::time_point next_cleaning;

  Status OpenAll(const Participant& participant);
  int Drain();
  int DrainManifests();
  void OnManifest(const ManifestView& view);
  void AnswerKnown(const ManifestView& view, Entry& entry);
  void Start(const ManifestView& view, Peer& peer);
  void TakeWhole(const ManifestView& view, Entry& entry);
  void OnChunk(const ChunkView& view);
  void Finish(Entry& entry, std::vector<std::uint8_t> bytes);
  void RefuseCorrupt(const BlobManifest& manifest);
  BlobAck AckOf(const BlobManifest& manifest, AckKind kind) const;
  Status SendVerdict(const BlobManifest& manifest, const Verdict& verdict);
  void Answer(const BlobManifest& manifest, const Verdict& verdict);
  void SendProgress(Entry& entry, AckKind kind);
  void FlushProgress();
  void Remember(Peer& peer, Entry& entry, const Verdict& verdict);
  void Clean();
  Entry* Find(std::string_view sender, std::uint64_t id);
  bool WaitReady(std::chrono::nanoseconds timeout);
  ReceivedBlob Pop();
};

Status BlobReceiver::Impl::OpenAll(const Participant& participant) {
  const std::string partition = owner.partition() + "/" + channel;
  // acks first: a sender that finds our readers can then be answered
  ETUDE_ASSIGN_OR_RETURN(acks, OpenWriterOf<BlobAck>(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(chunks, OpenReaderOf<BlobChunk>(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(manifests, OpenReaderOf<BlobManifest>(participant, partition));
  ETUDE_RETURN_IF_ERROR(waiter.Open(participant));
  ETUDE_RETURN_IF_ERROR(waiter.AddReader(manifests));
  return waiter.AddReader(chunks);
}

Entry* BlobReceiver::Impl::Find(std::string_view sender, std::uint64_t id) {
  const auto peer = peers.find(sender);
  if (peer == peers.end()) return nullptr;
  const auto entry = peer->second.blobs.find(id);
  return entry == peer->second.blobs.end() ? nullptr : &entry->second;
}

int BlobReceiver::Impl::DrainManifests() {
  return TakeSerialized(manifests, 64, [this](std::span<const std::uint8_t> cdr) {
    ManifestView view;
    if (!Parse(cdr, view) || !IsSound(view))
      ++malformed;
    else if (view.channel == channel && view.owner == owner.id)
      OnManifest(view);
  });
}

// Returns the number of samples taken.
int BlobReceiver::Impl::Drain() {
  const int announced = DrainManifests();
  const int taken = TakeSerialized(chunks, 64, [this](std::span<const std::uint8_t> cdr) {
    ChunkView view;
    if (!Parse(cdr, view) || view.data.empty())
      ++malformed;
    else if (view.channel == channel)
      OnChunk(view);
  });
  return announced + taken;
}

void BlobReceiver::Impl::OnManifest(const ManifestView& view) {
  auto found = peers.find(view.sender);
  if (found == peers.end()) found = peers.emplace(std::string(view.sender), Peer{}).first;
  Peer& peer = found->second;
  peer.heard = Clock::now();
  const auto known = peer.blobs.find(view.id);
  if (known != peer.blobs.end()) {
    Entry& entry = known->second;
    const bool changed = entry.state == Entry::State::kReceiving && !IsSame(view, entry.manifest);
    if (!changed) return AnswerKnown(view, entry);
    memory -= entry.manifest.size;
    peer.blobs.erase(known);
  }
  Start(view, peer);
}

void BlobReceiver::Impl::AnswerKnown(const ManifestView& view, Entry& entry) {
  entry.heard = Clock::now();
  switch (entry.state) {
    case Entry::State::kReceiving:
      if (view.data.size() == view.size && view.size > 0) return TakeWhole(view, entry);
      return SendProgress(entry, AckKind::kMissing);
    case Entry::State::kReady:
    case Entry::State::kJudging:
      return SendProgress(entry, AckKind::kProgress);
    case Entry::State::kJudged:
      return Answer(entry.manifest, entry.verdict);
  }
}

void BlobReceiver::Impl::Start(const ManifestView& view, Peer& peer) {
  if (view.size > options.max_blob_size) {
    Entry& entry = peer.blobs[view.id];
    entry.manifest = ToManifest(view);
    Remember(peer, entry,
             {AckKind::kRefused, fmt::format("{} bytes, at most {} are taken", view.size, options.max_blob_size)});
    return AnswerKnown(view, entry);
  }
  // no room: say nothing, and the sender announces it again
  if (memory > 0 && memory + view.size > options.max_memory) return;
  memory += view.size;
  Entry& entry = peer.blobs[view.id];
  entry.manifest = ToManifest(view);
  entry.heard = Clock::now();
  if (view.data.size() == view.size) return TakeWhole(view, entry);
  entry.assembly.emplace(view.size, view.chunk_size);
  SendProgress(entry, AckKind::kMissing);
}

// Of a blob that came in its manifest: the one copy out of DDS's memory. Its verdict will be the answer.
void BlobReceiver::Impl::TakeWhole(const ManifestView& view, Entry& entry) {
  if (!Equal(Sha256Of(view.data), entry.manifest.sha256)) return RefuseCorrupt(entry.manifest);
  Finish(entry, {view.data.begin(), view.data.end()});
}

void BlobReceiver::Impl::OnChunk(const ChunkView& view) {
  Entry* entry = Find(view.sender, view.id);
  if (entry == nullptr) {  // the manifest travels on another topic and may be just behind
    while (DrainManifests() > 0) {
    }
    entry = Find(view.sender, view.id);
  }
  if (entry == nullptr || entry->state != Entry::State::kReceiving) return;
  entry->heard = Clock::now();
  const auto added = entry->assembly->Add(view.index, view.data);
  if (added == Assembly::Added::kMalformed) ++malformed;
  if (added != Assembly::Added::kNew) return;
  if (entry->assembly->complete()) {
    if (!Equal(entry->assembly->Digest(), entry->manifest.sha256)) return RefuseCorrupt(entry->manifest);
    Finish(*entry, entry->assembly->TakeBytes());
    return SendProgress(*entry, AckKind::kProgress);
  }
  const std::uint32_t unreported_chunks = entry->assembly->next() - entry->acknowledged;
  if (unreported_chunks >= kAckEvery) return SendProgress(*entry, AckKind::kProgress);
  if (unreported_chunks == 1) unreported.push_back({std::string(view.sender), view.id});
}

void BlobReceiver::Impl::Finish(Entry& entry, std::vector<std::uint8_t> bytes) {
  entry.bytes = std::move(bytes);
  entry.assembly.reset();
  entry.acknowledged = entry.manifest.chunk_count;
  entry.state = Entry::State::kReady;
  ready.push_back({entry.manifest.sender, entry.manifest.id});
}

// Not remembered: the sender may try again with the same id.
void BlobReceiver::Impl::RefuseCorrupt(const BlobManifest& manifest) {
  ++corrupt;
  Log().warn("blob refused: its bytes do not fit its checksum channel={} sender={} id={}", channel, manifest.sender,
             manifest.id);
  Answer(manifest, {AckKind::kRefused, "the bytes do not fit the checksum"});
  memory -= manifest.size;
  const BlobKey key{manifest.sender, manifest.id};
  peers.find(key.sender)->second.blobs.erase(key.id);
}

BlobAck BlobReceiver::Impl::AckOf(const BlobManifest& manifest, AckKind kind) const {
  BlobAck ack;
  ack.channel = channel;
  ack.owner = owner.id;
  ack.sender = manifest.sender;
  ack.id = manifest.id;
  ack.kind = kind;
  return ack;
}

Status BlobReceiver::Impl::SendVerdict(const BlobManifest& manifest, const Verdict& verdict) {
  BlobAck ack = AckOf(manifest, verdict.kind);
  ack.reason = verdict.reason;
  return WriteMessage(acks, ack);
}

// A lost ack is asked for again by the sender's next announcement.
void BlobReceiver::Impl::Answer(const BlobManifest& manifest, const Verdict& verdict) {
  if (auto written = SendVerdict(manifest, verdict); !written) Log().warn("ack not sent: {}", written.error().message);
}

void BlobReceiver::Impl::SendProgress(Entry& entry, AckKind kind) {
  BlobAck ack = AckOf(entry.manifest, kind);
  ack.received = entry.assembly ? entry.assembly->next() : entry.manifest.chunk_count;
  if (kind == AckKind::kMissing) ack.missing = entry.assembly->Missing(kMaxMissing);
  entry.acknowledged = ack.received;
  if (auto written = WriteMessage(acks, ack); !written) Log().warn("ack not sent: {}", written.error().message);
}

void BlobReceiver::Impl::FlushProgress() {
  for (const auto& key : unreported) {
    Entry* const entry = Find(key.sender, key.id);
    if (entry == nullptr || entry->state != Entry::State::kReceiving) continue;
    if (entry->assembly->next() > entry->acknowledged) SendProgress(*entry, AckKind::kProgress);
  }
  unreported.clear();
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
    peers.erase(oldest);
  }
}

// The oldest verified blob; there must be one.
ReceivedBlob BlobReceiver::Impl::Pop() {
  const BlobKey key = std::move(ready.front());
  ready.pop_front();
  Entry& entry = *Find(key.sender, key.id);
  entry.state = Entry::State::kJudging;
  memory -= entry.manifest.size;
  return {entry.manifest, std::move(entry.bytes)};
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
    const auto left = end - Clock::now();
    if (left.count() <= 0 || StopRequested()) return false;
    waiter.Wait(std::min<std::chrono::nanoseconds>(left, std::chrono::seconds(5)));
  }
  return true;
}

BlobReceiver::BlobReceiver(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
BlobReceiver::BlobReceiver(BlobReceiver&&) noexcept = default;
BlobReceiver& BlobReceiver::operator=(BlobReceiver&&) noexcept = default;
BlobReceiver::~BlobReceiver() = default;

Result<BlobReceiver> BlobReceiver::Open(const Participant& participant, const Owner& owner, const std::string& channel,
                                        const ReceiveOptions& options) {
  auto impl = std::make_unique<Impl>();
  impl->owner = owner;
  impl->channel = channel;
  impl->options = options;
  impl->options.verdicts_kept = std::max(1u, options.verdicts_kept);
  ETUDE_RETURN_IF_ERROR(impl->OpenAll(participant));
  return BlobReceiver(std::move(impl));
}

std::optional<ReceivedBlob> BlobReceiver::Receive(std::chrono::nanoseconds timeout) {
  if (!impl_->WaitReady(timeout)) return std::nullopt;
  return impl_->Pop();
}

Status BlobReceiver::Acknowledge(const BlobManifest& manifest, const Verdict& verdict) {
  if (Entry* const entry = impl_->Find(manifest.sender, manifest.id))
    impl_->Remember(impl_->peers.find(manifest.sender)->second, *entry, verdict);
  return impl_->SendVerdict(manifest, verdict);
}

std::uint64_t BlobReceiver::corrupt_blobs() const { return impl_->corrupt; }
std::uint64_t BlobReceiver::malformed_samples() const { return impl_->malformed; }

}  // namespace etude::bus
