// SPDX-License-Identifier: Apache-2.0
// DDS' builtin topics: who and what is on the domain. Internal to services/bus.
#pragma once

#include <dds/dds.h>
#include <fmt/format.h>

#include <string>

#include "services/bus/entity.h"

namespace etude::bus {

inline std::string GuidText(const dds_guid_t& guid) {
  std::string text;
  for (const std::uint8_t byte : guid.v) text += fmt::format("{:02x}", byte);
  return text;
}

/// What a participant says of itself, "__ProcessName" say; "" where it does not.
inline std::string PropertyOf(const dds_qos_t* qos, const char* name) {
  char* value = nullptr;
  if (qos == nullptr || !dds_qget_prop(qos, name, &value) || value == nullptr) return "";
  std::string text = value;
  dds_free(value);
  return text;
}

/// Calls `use` with every live `Sample` of the builtin `topic`.
template <class Sample, class Use>
Status ForEachLive(dds_entity_t participant, dds_entity_t topic, const Use& use) {
  ETUDE_ASSIGN_OR_RETURN(const Entity reader, CheckEntity(dds_create_reader(participant, topic, nullptr, nullptr),
                                                          "look at who is on the domain"));
  constexpr int kBatch = 64;
  while (true) {
    void* samples[kBatch] = {};
    dds_sample_info_t infos[kBatch];
    const dds_return_t count = dds_take(reader.get(), samples, infos, kBatch, kBatch);
    if (count <= 0) return {};
    for (int i = 0; i < count; ++i)
      if (infos[i].valid_data && infos[i].instance_state == DDS_ALIVE_INSTANCE_STATE)
        use(*static_cast<const Sample*>(samples[i]));
    dds_return_loan(reader.get(), samples, count);
  }
}

}  // namespace etude::bus
