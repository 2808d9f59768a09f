// SPDX-License-Identifier: Apache-2.0
#include "services/bus/qos.h"

#include <fmt/format.h>

#include <algorithm>
#include <vector>

namespace etude::bus {

Qos MakeQos(const TopicQos& topic) {
  Qos owner(dds_create_qos());
  dds_qos_t* const qos = owner.get();
  const auto history = topic.keep_last > 0 ? DDS_HISTORY_KEEP_LAST : DDS_HISTORY_KEEP_ALL;
  const int depth = topic.keep_last > 0 ? topic.keep_last : 1;
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE,
                       DDS_MSECS(static_cast<dds_duration_t>(topic.max_blocking.count())));
  dds_qset_durability(qos, topic.transient_local ? DDS_DURABILITY_TRANSIENT_LOCAL : DDS_DURABILITY_VOLATILE);
  // what a late joiner gets is ruled by this policy, not by the history
  dds_qset_durability_service(qos, 0, DDS_HISTORY_KEEP_LAST, topic.late, DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED,
                              DDS_LENGTH_UNLIMITED);
  dds_qset_history(qos, history, depth);
  dds_qset_resource_limits(qos, DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED);
  dds_qset_ownership(qos, DDS_OWNERSHIP_SHARED);
  dds_qset_liveliness(qos, DDS_LIVELINESS_AUTOMATIC, DDS_INFINITY);
  dds_qset_destination_order(qos, DDS_DESTINATIONORDER_BY_RECEPTION_TIMESTAMP);
  dds_qset_deadline(qos, DDS_INFINITY);
  dds_qset_latency_budget(qos, 0);
  dds_qset_lifespan(qos, DDS_INFINITY);
  dds_qset_transport_priority(qos, 0);
  dds_qset_time_based_filter(qos, 0);
  dds_qset_writer_data_lifecycle(qos, true);
  dds_qset_reader_data_lifecycle(qos, DDS_INFINITY, DDS_INFINITY);
  dds_qset_ignorelocal(qos, DDS_IGNORELOCAL_NONE);
  const dds_data_representation_id_t representation = DDS_DATA_REPRESENTATION_XCDR2;
  dds_qset_data_representation(qos, 1, &representation);
  return owner;
}

Qos MakePartitionQos(const std::vector<std::string>& partitions) {
  Qos qos(dds_create_qos());
  std::vector<const char*> names;
  for (const auto& partition : partitions) names.push_back(partition.c_str());
  dds_qset_partition(qos.get(), static_cast<std::uint32_t>(names.size()), names.data());
  dds_qset_presentation(qos.get(), DDS_PRESENTATION_INSTANCE, false, false);
  return qos;
}

Status CheckPartition(const std::string& partition) {
  const bool plain = std::all_of(partition.begin(), partition.end(), [](unsigned char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-' ||
           c == '.' || c == '/';
  });
  // a part that is empty is a name or an id that somebody forgot
  const bool whole = ("/" + partition + "/").find("//") == std::string::npos;
  if (partition.size() > 200 || !plain || !whole) {
    return Fail(Code::kInvalidArgument,
                fmt::format("partition '{}': expected 1 to 200 of A-Z a-z 0-9 _ - ., in parts between /", partition));
  }
  return {};
}

}  // namespace etude::bus
