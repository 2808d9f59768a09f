// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <deque>

#include "services/bus/assembly.h"
#include "services/bus/manifest_intake.h"
#include "services/bus/object_channel.h"
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

// An object between Begin and its verdict.
struct Flight {
  ObjectManifest manifest;  // without data
  std::span<const std::uint8_t> bytes;
  bool inlined = false;               // travels inside the manifest
  int announced = 0;                  // times
  std::uint32_t sent = 0;             // chunks sent, in order from 0
  std::uint32_t received = 0;         // chunks the receiver has, in order from 0
  std::vector<std::uint32_t> resend;  // chunks before `sent` that the receiver lacks
  Clock::time_point announce_at;      // without news until then: announce again
  milliseconds patience = kFirstPatience;

  std::uint32_t units() const { return inlined ? 1 : manifest.chunk_count; }
  std::uint32_t in_window() const { return sent > received ? sent - received : 0; }
};

Clock::time_point After(std::chrono::nanoseconds timeout) {
  const auto now = Clock::now();
  const auto latest = Clock::time_point::max();
  return timeout > latest - now ? latest : now + timeout;
}

bool IsVerdict(AckKind kind) {
  return kind == AckKind::kDone || kind == AckKind::kDuplicate || kind == AckKind::kRefused;
}

}  // namespace

struct ObjectSender::Impl {
  std::string channel;
  std::string sender;
  SendOptions options;
  Endpoint manifests;
  Endpoint chunks;
  Endpoint acks;
  Waiter waiter;
  std::deque<Flight> flights;
  std::deque<Sent> verdicts;
  int receivers = 0;
  std::uint32_t receivers_ever = 0;
  std::uint64_t malformed = 0;

  Status OpenAll(const Participant& participant, const std::string& partition);
  Flight MakeFlight(std::uint64_t id, std::span<const std::uint8_t> bytes, std::uint64_t token,
                    const std::string& meta_json) const;
  /// Sends what the window allows.
  void Pump();
  bool PumpFlight(Flight& flight, std::uint32_t& in_window);
  bool Announce(Flight& flight);
  bool SendChunk(const Flight& flight, std::uint32_t index);
  void CheckReceivers();
  bool AnnounceOverdue();
  void TakeAcks();
  void OnAck(const ObjectAck& ack, std::uint64_t id);
  void OnProgress(Flight& flight, const ObjectAck& ack);
  std::optional<Sent> Next(std::chrono::nanoseconds timeout, const std::uint64_t* only);
  std::optional<Sent> PopVerdict(const std::uint64_t* only);
  Clock::time_point NextAnnouncement() const;
  std::deque<Flight>::iterator Find(std::uint64_t id) {
    return std::find_if(flights.begin(), flights.end(),
                        [id](const Flight& flight) { return flight.manifest.id == id; });
  }
};

Status ObjectSender::Impl::OpenAll(const Participant& participant, const std::string& partition) {
  const std::string own = partition + "/" + channel;
  ETUDE_ASSIGN_OR_RETURN(manifests, OpenWriterOf<ObjectManifest>(participant, own));
  ETUDE_ASSIGN_OR_RETURN(chunks, OpenWriterOf<ObjectChunk>(participant, own));
  ETUDE_ASSIGN_OR_RETURN(acks, OpenReaderOf<ObjectAck>(participant, own));
  ETUDE_RETURN_IF_ERROR(waiter.Open(participant));
  ETUDE_RETURN_IF_ERROR(waiter.AddMatched(manifests));
  ETUDE_RETURN_IF_ERROR(waiter.AddMatched(chunks));
  ETUDE_RETURN_IF_ERROR(waiter.AddMatched(acks));
  return waiter.AddReader(acks);
}

Flight ObjectSender::Impl::MakeFlight(std::uint64_t id, std::span<const std::uint8_t> bytes, std::uint64_t token,
                                      const std::string& meta_json) const {
  Flight flight;
  flight.bytes = bytes;
  flight.inlined = bytes.size() <= options.chunk_size;
  auto& manifest = flight.manifest;
  manifest.channel = channel;
  manifest.sender = sender;
  manifest.id = id;
  manifest.size = bytes.size();
  manifest.chunk_size = options.chunk_size;
  manifest.chunk_count = ChunkCount(bytes.size(), options.chunk_size);
  manifest.token = token;
  manifest.meta_json = meta_json;
  if (options.integrity == Integrity::kSha256) {
    const auto digest = Sha256Of(bytes);
    manifest.sha256.assign(digest.begin(), digest.end());
  } else {
    const auto crc = CrcBytes(bytes);
    manifest.crc32c.assign(crc.begin(), crc.end());
  }
  return flight;
}

void ObjectSender::Impl::Pump() {
  if (receivers == 0 || !AnnounceOverdue()) return;
  std::uint32_t in_window = 0;
  for (const auto& flight : flights) in_window += flight.in_window();
  for (auto& flight : flights) {
    if (!PumpFlight(flight, in_window)) return;
  }
}

// False when nothing more can be sent now.
bool ObjectSender::Impl::PumpFlight(Flight& flight, std::uint32_t& in_window) {
  while (!flight.resend.empty()) {
    if (!SendChunk(flight, flight.resend.back())) return false;
    flight.resend.pop_back();
  }
  while (flight.sent < flight.units() || flight.announced == 0) {
    if (in_window >= options.window) return false;
    if (flight.announced == 0 || flight.inlined) {
      if (!Announce(flight)) return false;
      if (flight.inlined) ++in_window;
      continue;
    }
    if (!SendChunk(flight, flight.sent)) return false;
    ++flight.sent;
    ++in_window;
  }
  return true;
}

bool ObjectSender::Impl::Announce(Flight& flight) {
  auto wire = Encode(flight.manifest);
  if (!wire) {  // Begin has tried it
    Log().error("announce object {}: {}", flight.manifest.id, wire.error().message);
    return false;
  }
  const bool with_data = flight.inlined && flight.received == 0;
  if (with_data) {
    wire->data._maximum = wire->data._length = static_cast<std::uint32_t>(flight.bytes.size());
    wire->data._buffer = const_cast<std::uint8_t*>(flight.bytes.data());
  }
  if (dds_write(manifests.get(), &*wire) != DDS_RETCODE_OK) return false;
  if (with_data) flight.sent = 1;
  if (flight.announced > 0) flight.patience = std::min(2 * flight.patience, options.resend_after);
  ++flight.announced;
  flight.announce_at = Clock::now() + flight.patience;
  return true;
}

bool ObjectSender::Impl::SendChunk(const Flight& flight, std::uint32_t index) {
  const auto data = ChunkOf(flight.bytes, flight.manifest.chunk_size, index);
  etude_wire_ObjectChunk wire{};
  wire.id = flight.manifest.id;
  wire.index = index;
  Encoder encode;
  encode("channel", channel, wire.channel);
  encode("sender", sender, wire.sender);
  wire.data._maximum = wire.data._length = static_cast<std::uint32_t>(data.size());
  wire.data._buffer = const_cast<std::uint8_t*>(data.data());
  return dds_write(chunks.get(), &wire) == DDS_RETCODE_OK;
}

void ObjectSender::Impl::CheckReceivers() {
  dds_publication_matched_status_t status{};
  dds_get_publication_matched_status(manifests.get(), &status);
  receivers = std::min({static_cast<int>(status.current_count), MatchedReaders(chunks), MatchedWriters(acks)});
  if (status.total_count == receivers_ever) return;
  receivers_ever = status.total_count;
  // a receiver (re)appeared and may know nothing of what is under way
  for (auto& flight : flights) {
    flight.announce_at = Clock::now();
    flight.patience = kFirstPatience;
  }
}

// Also the way to learn what a receiver lacks: it answers an announcement of a known object.
bool ObjectSender::Impl::AnnounceOverdue() {
  const auto now = Clock::now();
  for (auto& flight : flights) {
    if (flight.announced > 0 && flight.announce_at <= now && !Announce(flight)) return false;
  }
  return true;
}

void ObjectSender::Impl::TakeAcks() {
  for (const auto& ack : TakeMessages<ObjectAck>(acks, 1024, malformed)) {
    if (ack.channel != channel || ack.sender != sender) continue;
    OnAck(ack, ack.id);
    for (const auto id : ack.also) OnAck(ack, id);
  }
}

void ObjectSender::Impl::OnAck(const ObjectAck& ack, std::uint64_t id) {
  const auto flight = Find(id);
  if (flight == flights.end()) return;  // a late answer
  if (!IsVerdict(ack.kind)) return OnProgress(*flight, ack);
  verdicts.push_back({id, {ack.kind, ack.reason}});
  flights.erase(flight);
}

void ObjectSender::Impl::OnProgress(Flight& flight, const ObjectAck& ack) {
  flight.patience = options.resend_after;
  flight.announce_at = Clock::now() + flight.patience;
  if (flight.inlined) {
    const bool has_it = ack.kind == AckKind::kProgress;
    flight.received = has_it ? 1 : 0;
    if (!has_it && flight.announced > 1) flight.sent = 0;
    return;
  }
  const std::uint32_t received = std::min(ack.received, flight.units());
  if (ack.kind == AckKind::kProgress) {
    flight.received = std::max(flight.received, received);
    return;
  }
  // a receiver answers the first announcement too, before it can have the chunks
  if (flight.announced < 2) return;
  flight.resend.clear();
  if (received < flight.received) {  // it has lost what it had
    flight.sent = received;
  } else {
    for (const auto index : ack.missing) {
      if (index < flight.sent) flight.resend.push_back(index);
    }
    std::sort(flight.resend.rbegin(), flight.resend.rend());  // taken from the back
  }
  flight.received = received;
}

std::optional<Sent> ObjectSender::Impl::PopVerdict(const std::uint64_t* only) {
  const auto found = std::find_if(verdicts.begin(), verdicts.end(),
                                  [only](const Sent& sent) { return only == nullptr || sent.id == *only; });
  if (found == verdicts.end()) return std::nullopt;
  Sent sent = std::move(*found);
  verdicts.erase(found);
  return sent;
}

Clock::time_point ObjectSender::Impl::NextAnnouncement() const {
  auto next = Clock::time_point::max();
  if (receivers == 0) return next;
  for (const auto& flight : flights) {
    if (flight.announced > 0) next = std::min(next, flight.announce_at);
  }
  return next;
}

std::optional<Sent> ObjectSender::Impl::Next(std::chrono::nanoseconds timeout, const std::uint64_t* only) {
  const auto end = After(timeout);
  for (;;) {
    if (auto sent = PopVerdict(only)) return sent;
    TakeAcks();
    CheckReceivers();
    Pump();
    if (auto sent = PopVerdict(only)) return sent;
    const auto now = Clock::now();
    if (StopRequested() || now >= end || flights.empty()) return std::nullopt;
    const auto wake = std::min(end, std::max(NextAnnouncement(), now + milliseconds(1)));
    waiter.Wait(wake - now);
  }
}

ObjectSender::ObjectSender(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
ObjectSender::ObjectSender(ObjectSender&&) noexcept = default;
ObjectSender& ObjectSender::operator=(ObjectSender&&) noexcept = default;
ObjectSender::~ObjectSender() = default;

Result<ObjectSender> ObjectSender::Open(const Participant& participant, const std::string& partition,
                                        const std::string& channel, const std::string& sender,
                                        const SendOptions& options) {
  if (options.chunk_size == 0 || options.chunk_size > kMaxChunkSize || options.window == 0 || options.window > 1024) {
    return Fail(Code::kInvalidArgument,
                fmt::format("object sender '{}': chunk_size {} (1 to {}), window {} (1 to 1024)", sender,
                            options.chunk_size, kMaxChunkSize, options.window));
  }
  auto impl = std::make_unique<Impl>();
  impl->channel = channel;
  impl->sender = sender;
  impl->options = options;
  ETUDE_RETURN_IF_ERROR(impl->OpenAll(participant, partition));
  return ObjectSender(std::move(impl));
}

Status ObjectSender::Begin(std::uint64_t id, std::span<const std::uint8_t> bytes, std::uint64_t token,
                           const std::string& meta_json) {
  if (impl_->Find(id) != impl_->flights.end()) {
    return Fail(Code::kInvalidArgument, fmt::format("begin object {}: it is under way", id));
  }
  Flight flight = impl_->MakeFlight(id, bytes, token, meta_json);
  if (auto wire = Encode(flight.manifest); !wire) {
    return Fail(wire.error().Wrap(fmt::format("begin object {}", id)));
  }
  impl_->flights.push_back(std::move(flight));
  if (impl_->receivers == 0) impl_->CheckReceivers();
  impl_->Pump();
  return {};
}

std::optional<Sent> ObjectSender::Next(std::chrono::nanoseconds timeout) { return impl_->Next(timeout, nullptr); }

void ObjectSender::Cancel(std::uint64_t id) {
  const auto flight = impl_->Find(id);
  if (flight != impl_->flights.end()) impl_->flights.erase(flight);
}

std::size_t ObjectSender::in_flight() const { return impl_->flights.size(); }

int ObjectSender::matched_receivers() const {
  return std::min({MatchedReaders(impl_->manifests), MatchedReaders(impl_->chunks), MatchedWriters(impl_->acks)});
}

Result<Verdict> ObjectSender::Send(std::uint64_t id, std::span<const std::uint8_t> bytes, std::uint64_t token,
                                   const std::string& meta_json, std::chrono::nanoseconds timeout) {
  ETUDE_RETURN_IF_ERROR(Begin(id, bytes, token, meta_json));
  if (auto sent = impl_->Next(timeout, &id)) return std::move(sent->verdict);
  const auto flight = impl_->Find(id);
  std::string progress = "no chunk acknowledged";
  if (flight != impl_->flights.end()) {
    progress =
        fmt::format("{} of {} chunks acknowledged, {} receivers", flight->received, flight->units(), impl_->receivers);
  }
  Cancel(id);
  return Fail(Code::kTimeout,
              fmt::format("send object {} of {} bytes on channel '{}': {} ({})", id, bytes.size(), impl_->channel,
                          StopRequested() ? "a stop was requested" : "no verdict in time", progress));
}

}  // namespace etude::bus
