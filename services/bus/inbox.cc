// SPDX-License-Identifier: Apache-2.0
#include "services/bus/inbox.h"

#include <algorithm>
#include <utility>

#include "services/core/check.h"

namespace etude::bus {
namespace {

constexpr std::size_t kMostSenders = 4096;
constexpr std::chrono::seconds kForgetAfter{60};

using State = IncomingBlob::State;

// What a blob costs that is not judged yet.
std::uint64_t MemoryOf(const BlobManifest& manifest) { return kBlobRecord + manifest.size + manifest.meta_json.size(); }

}  // namespace

IncomingBlob* Inbox::Find(std::string_view sender, std::uint64_t id) {
  const auto known = senders_.find(sender);
  if (known == senders_.end()) return nullptr;
  const auto blob = known->second.blobs.find(id);
  return blob == known->second.blobs.end() ? nullptr : &blob->second;
}

IncomingBlob* Inbox::Add(BlobManifest manifest, TimePoint now) {
  const std::uint64_t size = MemoryOf(manifest);
  if (memory_ > 0 && memory_ + size > options_.max_memory) return nullptr;
  memory_ += size;
  Sender& sender = senders_[manifest.sender];
  sender.last_begun = now;
  IncomingBlob& blob = sender.blobs[manifest.id];
  blob.manifest = std::move(manifest);
  blob.last_news = now;
  return &blob;
}

void Inbox::Remove(const IncomingBlob& blob) {
  memory_ -= MemoryOf(blob.manifest);
  const std::uint64_t id = blob.manifest.id;
  senders_.find(blob.manifest.sender)->second.blobs.erase(id);
}

void Inbox::Finish(IncomingBlob& blob, std::vector<std::uint8_t> bytes) {
  blob.bytes = std::move(bytes);
  blob.assembly.reset();
  blob.acknowledged = blob.manifest.chunk_count;
  blob.state = State::kReady;
  finished_.push_back({blob.manifest.sender, blob.manifest.id});
}

ReceivedBlob Inbox::Pop() {
  ETUDE_CHECK(has_finished());
  const BlobKey key = std::move(finished_.front());
  finished_.pop_front();
  IncomingBlob& blob = *Find(key.sender, key.id);
  blob.state = State::kJudging;  // whoever popped it holds its memory until it is judged
  return {blob.manifest, std::exchange(blob.bytes, {})};
}

void Inbox::Judge(const BlobManifest& manifest, const Verdict& verdict) {
  const IncomingBlob* const known = Find(manifest.sender, manifest.id);
  if (known != nullptr && (known->state == State::kReceiving || known->state == State::kReady)) return;
  Sender& sender = senders_[manifest.sender];
  IncomingBlob& blob = sender.blobs[manifest.id];
  if (known != nullptr && blob.state == State::kJudging) memory_ -= MemoryOf(blob.manifest);
  if (blob.state != State::kJudged) sender.judged.push_back(manifest.id);
  blob.state = State::kJudged;
  blob.manifest = manifest;
  blob.manifest.meta_json = {};  // of those that are judged many are kept
  blob.verdict = verdict;
  while (sender.judged.size() > std::max(1u, options_.verdicts_kept)) {
    sender.blobs.erase(sender.judged.front());
    sender.judged.pop_front();
  }
}

void Inbox::Clean(TimePoint now) {
  for (auto& [name, sender] : senders_) {
    std::erase_if(sender.blobs, [&](const auto& item) {
      const IncomingBlob& blob = item.second;
      if (blob.state != State::kReceiving || now - blob.last_news < kForgetAfter) return false;
      memory_ -= MemoryOf(blob.manifest);
      return true;
    });
  }
  while (senders_.size() > kMostSenders) {
    const auto oldest = std::min_element(senders_.begin(), senders_.end(), [](const auto& a, const auto& b) {
      return a.second.last_begun < b.second.last_begun;
    });
    const bool only_judged = oldest->second.blobs.size() == oldest->second.judged.size();
    if (!only_judged) return;
    senders_.erase(oldest);
  }
}

}  // namespace etude::bus
