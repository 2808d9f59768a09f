// SPDX-License-Identifier: Apache-2.0
#include "services/monitor/topics.h"

#include <fmt/format.h>

#include <algorithm>

#include "services/episode/bounded_json.h"

namespace etude::monitor {

std::map<std::string, TopicRow> TopicRows(const std::vector<bus::PeerEndpoint>& endpoints, const std::string& own) {
  std::map<std::string, TopicRow> rows;
  for (const auto& endpoint : endpoints) {
    if (endpoint.participant == own) continue;
    TopicRow& row = rows[endpoint.topic];
    row.types.insert(endpoint.type);
    row.qos.insert(bus::QosText(endpoint));
    (endpoint.is_writer ? row.writers : row.readers).push_back(endpoint);
  }
  for (auto& [topic, row] : rows)
    for (const auto& writer : row.writers)
      for (const auto& reader : row.readers)
        if (const std::string why = bus::Mismatch(writer, reader); !why.empty()) row.problems.insert(why);
  return rows;
}

std::map<std::string, std::string> PeerNames(const Processes& processes) {
  std::map<std::string, std::string> names;
  for (const auto& [process, heard] : processes) {
    const bus::ProcessStatus& status = heard.message;
    names[status.participant] = fmt::format("{} {}@{}", status.role, status.pid, status.host);
  }
  return names;
}

OrderedJson TopicJson(const std::string& topic, const TopicRow& row, const std::map<std::string, std::string>& names) {
  OrderedJson json{{"topic", topic}, {"types", row.types}, {"qos", row.qos}, {"problems", row.problems}};
  for (const auto* side : {&row.writers, &row.readers}) {
    OrderedJson list = OrderedJson::array();
    for (const auto& endpoint : *side) {
      const auto name = names.find(endpoint.participant);
      list.push_back({{"peer", name == names.end() ? "" : name->second},
                      {"participant", endpoint.participant},
                      {"partitions", endpoint.partitions}});
    }
    json[side == &row.writers ? "writers" : "readers"] = std::move(list);
  }
  return json;
}

std::set<std::string> WrittenPartitions(const std::vector<bus::PeerEndpoint>& endpoints, const std::string& topic) {
  std::set<std::string> partitions;
  for (const auto& endpoint : endpoints)
    if (endpoint.is_writer && endpoint.topic == topic)
      partitions.insert(endpoint.partitions.begin(), endpoint.partitions.end());
  partitions.erase("");
  return partitions;
}

bool IsBulk(const std::string& topic) { return topic == "etude/blob/chunk" || topic == "etude/blob/manifest"; }

std::map<std::string, TopicCount> Written(const bus::ProcessStatus& status) {
  std::map<std::string, TopicCount> counts;
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

std::map<std::string, TopicRate> TopicRates::End(const Processes& processes) const {
  std::map<std::string, TopicRate> rates;
  for (const auto& [process, last] : processes) {
    const auto first = first_.find(process);
    if (first == first_.end()) continue;
    const double seconds = first->second.AgeSeconds(last.at);
    if (!(seconds > 0)) continue;
    const auto before = Written(first->second.message);
    for (const auto& [topic, count] : Written(last.message)) {
      const auto from = before.find(topic);
      const TopicCount was = from == before.end() ? TopicCount() : from->second;
      TopicRate& rate = rates[topic];
      rate.samples_per_second += std::max(0.0, count.samples - was.samples) / seconds;
      rate.bytes_per_second += std::max(0.0, count.bytes - was.bytes) / seconds;
      ++rate.writers;
    }
  }
  return rates;
}

}  // namespace etude::monitor
