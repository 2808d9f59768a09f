// SPDX-License-Identifier: Apache-2.0
// What DDS has found on the network, and how this host's sockets and clock stand: for `etude doctor net`, not for
// programs that work over the bus.
#pragma once

#include <chrono>
#include <cstdint>
#include <iosfwd>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "services/bus/participant.h"

namespace etude::bus {

/// One participant of the domain, as it describes itself. What another DDS implementation does not say is empty.
struct NetworkPeer {
  std::string participant;  ///< 32 hexadecimal digits, as ProcessStatus::participant
  std::string host, process;
  std::uint32_t pid = 0;
  std::string addresses;  ///< that it listens at, as DDS writes them: "udp/10.0.0.7:7411@2"
  bool is_self = false;
};

/// All that are known now, by host, process and pid; the participant itself among them.
Result<std::vector<NetworkPeer>> Peers(const Participant& participant);

/// How far another process's wall clock is ahead of this one's.
struct ClockOffset {
  std::string participant, host;
  double seconds = 0;  ///< behind where negative; off by the time a message takes, below a millisecond in a LAN
};

/// Listens to the signs of life of all processes for `duration`, or until a stop request; those that gave none (a
/// process gives one a second) are left out.
Result<std::vector<ClockOffset>> MeasureClocks(const Participant& participant, std::chrono::nanoseconds duration);

/// A UDP socket of this process, as the kernel has it.
struct OwnSocket {
  std::string address;
  std::uint16_t port = 0;
  std::uint64_t receive_buffer = 0,
                send_buffer = 0;  ///< bytes that the program may use (Linux sets aside twice as much)
};
/// Those that are bound to a port, by port.
std::vector<OwnSocket> OwnUdpSockets();

/// An interface that is up.
struct NetworkInterface {
  std::string name, address;  ///< IPv4
  int mtu = 0;                ///< bytes
  bool loopback = false, multicast = false;
  bool discovery = false;  ///< somebody on this host listens there for peers by multicast (239.255.0.1)
};
std::vector<NetworkInterface> Interfaces();
/// Of the text of /proc/net/igmp the interfaces that listen to `group`, which it has below the line of its interface as
/// hexadecimal: "0100FFEF".
std::set<std::string> ListeningInterfaces(std::istream& igmp, const std::string& group);

/// What a socket's receive buffer should be able to hold, bytes: the profiles in deploy/dds ask for it.
inline constexpr std::uint64_t kWantedReceiveBuffer = 4u << 20;
/// What one may hold on this host (net.core.rmem_max), bytes; nothing where that cannot be read.
std::optional<std::uint64_t> LargestReceiveBuffer();

/// The kernel's counters of UDP over IPv4, of the whole host (of the network namespace).
struct UdpCounters {
  std::uint64_t sent = 0, received = 0;
  std::uint64_t to_closed_ports = 0;  ///< that came for a port nobody listens at
  std::uint64_t buffer_overflows = 0;
};
/// @error kUnavailable: no /proc/net/snmp
Result<UdpCounters> ReadUdpCounters();

/// Sends itself a datagram by multicast over the interface of `address`: "" when it comes back, else why not. This
/// shows what the host does, not whether the switches between hosts forward it.
std::string TryMulticast(const std::string& address);

}  // namespace etude::bus
