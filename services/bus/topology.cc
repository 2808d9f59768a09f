// SPDX-License-Identifier: Apache-2.0
#include "services/bus/topology.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "services/bus/builtin_topic.h"
#include "services/bus/participant_state.h"
#include "services/bus/topic.h"
#include "services/bus/wire.h"
#include "services/core/config.h"

namespace etude::bus {
namespace {

std::vector<std::string> PartitionsOf(const dds_qos_t* qos) {
  std::uint32_t count = 0;
  char** names = nullptr;
  std::vector<std::string> partitions;
  if (!dds_qget_partition(qos, &count, &names)) return partitions;
  for (std::uint32_t i = 0; i < count; ++i) {
    partitions.emplace_back(names[i]);
    dds_free(names[i]);
  }
  dds_free(names);
  return partitions;
}

PeerEndpoint Describe(const dds_builtintopic_endpoint_t& found, bool is_writer) {
  PeerEndpoint endpoint;
  endpoint.topic = found.topic_name;
  endpoint.type = found.type_name;
  endpoint.is_writer = is_writer;
  endpoint.participant = GuidText(found.participant_key);
  endpoint.partitions = PartitionsOf(found.qos);
  dds_reliability_kind_t reliability = DDS_RELIABILITY_BEST_EFFORT;
  dds_durability_kind_t durability = DDS_DURABILITY_VOLATILE;
  dds_history_kind_t history = DDS_HISTORY_KEEP_LAST;
  dds_duration_t blocking = 0;
  std::int32_t depth = 0;
  dds_qget_reliability(found.qos, &reliability, &blocking);
  dds_qget_durability(found.qos, &durability);
  dds_qget_history(found.qos, &history, &depth);
  endpoint.reliable = reliability == DDS_RELIABILITY_RELIABLE;
  endpoint.transient_local = durability != DDS_DURABILITY_VOLATILE;
  endpoint.keep_last = history == DDS_HISTORY_KEEP_ALL ? 0 : depth;
  return endpoint;
}

Status Collect(const Participant& participant, bool is_writer, std::vector<PeerEndpoint>& endpoints) {
  return ForEachLive<dds_builtintopic_endpoint_t>(
      participant.state()->participant.get(),
      is_writer ? DDS_BUILTIN_TOPIC_DCPSPUBLICATION : DDS_BUILTIN_TOPIC_DCPSSUBSCRIPTION,
      [&](const dds_builtintopic_endpoint_t& found) { endpoints.push_back(Describe(found, is_writer)); });
}

// A field list's visitor that makes JSON of a message.
class JsonMaker {
 public:
  template <class W>
  void operator()(const char* name, const std::string& value, const W&) {
    json_[name] = value;
  }
  template <class T, class W>
  requires std::is_arithmetic_v<T>
  void operator()(const char* name, const T& value, const W&) { Number(name, value); }
  template <class E, class W>
  requires std::is_enum_v<E>
  void operator()(const char* name, const E& value, const W&, E) { json_[name] = static_cast<int>(value); }
  template <class T, class W>
  void operator()(const char* name, const std::vector<T>& value, const W&, std::size_t) {
    if constexpr (std::is_same_v<T, std::uint8_t>)
      json_[name] = {{"bytes", value.size()}};
    else
      json_[name] = value;
  }
  nlohmann::ordered_json Take() { return std::move(json_); }

 private:
  template <class T>
  void Number(const char* name, const T& value) {
    if constexpr (std::is_floating_point_v<T>) {
      if (!std::isfinite(value)) {
        json_[name] = nullptr;
        return;
      }
    }
    json_[name] = value;
  }
  nlohmann::ordered_json json_ = nlohmann::ordered_json::object();
};

template <class Message>
nlohmann::ordered_json JsonOf(const Message& message) {
  const typename Traits<Message>::Wire wire{};
  JsonMaker maker;
  Fields(maker, message, wire);
  return maker.Take();
}

template <class Message>
class EchoOf : public Echo {
 public:
  explicit EchoOf(Reader<Message> reader) : reader_(std::move(reader)) {}
  std::vector<nlohmann::ordered_json> Take() override {
    std::vector<nlohmann::ordered_json> messages;
    for (const auto& message : reader_.Take()) messages.push_back(JsonOf(message));
    return messages;
  }

 private:
  Reader<Message> reader_;
};

struct TopicEntry {
  const char* topic;
  Result<std::unique_ptr<Echo>> (*open)(const Participant&, const std::string&);
};

template <class Message>
TopicEntry EntryOf() {
  return {Traits<Message>::kTopic,
          [](const Participant& participant, const std::string& partition) -> Result<std::unique_ptr<Echo>> {
            ETUDE_ASSIGN_OR_RETURN(auto reader, Reader<Message>::Open(participant, partition));
            return std::unique_ptr<Echo>(new EchoOf<Message>(std::move(reader)));
          }};
}

const std::vector<TopicEntry>& Entries() {
#define ETUDE_ENTRY(Name) EntryOf<Name>(),
  static const std::vector<TopicEntry> entries{ETUDE_MESSAGES(ETUDE_ENTRY)};
#undef ETUDE_ENTRY
  return entries;
}

}  // namespace

Result<std::vector<PeerEndpoint>> Endpoints(const Participant& participant) {
  std::vector<PeerEndpoint> endpoints;
  ETUDE_RETURN_IF_ERROR(Collect(participant, true, endpoints));
  ETUDE_RETURN_IF_ERROR(Collect(participant, false, endpoints));
  std::ranges::stable_sort(endpoints, {}, &PeerEndpoint::topic);
  return endpoints;
}

std::string ParticipantId(const Participant& participant) {
  dds_guid_t guid{};
  dds_get_guid(participant.state()->participant.get(), &guid);
  return GuidText(guid);
}

std::string QosText(const PeerEndpoint& endpoint) {
  return fmt::format("{}, {}, {}", endpoint.reliable ? "reliable" : "best effort",
                     endpoint.transient_local ? "transient-local" : "volatile",
                     endpoint.keep_last == 0 ? "all" : fmt::format("last {}", endpoint.keep_last));
}

std::string Mismatch(const PeerEndpoint& writer, const PeerEndpoint& reader) {
  if (reader.reliable && !writer.reliable) return "the reader asks for reliable, the writer is best effort";
  if (reader.transient_local && !writer.transient_local)
    return "the reader asks for transient-local, the writer is volatile";
  if (reader.type != writer.type)
    return fmt::format("the reader's type is {}, the writer's {}", reader.type, writer.type);
  return "";
}

std::vector<std::string> KnownTopics() {
  std::vector<std::string> names;
  for (const auto& entry : Entries()) names.emplace_back(entry.topic);
  return names;
}

Result<std::unique_ptr<Echo>> Echo::Open(const Participant& participant, const std::string& topic,
                                         const std::string& partition) {
  for (const auto& entry : Entries())
    if (topic == entry.topic) return entry.open(participant, partition);
  return Fail(Code::kNotFound, fmt::format("topic {}", NotKnown(topic, KnownTopics())));
}

}  // namespace etude::bus
