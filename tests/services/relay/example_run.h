// SPDX-License-Identifier: Apache-2.0
// Checkpoints, and a run that publishes them: what relays are tested with.
#pragma once

#include <gtest/gtest.h>

#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "services/bus/blob_transfer.h"
#include "services/bus/directory.h"
#include "services/core/hash.h"
#include "services/store/safetensors.h"

namespace etude::relay {

/// A file of some hundred kilobytes that is a checkpoint for whoever looks at its format; another one for each step.
inline std::vector<std::uint8_t> ExampleCheckpoint(std::uint64_t step) {
  store::Safetensors content;
  content.metadata["step"] = std::to_string(step);
  std::vector<float> weights(100'000, static_cast<float>(step));
  store::Tensor tensor{store::DType::kF32, {static_cast<std::int64_t>(weights.size())}, {}};
  tensor.data.resize(weights.size() * sizeof(float));
  std::memcpy(tensor.data.data(), weights.data(), tensor.data.size());
  content.tensors["weights"] = std::move(tensor);
  return store::EncodeSafetensors(content);
}

/// As a subscriber gets it.
inline bus::PublishedBlob ExampleBlob(const std::string& owner, const std::string& channel, std::uint64_t version,
                                      std::uint64_t step) {
  bus::PublishedBlob blob{
      channel, version, owner, "{\"step\":" + std::to_string(step) + "}", "", ExampleCheckpoint(step)};
  blob.sha256 = Sha256Hex(blob.bytes);
  return blob;
}

/// A run that is there: in the directory, and with checkpoints for late joiners.
class ExampleRun {
 public:
  ExampleRun(const bus::Participant& participant, const bus::Owner& run, const std::string& folder)
      : presence_(bus::Announcement::Open(
            participant, bus::MakePresence(bus::PresenceKind::kRun, run.name, run.id, folder), Claim::kRefuse)),
        publisher_(bus::BlobPublisher::Open(participant, run)) {
    EXPECT_TRUE(presence_) << presence_.error().message;
    EXPECT_TRUE(publisher_) << publisher_.error().message;
  }
  void Publish(const bus::PublishedBlob& blob) {
    const Status published = publisher_->Publish(blob.channel, blob.version, blob.bytes, blob.meta_json);
    EXPECT_TRUE(published) << published.error().message;
  }

 private:
  Result<bus::Announcement> presence_;
  Result<bus::BlobPublisher> publisher_;
};

inline void ExpectSame(const bus::PublishedBlob& got, const bus::PublishedBlob& wanted) {
  EXPECT_EQ(got.channel, wanted.channel);
  EXPECT_EQ(got.version, wanted.version);
  EXPECT_EQ(got.owner, wanted.owner);
  EXPECT_EQ(got.meta_json, wanted.meta_json);
  EXPECT_EQ(got.sha256, wanted.sha256);
  EXPECT_TRUE(got.bytes == wanted.bytes);
}

}  // namespace etude::relay
