// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/live/sample_tap.h"

#include <algorithm>

#include "services/core/log.h"
#include "services/monitor/topics.h"

namespace etude::live {
namespace {

constexpr std::size_t kMostPartitions = 16;  // of a topic
constexpr int kJoinEvery = 8;                // reads

}  // namespace

// A new run or campaign has a partition of its own.
void SampleTap::Join(const std::string& topic, Tapped& tapped) {
  const auto endpoints = bus::Endpoints(participant_);
  if (!endpoints) return;
  const auto written = monitor::WrittenPartitions(*endpoints, topic);
  const auto over = [&](const auto& item) { return std::ranges::count(written, item.first) == 0; };
  std::erase_if(tapped.readers, over);
  std::erase_if(tapped.newest, over);
  std::erase_if(tapped.refused, over);
  for (const auto& partition : written) {
    if (tapped.readers.contains(partition) || tapped.readers.size() >= kMostPartitions) continue;
    if (tapped.refused.contains(partition)) continue;
    auto reader = bus::Echo::Open(participant_, topic, partition);
    if (reader) {
      tapped.readers.emplace(partition, std::move(*reader));
      continue;
    }
    Log().warn("topic={} partition={}: {}", topic, partition, reader.error().message);
    tapped.refused.emplace(partition, reader.error());
  }
}

std::map<std::string, Result<std::vector<Sample>>> SampleTap::Read(const std::vector<std::string>& topics) {
  std::erase_if(tapped_, [&](const auto& item) { return std::ranges::find(topics, item.first) == topics.end(); });
  std::map<std::string, Result<std::vector<Sample>>> all;
  for (const auto& topic : topics) {
    Tapped& tapped = tapped_[topic];
    if (tapped.round++ % kJoinEvery == 0) Join(topic, tapped);
    for (auto& [partition, reader] : tapped.readers)
      for (auto& message : reader->Take())
        tapped.newest[partition] = {partition, std::move(message), MonotonicClock::now()};
    if (tapped.readers.empty() && !tapped.refused.empty()) {
      all.emplace(topic, Fail(tapped.refused.begin()->second));
      continue;
    }
    std::vector<Sample> samples;
    for (const auto& [partition, sample] : tapped.newest) samples.push_back(sample);
    all.emplace(topic, std::move(samples));
  }
  return all;
}

}  // namespace etude::live
