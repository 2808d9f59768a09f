// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <utility>

#include "services/bus/addressed_writers.h"
#include "services/bus/assembly.h"
#include "services/bus/blob_transfer.h"
#include "services/bus/inbox.h"
#include "services/bus/serialized.h"
#include "services/bus/typed.h"
#include "services/core/clock.h"
#include "services/core/file.h"
#include "services/core/hash.h"
#include "services/core/log.h"
#include "services/core/stop.h"
#include "services/core/thread_annotations.h"

namespace etude::bus {
namespace {

using Clock = MonotonicClock;

constexpr std::uint32_t kAckEvery = 8;      // chunks
constexpr std::size_t kMaxMissing = 1024;   // indices in one ack
constexpr std::uint32_t kLeastChunk = 512;  // bytes, of a blob of several: what is kept beside each is a quarter of it
constexpr std::size_t kMostRefused = 200;   // a receiver whose owner does not ask for them is no leak
constexpr int kMostBatches = 16;            // of manifests, to find one for a chunk
constexpr std::chrono::seconds kIdleLook{5};
constexpr std::chrono::milliseconds kHostLook{10};  // whose readers are not found yet

using State = IncomingBlob::State;

bool Equal(std::span<const std::uint8_t> a, const std::vector<std::uint8_t>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end());
}

bool ViewIsSound(const ManifestView& view) {
  return view.sha256.size() == 32 && ShapeIsSound(view.size, view.chunk_size, view.chunk_count) &&
         (view.chunk_count <= 1 || view.chunk_size >= kLeastChunk) &&
         (view.data.empty() || view.data.size() == view.size) && view.meta_json.size() <= kMaxText &&
         IsPlainName(view.host);
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
  manifest.host = view.host;
  return manifest;
}

}  // namespace

struct BlobReceiver::Impl {
  Owner owner;
  std::string channel;
  ReceiveOptions options;
  Endpoint manifests;
  Endpoint chunks;
  std::optional<AddressedWriters<BlobAck>> acks;
  Waiter waiter;
  Inbox inbox;
  std::vector<BlobKey> unreported;   // progress that the sender does not know
  std::vector<RefusedBlob> refused;  // nobody has asked for them yet
  std::uint64_t corrupt = 0;
  std::uint64_t malformed = 0;
  Clock::time_point next_cleaning;

  Mutex mutex;
  std::vector<std::pair<BlobManifest, Verdict>> judged ETUDE_GUARDED_BY(mutex);  // told, and not in the inbox yet

  void TakeVerdicts() ETUDE_EXCLUDES(mutex);

  Status OpenAll(const Participant& participant);
  int Drain();
  int DrainManifests();
  void OnManifest(const ManifestView& view);
  void AnswerKnown(const ManifestView& view, IncomingBlob& blob);
  void Start(const ManifestView& view);
  void TakeWhole(const ManifestView& view, IncomingBlob& blob);
  void OnChunk(const ChunkView& view);
  void RefuseCorrupt(const IncomingBlob& blob);
  void NoteRefused(const BlobManifest& manifest, const std::string& reason);
  BlobAck AckOf(const BlobManifest& manifest, AckKind kind) const;
  Status SendVerdict(const BlobManifest& manifest, const Verdict& verdict);
  void Answer(const BlobManifest& manifest, const Verdict& verdict);
  void SendProgress(IncomingBlob& blob, AckKind kind);
  void FlushProgress();
  void Clean();
};

Status BlobReceiver::Impl::OpenAll(const Participant& participant) {
  const std::string partition = owner.channel_partition(channel);
  acks.emplace(participant, partition);
  ETUDE_ASSIGN_OR_RETURN(chunks, OpenReaderOf<BlobChunk>(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(manifests, OpenReaderOf<BlobManifest>(participant, partition));
  ETUDE_RETURN_IF_ERROR(waiter.Open(participant));
  ETUDE_RETURN_IF_ERROR(waiter.AddReader(manifests));
  return waiter.AddReader(chunks);
}

int BlobReceiver::Impl::DrainManifests() {
  return TakeSerialized(manifests, 64, [this](std::span<const std::uint8_t> cdr) {
    ManifestView view;
    if (!Parse(cdr, view) || !ViewIsSound(view))
      TellMalformed(Traits<BlobManifest>::kTopic, ++malformed);
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
      TellMalformed(Traits<BlobChunk>::kTopic, ++malformed);
    else if (view.channel == channel)
      OnChunk(view);
  });
  return announced + taken;
}

void BlobReceiver::Impl::OnManifest(const ManifestView& view) {
  IncomingBlob* const known = inbox.Find(view.sender, view.id);
  if (known == nullptr) return Start(view);
  const bool changed = known->state == State::kReceiving && !IsSame(view, known->manifest);
  if (!changed) return AnswerKnown(view, *known);
  inbox.Remove(*known);
  Start(view);
}

void BlobReceiver::Impl::AnswerKnown(const ManifestView& view, IncomingBlob& blob) {
  blob.last_news = Clock::now();
  blob.manifest.host = view.host;  // a sender that was started again has another address
  switch (blob.state) {
    case State::kReceiving:
      if (view.data.size() == view.size && view.size > 0) return TakeWhole(view, blob);
      return SendProgress(blob, AckKind::kMissing);
    case State::kReady:
    case State::kJudging:
      return SendProgress(blob, AckKind::kProgress);
    case State::kJudged:
      return Answer(blob.manifest, blob.verdict);
  }
}

void BlobReceiver::Impl::Start(const ManifestView& view) {
  BlobManifest manifest = ToManifest(view);
  if (view.size > options.max_blob_size) {
    const Verdict verdict{AckKind::kRefused,
                          fmt::format("{} bytes, at most {} are taken", view.size, options.max_blob_size)};
    Log().warn("blob refused: {} channel={} sender={} id={}", verdict.reason, channel, view.sender, view.id);
    NoteRefused(manifest, verdict.reason);
    inbox.Judge(manifest, verdict);
    return Answer(manifest, verdict);
  }
  IncomingBlob* const blob = inbox.Add(std::move(manifest), Clock::now());
  if (blob == nullptr) return;  // say nothing, and the sender announces it again
  if (view.data.size() == view.size) return TakeWhole(view, *blob);
  blob->assembly.emplace(view.size, view.chunk_size);
  SendProgress(*blob, AckKind::kMissing);
}

// Of a blob that came in its manifest: the one copy out of DDS's memory. Its verdict will be the answer.
void BlobReceiver::Impl::TakeWhole(const ManifestView& view, IncomingBlob& blob) {
  if (!Equal(Sha256Of(view.data), blob.manifest.sha256)) return RefuseCorrupt(blob);
  inbox.Finish(blob, {view.data.begin(), view.data.end()});
}

void BlobReceiver::Impl::OnChunk(const ChunkView& view) {
  IncomingBlob* blob = inbox.Find(view.sender, view.id);
  if (blob == nullptr) {  // the manifest travels on another topic and may be just behind
    for (int batch = 0; batch < kMostBatches && DrainManifests() > 0; ++batch) {
    }
    blob = inbox.Find(view.sender, view.id);
  }
  if (blob == nullptr || blob->state != State::kReceiving) return;
  blob->last_news = Clock::now();
  Assembly& assembly = *blob->assembly;
  const auto added = assembly.Add(view.index, view.data);
  if (added == Assembly::Added::kMalformed) TellMalformed(Traits<BlobChunk>::kTopic, ++malformed);
  if (added != Assembly::Added::kNew) return;
  if (assembly.complete()) {
    if (!Equal(assembly.Digest(), blob->manifest.sha256)) return RefuseCorrupt(*blob);
    inbox.Finish(*blob, assembly.TakeBytes());
    return SendProgress(*blob, AckKind::kProgress);
  }
  const std::uint32_t unreported_chunks = assembly.next() - blob->acknowledged;
  if (unreported_chunks >= kAckEvery) return SendProgress(*blob, AckKind::kProgress);
  if (unreported_chunks == 1) unreported.push_back({std::string(view.sender), view.id});
}

void BlobReceiver::Impl::NoteRefused(const BlobManifest& manifest, const std::string& reason) {
  if (refused.size() < kMostRefused) refused.push_back({manifest, reason});
}

// Not remembered: the sender may try again with the same id.
void BlobReceiver::Impl::RefuseCorrupt(const IncomingBlob& blob) {
  ++corrupt;
  Log().warn("blob refused: its bytes do not fit its checksum channel={} sender={} id={}", channel,
             blob.manifest.sender, blob.manifest.id);
  const Verdict verdict{AckKind::kRefused, "the bytes do not fit the checksum"};
  NoteRefused(blob.manifest, verdict.reason);
  Answer(blob.manifest, verdict);
  inbox.Remove(blob);
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
  return acks->Write(manifest.host, ack);
}

// A lost ack is asked for again by the sender's next announcement.
void BlobReceiver::Impl::Answer(const BlobManifest& manifest, const Verdict& verdict) {
  if (auto written = SendVerdict(manifest, verdict); !written) Log().warn("ack not sent: {}", written.error().message);
}

void BlobReceiver::Impl::SendProgress(IncomingBlob& blob, AckKind kind) {
  BlobAck ack = AckOf(blob.manifest, kind);
  ack.received = blob.assembly ? blob.assembly->next() : blob.manifest.chunk_count;
  if (kind == AckKind::kMissing) ack.missing = blob.assembly->Missing(kMaxMissing);
  blob.acknowledged = ack.received;
  if (auto written = acks->Write(blob.manifest.host, ack); !written)
    Log().warn("ack not sent: {}", written.error().message);
}

void BlobReceiver::Impl::FlushProgress() {
  for (const auto& key : unreported) {
    IncomingBlob* const blob = inbox.Find(key.sender, key.id);
    if (blob == nullptr || blob->state != State::kReceiving) continue;
    if (blob->assembly->next() > blob->acknowledged) SendProgress(*blob, AckKind::kProgress);
  }
  unreported.clear();
}

void BlobReceiver::Impl::Clean() {
  const auto now = Clock::now();
  if (now < next_cleaning) return;
  next_cleaning = now + std::chrono::seconds(5);
  inbox.Clean(now);
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
  impl->inbox = Inbox(options);
  ETUDE_RETURN_IF_ERROR(impl->OpenAll(participant));
  return BlobReceiver(std::move(impl));
}

// The inbox is the receiving thread's.
void BlobReceiver::Impl::TakeVerdicts() {
  const auto taken = [this] {
    const MutexLock lock(mutex);
    return std::exchange(judged, {});
  }();
  for (const auto& [manifest, verdict] : taken) inbox.Judge(manifest, verdict);
}

std::optional<ReceivedBlob> BlobReceiver::Receive(std::chrono::nanoseconds timeout) {
  const auto end = Deadline(timeout);
  impl_->TakeVerdicts();
  impl_->acks->Tidy();
  while (!impl_->inbox.has_finished()) {
    // whoever sends without an end does not hold up the caller
    const bool took = impl_->Drain() > 0;
    if (took && Clock::now() < end && !StopRequested()) continue;
    impl_->TakeVerdicts();
    impl_->FlushProgress();
    impl_->Clean();
    impl_->acks->Tidy();
    if (impl_->inbox.has_finished()) break;
    const auto left = end - Clock::now();
    if (left.count() <= 0 || StopRequested()) return std::nullopt;
    const std::chrono::nanoseconds look = impl_->acks->waiting() ? kHostLook : kIdleLook;
    impl_->waiter.Wait(std::min<std::chrono::nanoseconds>(left, look));
  }
  return impl_->inbox.Pop();
}

Status BlobReceiver::Acknowledge(const BlobManifest& manifest, const Verdict& verdict) {
  {
    const MutexLock lock(impl_->mutex);
    impl_->judged.emplace_back(manifest, verdict);
  }
  return impl_->SendVerdict(manifest, verdict);
}

std::vector<RefusedBlob> BlobReceiver::TakeRefused() { return std::exchange(impl_->refused, {}); }
std::uint64_t BlobReceiver::corrupt_blobs() const { return impl_->corrupt; }
std::uint64_t BlobReceiver::malformed_samples() const { return impl_->malformed; }

}  // namespace etude::bus
