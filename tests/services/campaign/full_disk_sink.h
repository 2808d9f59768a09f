// SPDX-License-Identifier: Apache-2.0
// A collector's disk that is full for a while.
#pragma once

#include <atomic>
#include <memory>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "services/campaign/sink.h"

namespace etude::campaign {

// A sink whose disk is full for a while, for episodes or for what is written at the end.
class FullDiskSink : public EpisodeSink {
 public:
  enum class Of { kEpisodes, kIndex };
  FullDiskSink(std::unique_ptr<EpisodeSink> inner, std::atomic<bool>& full, Of of = Of::kEpisodes)
      : inner_(std::move(inner)), full_(full), of_(of) {}
  const Path& folder() const override { return inner_->folder(); }
  const std::set<std::uint64_t>& committed() const override { return inner_->committed(); }
  std::vector<Status> CommitGroup(std::span<const store::ArrivedEpisode> group) override {
    if (of_ == Of::kEpisodes && full_) return std::vector<Status>(group.size(), NoSpace());
    return inner_->CommitGroup(group);
  }
  Status RecordFailure(std::uint64_t index, std::uint32_t attempt, const std::string& outcome,
                       const std::string& details_json) override {
    return inner_->RecordFailure(index, attempt, outcome, details_json);
  }
  Status WriteIndex() override { return of_ == Of::kIndex && full_ ? NoSpace() : inner_->WriteIndex(); }
  Status WriteFilterKey(const std::string& name, const std::set<std::uint64_t>& indices) override {
    return inner_->WriteFilterKey(name, indices);
  }

 private:
  static Status NoSpace() { return Fail(Code::kUnavailable, "write 'x': No space left on device"); }
  std::unique_ptr<EpisodeSink> inner_;
  std::atomic<bool>& full_;
  const Of of_;
};

}  // namespace etude::campaign
