// SPDX-License-Identifier: Apache-2.0
// Whose traffic it is.
#pragma once

#include <string>

namespace etude::bus {

/// "PARTITION/HOST": of what is said in a partition that which is meant for one host (Participant::host()) and read by
/// its processes alone.
inline std::string PartitionOfHost(const std::string& partition, const std::string& host) {
  return partition + "/" + host;
}

/// A campaign or a run: its name is for people, the random id of its folder tells it from others of that name.
struct Owner {
  std::string name;
  std::string id;
  /// "NAME/ID": the DDS partition in which everything of it travels that is not meant for one host.
  std::string partition() const { return name + "/" + id; }
  std::string host_partition(const std::string& host) const { return PartitionOfHost(partition(), host); }
  /// "NAME/ID/CHANNEL": its acknowledged blobs, whose acknowledgements are in "NAME/ID/CHANNEL/HOST".
  std::string channel_partition(const std::string& channel) const { return partition() + "/" + channel; }
  /// "NAME/ID/relay": what others pass on that the run itself has published.
  std::string relay_partition() const { return partition() + "/relay"; }
};

}  // namespace etude::bus
