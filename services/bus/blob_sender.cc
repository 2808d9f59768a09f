// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <utility>

#include "services/bus/assembly.h"
#include "services/bus/blob_transfer.h"
#include "services/bus/typed.h"
#include "services/core/clock.h"
#include "services/core/hash.h"
#include "services/core/log.h"
#include "services/core/stop.h"

namespace etude::bus {
namespace {

using Clock = MonotonicClock;
using std::chrono::milliseconds;

// The first announcement may come before the receiver's acks find their way back: ask again soon.
constexpr milliseconds kFirstPatience{50};

// The blob that is being sent.
struct Transfer {
  BlobManifest manifest;  // without data
  std::span<const std::uint8_t> bytes;
  bool inlined = false;               // travels inside the manifest
  int announced = 0;                  // times
  std::uint32_t sent = 0;             // chunks sent, in order from 0
  std::uint32_t received = 0;         // chunks the receiver has, in order from 0
  std::vector<std::uint32_t> resend;  // chunks before `sent` that the receiver lacks
  Clock::time_point announce_at;      // without news until then: announce again
  milliseconds patience = kFirstPatience;
  std::optional<Verdict> verdict;

  std::uint32_t units() const { return inlined ? 1 : manifest.chunk_count; }
  std::uint32_t in_window() const { return sent > received ? sent - received : 0; }
};

bool IsVerdict(AckKind kind) {
  return kind == AckKind::kDone || kind == AckKind::kDuplicate || kind == AckKind::kRefused;
}

}  // namespace

struct BlobSender::Impl {
  Owner owner;
  std::string channel;
  std::string sender;
  std::string host;
  SendOptions options;
  Endpoint manifests;
  Endpoint chunks;
  Endpoint acks;
  Waiter waiter;
  Transfer transfer;
  int receivers = 0;
  std::uint32_t receivers_ever = 0;
  std::uint64_t malformed = 0;

  Status OpenAll(const Participant& participant);
  void Begin(std::uint64_t id, std::span<const std::uint8_t> bytes, std::uint64_t token, const std::string& meta_json);
  void RunUntilVerdict(std::chrono::nanoseconds timeout);
  void Pump();
  bool Announce();
  bool SendChunk(std::uint32_t index);
  void CheckReceivers();
  void TakeAcks();
  void OnProgress(const BlobAck& ack);
};

Status BlobSender::Impl::OpenAll(const Participant& participant) {
  const std::string partition = owner.channel_partition(channel);
  host = participant.address();
  ETUDE_ASSIGN_OR_RETURN(manifests, OpenWriterOf<BlobManifest>(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(chunks, OpenWriterOf<BlobChunk>(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(acks, OpenReaderOf<BlobAck>(participant, PartitionOfAddress(partition, host)));
  ETUDE_RETURN_IF_ERROR(waiter.Open(participant));
  ETUDE_RETURN_IF_ERROR(waiter.AddMatched(manifests));
  ETUDE_RETURN_IF_ERROR(waiter.AddMatched(chunks));
  return waiter.AddReader(acks);
}

void BlobSender::Impl::Begin(std::uint64_t id, std::span<const std::uint8_t> bytes, std::uint64_t token,
                             const std::string& meta_json) {
  transfer = {};
  transfer.bytes = bytes;
  transfer.inlined = bytes.size() <= options.chunk_size;
  auto& manifest = transfer.manifest;
  manifest.channel = channel;
  manifest.sender = sender;
  manifest.owner = owner.id;
  manifest.host = host;
  manifest.id = id;
  manifest.size = bytes.size();
  manifest.chunk_size = options.chunk_size;
  manifest.chunk_count = ChunkCount(bytes.size(), options.chunk_size);
  manifest.token = token;
  manifest.meta_json = meta_json;
  const auto digest = Sha256Of(bytes);
  manifest.sha256.assign(digest.begin(), digest.end());
}

// Sends what the window allows.
void BlobSender::Impl::Pump() {
  if (receivers == 0) return;
  // also the way to learn what a receiver lacks: it answers an announcement of a known blob
  const bool overdue = transfer.announced > 0 && transfer.announce_at <= Clock::now();
  if (overdue && !Announce()) return;
  while (!transfer.resend.empty()) {
    if (!SendChunk(transfer.resend.back())) return;
    transfer.resend.pop_back();
  }
  while (transfer.announced == 0 || (transfer.sent < transfer.units() && transfer.in_window() < options.window)) {
    if (transfer.announced == 0 || transfer.inlined) {
      if (!Announce()) return;
      continue;
    }
    if (!SendChunk(transfer.sent)) return;
    ++transfer.sent;
  }
}

bool BlobSender::Impl::Announce() {
  auto wire = Encode(transfer.manifest);
  if (!wire) {  // Send has tried it
    Log().error("announce blob {}: {}", transfer.manifest.id, wire.error().message);
    return false;
  }
  const bool with_data = transfer.inlined && transfer.received == 0;
  if (with_data) {
    wire->data._maximum = wire->data._length = static_cast<std::uint32_t>(transfer.bytes.size());
    wire->data._buffer = const_cast<std::uint8_t*>(transfer.bytes.data());
  }
  if (dds_write(manifests.get(), &*wire) != DDS_RETCODE_OK) return false;
  manifests.traffic->Add(wire->data._length + transfer.manifest.meta_json.size());
  if (with_data) transfer.sent = 1;
  if (transfer.announced > 0) transfer.patience = std::min(2 * transfer.patience, options.resend_after);
  ++transfer.announced;
  transfer.announce_at = Clock::now() + transfer.patience;
  return true;
}

bool BlobSender::Impl::SendChunk(std::uint32_t index) {
  const auto data = ChunkOf(transfer.bytes, transfer.manifest.chunk_size, index);
  etude_wire_BlobChunk wire{};
  wire.id = transfer.manifest.id;
  wire.index = index;
  Encoder encode;
  encode("channel", channel, wire.channel);
  encode("sender", sender, wire.sender);
  wire.data._maximum = wire.data._length = static_cast<std::uint32_t>(data.size());
  wire.data._buffer = const_cast<std::uint8_t*>(data.data());
  if (dds_write(chunks.get(), &wire) != DDS_RETCODE_OK) return false;
  chunks.traffic->Add(data.size());
  return true;
}

void BlobSender::Impl::CheckReceivers() {
  dds_publication_matched_status_t status{};
  dds_get_publication_matched_status(manifests.get(), &status);
  // who acknowledges comes to this host when it hears of it
  receivers = std::min(static_cast<int>(status.current_count), MatchedReaders(chunks));
  if (status.total_count == receivers_ever) return;
  receivers_ever = status.total_count;
  // a receiver (re)appeared and may know nothing of what is under way
  transfer.announce_at = Clock::now();
  transfer.patience = kFirstPatience;
}

void BlobSender::Impl::TakeAcks() {
  for (const auto& ack : TakeMessages<BlobAck>(acks, 1024, malformed)) {
    if (ack.channel != channel || ack.sender != sender || ack.owner != owner.id) continue;
    if (ack.id != transfer.manifest.id) continue;  // a late answer
    if (IsVerdict(ack.kind))
      transfer.verdict = {ack.kind, ack.reason};
    else
      OnProgress(ack);
  }
}

void BlobSender::Impl::OnProgress(const BlobAck& ack) {
  transfer.patience = options.resend_after;
  transfer.announce_at = Clock::now() + transfer.patience;
  if (transfer.inlined) {
    const bool has_it = ack.kind == AckKind::kProgress;
    transfer.received = has_it ? 1 : 0;
    if (has_it || transfer.announced > 1) transfer.sent = transfer.received;
    return;
  }
  const std::uint32_t received = std::min(ack.received, transfer.units());
  if (ack.kind == AckKind::kProgress) {
    transfer.received = std::max(transfer.received, received);
    return;
  }
  // a receiver answers the first announcement too, before it can have the chunks
  if (transfer.announced < 2) return;
  transfer.resend.clear();
  if (received < transfer.received) {  // it has lost what it had
    transfer.sent = received;
  } else {
    for (const auto index : ack.missing) {
      if (index < transfer.sent) transfer.resend.push_back(index);
    }
    std::sort(transfer.resend.rbegin(), transfer.resend.rend());  // taken from the back
  }
  transfer.received = received;
}

// Or until `timeout`, or a stop request.
void BlobSender::Impl::RunUntilVerdict(std::chrono::nanoseconds timeout) {
  const auto end = Deadline(timeout);
  for (;;) {
    TakeAcks();
    if (transfer.verdict) return;
    CheckReceivers();
    Pump();
    const auto now = Clock::now();
    if (StopRequested() || now >= end) return;
    const auto next = receivers > 0 ? transfer.announce_at : Clock::time_point::max();
    waiter.Wait(std::min(end, std::max(next, now + milliseconds(1))) - now);
  }
}

BlobSender::BlobSender(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
BlobSender::BlobSender(BlobSender&&) noexcept = default;
BlobSender& BlobSender::operator=(BlobSender&&) noexcept = default;
BlobSender::~BlobSender() = default;

Result<BlobSender> BlobSender::Open(const Participant& participant, const Owner& owner, const std::string& channel,
                                    const std::string& sender, const SendOptions& options) {
  if (options.chunk_size == 0 || options.chunk_size > kMaxChunkSize || options.window == 0 || options.window > 1024) {
    return Fail(Code::kInvalidArgument, fmt::format("blob sender '{}': chunk_size {} (1 to {}), window {} (1 to 1024)",
                                                    sender, options.chunk_size, kMaxChunkSize, options.window));
  }
  auto impl = std::make_unique<Impl>();
  impl->owner = owner;
  impl->channel = channel;
  impl->sender = sender;
  impl->options = options;
  ETUDE_RETURN_IF_ERROR(impl->OpenAll(participant));
  return BlobSender(std::move(impl));
}

Result<Verdict> BlobSender::Send(std::uint64_t id, std::span<const std::uint8_t> bytes, std::uint64_t token,
                                 const std::string& meta_json, std::chrono::nanoseconds timeout) {
  impl_->Begin(id, bytes, token, meta_json);
  if (auto wire = Encode(impl_->transfer.manifest); !wire) {
    return Fail(wire.error().Wrap(fmt::format("send blob {}", id)));
  }
  impl_->RunUntilVerdict(timeout);
  const Transfer transfer = std::exchange(impl_->transfer, {});
  if (transfer.verdict) return *transfer.verdict;
  return Fail(
      Code::kTimeout,
      fmt::format("send blob {} of {} bytes on channel '{}': {} ({} of {} chunks acknowledged, {} receivers)", id,
                  bytes.size(), impl_->channel, StopRequested() ? "a stop was requested" : "no verdict in time",
                  transfer.received, transfer.units(), impl_->receivers));
}

}  // namespace etude::bus
