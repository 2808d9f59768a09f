// SPDX-License-Identifier: Apache-2.0
#include "services/cli/topic_rates.h"

#include <algorithm>

#include "services/episode/bounded_json.h"

namespace etude::cli {
namespace {

struct Count {
  double samples = 0, bytes = 0;
};

// What a process has written so far, by topic.
std::map<std::string, Count> Written(const bus::ProcessStatus& status) {
  std::map<std::string, Count> counts;
  const auto topics = ParseBoundedJson(status.topics_json, 3);
  if (!topics || !topics->is_array()) return counts;
  for (const auto& topic : *topics) {
    const auto number = [&](const char* key) {
      return topic.contains(key) && topic[key].is_number() ? topic[key].get<double>() : 0.0;
    };
    if (!topic.is_object() || !topic.contains("topic") || !topic["topic"].is_string()) continue;
    if (!topic.contains("kind") || topic["kind"] != "writer") continue;
    counts[topic["topic"].get<std::string>()] = {number("samples"), number("bytes")};
  }
  return counts;
}

}  // namespace

void TopicRates::Begin(const BusView& view) { first_ = view.processes; }

std::map<std::string, TopicRate> TopicRates::End(const BusView& view) const {
  std::map<std::string, TopicRate> rates;
  for (const auto& [process, last] : view.processes) {
    const auto first = first_.find(process);
    if (first == first_.end()) continue;
    const double seconds = first->second.AgeSeconds(last.at);
    if (!(seconds > 0)) continue;
    const auto before = Written(first->second.message);
    for (const auto& [topic, count] : Written(last.message)) {
      const auto from = before.find(topic);
      const Count was = from == before.end() ? Count() : from->second;
      TopicRate& rate = rates[topic];
      rate.samples_per_second += std::max(0.0, count.samples - was.samples) / seconds;
      rate.bytes_per_second += std::max(0.0, count.bytes - was.bytes) / seconds;
      ++rate.writers;
    }
  }
  return rates;
}

}  // namespace etude::cli
