// SPDX-License-Identifier: Apache-2.0
#include "services/bus/network.h"

#include <arpa/inet.h>
#include <dds/dds.h>
#include <dirent.h>
#include <fmt/format.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <map>
#include <set>
#include <sstream>
#include <tuple>

#include "services/bus/access.h"
#include "services/bus/builtin_topic.h"
#include "services/bus/participant_state.h"
#include "services/bus/process_reporter.h"
#include "services/bus/topology.h"
#include "services/bus/typed.h"
#include "services/core/clock.h"
#include "services/core/descriptor.h"
#include "services/core/stop.h"

namespace etude::bus {
namespace {

constexpr std::uint32_t kDiscoveryGroup = 0xEFFF0001;  // 239.255.0.1, where DDS participants look for each other

std::string AddressText(const in_addr& address) {
  char text[INET_ADDRSTRLEN] = {};
  ::inet_ntop(AF_INET, &address, text, sizeof text);
  return text;
}

// Linux tells twice what a program may use.
std::uint64_t BufferOf(int fd, int option) {
  int bytes = 0;
  socklen_t size = sizeof bytes;
  if (::getsockopt(fd, SOL_SOCKET, option, &bytes, &size) != 0) return 0;
  return static_cast<std::uint64_t>(bytes) / 2;
}

std::optional<OwnSocket> DescribeSocket(int fd) {
  int type = 0;
  socklen_t size = sizeof type;
  if (::getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &size) != 0 || type != SOCK_DGRAM) return std::nullopt;
  sockaddr_in address{};
  size = sizeof address;
  if (::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size) != 0) return std::nullopt;
  if (address.sin_family != AF_INET || address.sin_port == 0) return std::nullopt;
  return OwnSocket{AddressText(address.sin_addr), ntohs(address.sin_port), BufferOf(fd, SO_RCVBUF),
                   BufferOf(fd, SO_SNDBUF)};
}

}  // namespace

Result<std::vector<NetworkPeer>> Peers(const Participant& participant) {
  const std::string self = ParticipantId(participant);
  std::vector<NetworkPeer> peers;
  ETUDE_RETURN_IF_ERROR(ForEachLive<dds_builtintopic_participant_t>(
      participant.state()->participant.get(), DDS_BUILTIN_TOPIC_DCPSPARTICIPANT,
      [&](const dds_builtintopic_participant_t& found) {
        const std::string id = GuidText(found.key);
        peers.push_back(
            {.participant = id,
             .host = PropertyOf(found.qos, "__Hostname"),
             .process = PropertyOf(found.qos, "__ProcessName"),
             .pid = static_cast<std::uint32_t>(std::strtoul(PropertyOf(found.qos, "__Pid").c_str(), nullptr, 10)),
             .addresses = PropertyOf(found.qos, "__NetworkAddresses"),
             .is_self = id == self});
      }));
  std::ranges::sort(peers, {}, [](const NetworkPeer& peer) { return std::tie(peer.host, peer.process, peer.pid); });
  return peers;
}

Result<std::vector<ClockOffset>> MeasureClocks(const Participant& participant, std::chrono::nanoseconds duration) {
  ETUDE_ASSIGN_OR_RETURN(const Endpoint reader, OpenReaderOf<ProcessStatus>(participant, kDirectoryPartition));
  Waiter waiter;
  ETUDE_RETURN_IF_ERROR(waiter.Open(participant));
  ETUDE_RETURN_IF_ERROR(waiter.AddReader(reader));
  std::map<std::string, ClockOffset> by_participant;
  const auto end = MonotonicClock::now() + duration;
  while (MonotonicClock::now() < end && !StopRequested()) {
    if (!waiter.Wait(end - MonotonicClock::now())) continue;
    constexpr int kBatch = 64;
    void* samples[kBatch] = {};
    dds_sample_info_t infos[kBatch];
    const dds_return_t count = dds_take(reader.get(), samples, infos, kBatch, kBatch);
    const dds_time_t now = dds_time();
    for (int i = 0; i < count; ++i) {
      if (!infos[i].valid_data) continue;
      const auto& wire = *static_cast<const etude_wire_ProcessStatus*>(samples[i]);
      // the quickest message is the one that tells best
      const double ahead = 1e-9 * static_cast<double>(infos[i].source_timestamp - now);
      const auto [known, is_new] =
          by_participant.try_emplace(wire.participant, ClockOffset{wire.participant, wire.host, ahead});
      if (!is_new) known->second.seconds = std::max(known->second.seconds, ahead);
    }
    if (count > 0) dds_return_loan(reader.get(), samples, count);
  }
  std::vector<ClockOffset> offsets;
  for (auto& [id, offset] : by_participant) offsets.push_back(std::move(offset));
  return offsets;
}

std::vector<OwnSocket> OwnUdpSockets() {
  std::vector<OwnSocket> sockets;
  DIR* const folder = ::opendir("/proc/self/fd");
  if (folder == nullptr) return sockets;
  while (const dirent* entry = ::readdir(folder)) {
    if (entry->d_name[0] == '.') continue;
    if (auto socket = DescribeSocket(std::atoi(entry->d_name))) sockets.push_back(std::move(*socket));
  }
  ::closedir(folder);
  std::ranges::sort(sockets, {}, &OwnSocket::port);
  return sockets;
}

std::set<std::string> ListeningInterfaces(std::istream& igmp, const std::string& group) {
  std::set<std::string> found;
  std::string interface;
  for (std::string line; std::getline(igmp, line);) {
    std::istringstream words(line);
    std::string first, second;
    words >> first >> second;
    if (!line.empty() && line[0] != '\t' && line[0] != ' ')
      interface = second.substr(0, second.find(':'));  // a long name leaves no space before it
    else if (first == group)
      found.insert(interface);
  }
  return found;
}

std::vector<NetworkInterface> Interfaces() {
  std::vector<NetworkInterface> found;
  ifaddrs* all = nullptr;
  if (::getifaddrs(&all) != 0) return found;
  const Descriptor any(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  std::ifstream igmp("/proc/net/igmp");
  // in the byte order of the machine's network addresses
  const auto discovering = ListeningInterfaces(igmp, fmt::format("{:08X}", htonl(kDiscoveryGroup)));
  for (const ifaddrs* item = all; item != nullptr; item = item->ifa_next) {
    if (item->ifa_addr == nullptr || item->ifa_addr->sa_family != AF_INET || !(item->ifa_flags & IFF_UP)) continue;
    const std::string label = item->ifa_name;  // of a second address "eth0:1"
    ifreq request{};
    std::strncpy(request.ifr_name, item->ifa_name, sizeof request.ifr_name - 1);
    const bool has_mtu = ::ioctl(any.get(), SIOCGIFMTU, &request) == 0;
    found.push_back({.name = item->ifa_name,
                     .address = AddressText(reinterpret_cast<const sockaddr_in*>(item->ifa_addr)->sin_addr),
                     .mtu = has_mtu ? request.ifr_mtu : 0,
                     .loopback = (item->ifa_flags & IFF_LOOPBACK) != 0,
                     .multicast = (item->ifa_flags & IFF_MULTICAST) != 0,
                     .discovery = discovering.contains(label.substr(0, label.find(':')))});
  }
  ::freeifaddrs(all);
  return found;
}

std::optional<std::uint64_t> LargestReceiveBuffer() {
  std::ifstream file("/proc/sys/net/core/rmem_max");
  std::uint64_t bytes = 0;
  return file >> bytes ? std::optional(bytes) : std::nullopt;
}

Result<UdpCounters> ReadUdpCounters() {
  std::ifstream file("/proc/net/snmp");
  std::string names, values;
  for (std::string line; std::getline(file, line);) {
    if (!line.starts_with("Udp: ")) continue;
    (names.empty() ? names : values) = line;
  }
  std::istringstream name_words(names), value_words(values);
  std::map<std::string, std::uint64_t> counters;
  std::string name, value;
  while (name_words >> name && value_words >> value) counters[name] = std::strtoull(value.c_str(), nullptr, 10);
  if (!counters.contains("OutDatagrams"))
    return Fail(Code::kUnavailable, "read the UDP counters: /proc/net/snmp has none");
  return UdpCounters{counters["OutDatagrams"], counters["InDatagrams"], counters["NoPorts"], counters["RcvbufErrors"]};
}

std::string TryMulticast(const std::string& address) {
  in_addr interface {};
  if (::inet_pton(AF_INET, address.c_str(), &interface) != 1) return fmt::format("'{}' is no IPv4 address", address);
  const Descriptor socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  sockaddr_in bound{};
  bound.sin_family = AF_INET;
  socklen_t size = sizeof bound;
  // a group of the range that is a site's own, which no protocol of ours uses
  ip_mreq group{};
  ::inet_pton(AF_INET, "239.255.77.77", &group.imr_multiaddr);
  group.imr_interface = interface;
  const auto failed = [](const char* what) { return fmt::format("{}: {}", what, std::strerror(errno)); };
  if (::bind(socket.get(), reinterpret_cast<sockaddr*>(&bound), size) != 0 ||
      ::getsockname(socket.get(), reinterpret_cast<sockaddr*>(&bound), &size) != 0)
    return failed("open a socket");
  if (::setsockopt(socket.get(), IPPROTO_IP, IP_ADD_MEMBERSHIP, &group, sizeof group) != 0)
    return failed("join a group");
  if (::setsockopt(socket.get(), IPPROTO_IP, IP_MULTICAST_IF, &interface, sizeof interface) != 0)
    return failed("choose the interface");
  sockaddr_in to = bound;
  to.sin_addr = group.imr_multiaddr;
  if (::sendto(socket.get(), "etude", 5, 0, reinterpret_cast<const sockaddr*>(&to), sizeof to) != 5)
    return failed("send");
  pollfd readable{socket.get(), POLLIN, 0};
  char buffer[16];
  if (::poll(&readable, 1, 500) != 1 || ::recv(socket.get(), buffer, sizeof buffer, 0) != 5)
    return "what was sent did not come back within 0.5 s";
  return "";
}

}  // namespace etude::bus
