// SPDX-License-Identifier: Apache-2.0
// Whose traffic it is.
#pragma once

#include <cstdint>
#include <string>

namespace etude::bus {

/// "PARTITION/ADDRESS": of what is said in a partition that which is meant for who has this address
/// (Participant::address()), and read by nobody else.
inline std::string PartitionOfAddress(const std::string& partition, const std::string& address) {
  return partition + "/" + address;
}

/// Of a process, beside others on `host`: "HOST--xxxxxxxx", a plain name.
std::string AddressOnHost(const std::string& host, std::uint32_t process);
/// "lab-7" of "lab-7--01c2d3e4"; what is no process's address is its own host.
std::string HostOfAddress(const std::string& address);

/// A campaign or a run: its name is for people, the random id of its folder tells it from others of that name.
struct Owner {
  std::string name;
  std::string id;
  /// "NAME/ID": the DDS partition in which everything of it travels that is not meant for one address.
  std::string partition() const { return name + "/" + id; }
  std::string address_partition(const std::string& address) const { return PartitionOfAddress(partition(), address); }
  /// "NAME/ID/CHANNEL": its acknowledged blobs, whose acknowledgements are in "NAME/ID/CHANNEL/ADDRESS".
  std::string channel_partition(const std::string& channel) const { return partition() + "/" + channel; }
  /// "NAME/ID/relay": what others pass on that the run itself has published.
  std::string relay_partition() const { return partition() + "/relay"; }
};

}  // namespace etude::bus
