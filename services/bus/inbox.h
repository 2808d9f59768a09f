// SPDX-License-Identifier: Apache-2.0
// What a receiver knows of the blobs that were announced to it. Internal to services/bus.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "services/bus/assembly.h"
#include "services/bus/blob_transfer.h"
#include "services/core/clock.h"

namespace etude::bus {

/// What a blob under way counts beside its bytes: its record and its names. Without it, a bound on memory would be none
/// for a million manifests of a byte each.
inline constexpr std::uint64_t kBlobRecord = 1024;

struct BlobKey {
  std::string sender;
  std::uint64_t id = 0;
};

struct IncomingBlob {
  enum class State { kReceiving, kReady, kJudging, kJudged };
  State state = State::kReceiving;
  BlobManifest manifest;                   // data is empty
  std::optional<Assembly> assembly;        // kReceiving, of a blob that comes in chunks
  std::vector<std::uint8_t> bytes;         // kReady
  Verdict verdict;                         // kJudged
  std::uint32_t acknowledged = 0;          // chunks reported to the sender
  MonotonicClock::time_point last_news{};  // from its sender
};

/// The blobs of every sender: those under way, which count as memory until they are judged, and the last ones judged.
/// Pointers and references stay valid until their blob is removed, forgotten or has lost its place among the judged.
/// Not thread-safe.
class Inbox {
 public:
  using TimePoint = MonotonicClock::time_point;

  explicit Inbox(const ReceiveOptions& options = {}) : options_(options) {}

  IncomingBlob* Find(std::string_view sender, std::uint64_t id);
  /// A blob that is not known yet; nullptr when there is no room for it now. One alone may always be there.
  IncomingBlob* Add(BlobManifest manifest, TimePoint now);
  void Remove(const IncomingBlob& blob);
  /// All of it is there and verified: it waits for Pop.
  void Finish(IncomingBlob& blob, std::vector<std::uint8_t> bytes);
  bool has_finished() const { return !finished_.empty(); }
  /// The one that was finished first. @pre has_finished().
  ReceivedBlob Pop();
  /// Keeps the verdict as one of its sender's last `verdicts_kept`: of a blob that was popped, or never added. One that
  /// is under way stays so.
  void Judge(const BlobManifest& manifest, const Verdict& verdict);
  /// Forgets blobs that nobody has sent for a minute, and the senders beyond 4096 that were there first.
  void Clean(TimePoint now);
  std::uint64_t memory() const { return memory_; }  ///< of the blobs that came and are not judged yet, bytes

 private:
  struct Sender {
    std::map<std::uint64_t, IncomingBlob> blobs;
    std::deque<std::uint64_t> judged;  // oldest first
    TimePoint last_begun{};
  };

  ReceiveOptions options_;
  std::map<std::string, Sender, std::less<>> senders_;
  std::deque<BlobKey> finished_;
  std::uint64_t memory_ = 0;
};

}  // namespace etude::bus
