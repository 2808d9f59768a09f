// SPDX-License-Identifier: Apache-2.0
#include "services/cli/doctor_net.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <set>

#include "services/core/clock.h"
#include "services/core/config.h"
#include "services/core/file.h"
#include "services/core/log.h"
#include "services/core/printable.h"
#include "services/core/share.h"
#include "services/core/stop.h"

namespace etude::cli {
namespace {

constexpr int kUsualMtu = 1500;   // bytes
constexpr double kSameTime = 1;   // s: leases do not depend on clocks, but people compare logs
constexpr double kManyLost = 20;  // datagrams/s to ports where nobody listens

double PerSecond(std::uint64_t after, std::uint64_t before, double seconds) {
  return seconds > 0 ? static_cast<double>(after - before) / seconds : 0;
}

std::string Mib(std::uint64_t bytes) { return fmt::format("{:.2g} MiB", static_cast<double>(bytes) / (1 << 20)); }

int Port(std::uint32_t domain, int offset) { return 7400 + 250 * static_cast<int>(domain) + offset; }

std::set<std::string> OtherHosts(const NetworkReport& report) {
  std::set<std::string> hosts;
  std::string own;
  for (const auto& peer : report.peers)
    if (peer.is_self) own = peer.host;
  for (const auto& peer : report.peers)
    if (!peer.host.empty() && peer.host != own) hosts.insert(peer.host);
  return hosts;
}

std::uint64_t SmallestBuffer(const NetworkReport& report) {
  std::uint64_t smallest = bus::kWantedReceiveBuffer;
  for (const auto& socket : report.sockets) smallest = std::min(smallest, socket.receive_buffer);
  return smallest;
}

void DescribeProfile(const bus::Arguments& arguments, NetworkReport& report) {
  const char* const uri = std::getenv("CYCLONEDDS_URI");
  if (!arguments.profile.empty()) {
    report.profile = arguments.profile;
  } else if (uri != nullptr && *uri != '\0') {
    report.profile = fmt::format("$CYCLONEDDS_URI: {}", uri);
  } else {
    report.profile = "built in: this machine only";
    report.local_only = true;
  }
}

Result<NetworkReport> Look(const bus::Arguments& arguments, double seconds) {
  NetworkReport report{.domain = arguments.domain};
  DescribeProfile(arguments, report);
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.Open());
  ETUDE_ASSIGN_OR_RETURN(const bus::UdpCounters before, bus::ReadUdpCounters());
  const Stopwatch watch;
  const auto duration = std::chrono::nanoseconds(static_cast<std::int64_t>(1e9 * seconds));
  auto clocks = bus::MeasureClocks(participant, duration);
  if (clocks) {
    report.clocks = std::move(*clocks);
  } else if (participant.secured()) {  // an identity that is no gateway may not read how processes are
    Log().warn("clocks are left out: {}", clocks.error().message);
    WaitForStop(duration);
  } else {
    return Fail(clocks.error());
  }
  report.seconds = watch.Seconds();
  ETUDE_ASSIGN_OR_RETURN(const bus::UdpCounters after, bus::ReadUdpCounters());
  report.sent_per_second = PerSecond(after.sent, before.sent, report.seconds);
  report.closed_ports_per_second = PerSecond(after.to_closed_ports, before.to_closed_ports, report.seconds);
  report.overflows_per_second = PerSecond(after.buffer_overflows, before.buffer_overflows, report.seconds);
  ETUDE_ASSIGN_OR_RETURN(report.peers, bus::Peers(participant));
  report.sockets = bus::OwnUdpSockets();
  report.rmem_max = bus::LargestReceiveBuffer().value_or(0);
  for (const auto& interface : bus::Interfaces())
    report.interfaces.push_back(
        {interface, interface.multicast ? bus::TryMulticast(interface.address) : "switched off"});
  return report;
}

Status CheckHub(const std::string& hub) {
  const bool is_plain = std::ranges::all_of(
      hub, [](unsigned char c) { return std::isalnum(c) != 0 || c == '.' || c == '-' || c == ':' || c == '_'; });
  if (!hub.empty() && hub.size() <= 253 && is_plain) return {};
  return Fail(Code::kInvalidArgument, fmt::format("--hub '{}': must be an address or a name, also with :PORT", hub));
}

// The text with what stands between the first `begin` and the next `end` replaced.
Result<std::string> Replaced(const std::string& text, const std::string& begin, const std::string& end,
                             const std::string& by) {
  const auto from = text.find(begin);
  const auto to = from == std::string::npos ? from : text.find(end, from);
  if (to == std::string::npos)
    return Fail(Code::kInvalidArgument, fmt::format("make a profile: the template has no '{}...{}'", begin, end));
  return text.substr(0, from + begin.size()) + by + text.substr(to);
}

struct NetArguments {
  DoctorArguments common;
  double seconds = 6;  // a star's hosts ask for others each 5 s
  std::string profile;
  std::vector<std::string> hubs;
  int processes = 16;
};

Status WriteProfile(const NetArguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const Path dds, FindShared("dds"));
  ETUDE_ASSIGN_OR_RETURN(const std::string cloud, ReadTextFile(dds / "cloud.xml"));
  ETUDE_ASSIGN_OR_RETURN(const std::string text, StarProfile(cloud, arguments.hubs, arguments.processes));
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(arguments.profile, text));
  std::error_code ignored;
  fmt::print("{0}\ncopy it to every host, and there: export CYCLONEDDS_URI='file://{0}'\n",
             std::filesystem::absolute(arguments.profile, ignored).string());
  return {};
}

Status DoctorNet(const NetArguments& arguments) {
  if (!arguments.profile.empty()) return WriteProfile(arguments);
  ETUDE_ASSIGN_OR_RETURN(const NetworkReport report, Look(arguments.common.bus, arguments.seconds));
  if (arguments.common.as_json)
    fmt::print("{}\n", JsonText(ToJson(report), 2));
  else
    fmt::print("{}", ToText(report));
  return {};
}

void AdviseOnInterfaces(const NetworkReport& report, std::vector<std::string>& lines) {
  for (const auto& interface : report.interfaces) {
    if (interface.discovery && !interface.multicast_problem.empty())
      lines.push_back(
          fmt::format("peers are looked for by multicast on {}, which does not work there ({}): set "
                      "AllowMulticast to false and list the hubs as peers",
                      interface.name, interface.multicast_problem));
    if (!report.local_only && interface.mtu > 0 && interface.mtu < kUsualMtu && !interface.loopback)
      lines.push_back(
          fmt::format("{} carries {} bytes a packet (a tunnel?): set MaxRexmitMessageSize to {}B in the profile",
                      interface.name, interface.mtu, interface.mtu - 44));
  }
}

}  // namespace

std::vector<std::string> Advice(const NetworkReport& report) {
  std::vector<std::string> lines;
  if (report.local_only)
    lines.push_back(
        "other hosts cannot be seen with the built-in profile: choose one of deploy/dds, or make one with "
        "--write-profile FILE --hub HOST");
  else if (OtherHosts(report).empty())
    lines.push_back(
        fmt::format("no process of another host was seen: start one there on domain {}, with this profile; UDP "
                    "ports {} to {} must be open between the hosts (all of UDP with ParticipantIndex none, as in "
                    "lan.xml), and each must have a way to a hub",
                    report.domain, Port(report.domain, 0), Port(report.domain, 249)));
  if (report.rmem_max > 0 && report.rmem_max < bus::kWantedReceiveBuffer)
    lines.push_back(
        fmt::format("bursts of episodes and checkpoints are lost and sent again: sudo sysctl -w "
                    "net.core.rmem_max={} (it is {})",
                    bus::kWantedReceiveBuffer, report.rmem_max));
  else if (SmallestBuffer(report) < (1u << 20))
    lines.push_back(fmt::format("a socket of DDS has {} to receive in: raise SocketReceiveBufferSize in the profile",
                                Mib(SmallestBuffer(report))));
  // on one machine they cost little, and are the price of asking every port
  if (!report.local_only && report.closed_ports_per_second > kManyLost)
    lines.push_back(
        fmt::format("{:.0f} datagrams a second come for ports where nobody listens: list hubs only, and lower "
                    "MaxAutoParticipantIndex in the profile (--write-profile does both)",
                    report.closed_ports_per_second));
  if (report.overflows_per_second > 0)
    lines.push_back(
        fmt::format("{:.1f} datagrams a second are dropped because a socket's buffer is full: raise "
                    "net.core.rmem_max, or give the process a core",
                    report.overflows_per_second));
  AdviseOnInterfaces(report, lines);
  for (const auto& clock : report.clocks)
    if (std::abs(clock.seconds) > kSameTime)
      lines.push_back(fmt::format("the clock of {} is {:.1f} s {} this one's: let both follow a time server (chrony)",
                                  clock.host, std::abs(clock.seconds), clock.seconds > 0 ? "ahead of" : "behind"));
  return lines;
}

std::string ToText(const NetworkReport& report) {
  std::string text;
  const auto row = [&](const char* name, const std::string& value) {
    text += fmt::format("{:<11} {}\n", name, Printable(value));
  };
  row("domain", fmt::format("{}, ports {} to {}", report.domain, Port(report.domain, 0), Port(report.domain, 249)));
  row("profile", report.profile);
  const auto hosts = OtherHosts(report);
  row("peers", fmt::format("{} other participants, {} other hosts", report.peers.empty() ? 0 : report.peers.size() - 1,
                           hosts.size()));
  for (const auto& peer : report.peers) {
    if (peer.is_self) continue;
    const auto clock = std::ranges::find(report.clocks, peer.participant, &bus::ClockOffset::participant);
    row("", fmt::format("{} {} {}  {}{}", peer.host.empty() ? "?" : peer.host, peer.process, peer.pid, peer.addresses,
                        clock == report.clocks.end() ? "" : fmt::format("  clock {:+.3f} s", clock->seconds)));
  }
  for (const auto& interface : report.interfaces)
    row("interface",
        fmt::format("{} {}, {} bytes a packet, multicast {}{}", interface.name, interface.address, interface.mtu,
                    interface.multicast_problem.empty() ? "works here" : interface.multicast_problem,
                    interface.discovery ? ", looks for peers by it" : ""));
  for (const auto& socket : report.sockets)
    row("socket", fmt::format("{}:{} receives in {}, sends from {}", socket.address, socket.port,
                              Mib(socket.receive_buffer), Mib(socket.send_buffer)));
  row("buffers", fmt::format("net.core.rmem_max {} bytes, {} wanted", report.rmem_max, bus::kWantedReceiveBuffer));
  row("traffic", fmt::format("{:.1f} datagrams/s sent by this host, {:.1f}/s for closed ports, {:.1f}/s dropped",
                             report.sent_per_second, report.closed_ports_per_second, report.overflows_per_second));
  for (const auto& line : Advice(report)) row("advice", line);
  return text;
}

nlohmann::ordered_json ToJson(const NetworkReport& report) {
  using Json = nlohmann::ordered_json;
  Json json{{"domain", report.domain}, {"profile", report.profile}, {"seconds", report.seconds}};
  json["ports"] = {Port(report.domain, 0), Port(report.domain, 249)};
  auto& peers = json["peers"] = Json::array();
  for (const auto& peer : report.peers) {
    Json entry{{"host", peer.host},           {"process", peer.process},         {"pid", peer.pid},
               {"addresses", peer.addresses}, {"participant", peer.participant}, {"self", peer.is_self}};
    const auto clock = std::ranges::find(report.clocks, peer.participant, &bus::ClockOffset::participant);
    entry["clock_offset_s"] = clock == report.clocks.end() ? Json() : Json(clock->seconds);
    peers.push_back(std::move(entry));
  }
  auto& interfaces = json["interfaces"] = Json::array();
  for (const auto& interface : report.interfaces)
    interfaces.push_back({{"name", interface.name},
                          {"address", interface.address},
                          {"mtu", interface.mtu},
                          {"multicast_works", interface.multicast_problem.empty()},
                          {"multicast_problem", interface.multicast_problem},
                          {"multicast_discovery", interface.discovery}});
  auto& sockets = json["sockets"] = Json::array();
  for (const auto& socket : report.sockets)
    sockets.push_back({{"address", socket.address},
                       {"port", socket.port},
                       {"receive_buffer_bytes", socket.receive_buffer},
                       {"send_buffer_bytes", socket.send_buffer}});
  json["rmem_max_bytes"] = report.rmem_max;
  json["udp_sent_per_s"] = report.sent_per_second;
  json["udp_to_closed_ports_per_s"] = report.closed_ports_per_second;
  json["udp_dropped_per_s"] = report.overflows_per_second;
  json["advice"] = Advice(report);
  return json;
}

Result<std::string> StarProfile(const std::string& cloud_xml, const std::vector<std::string>& hubs, int processes) {
  if (hubs.empty())
    return Fail(Code::kInvalidArgument,
                "make a profile: name the hosts of collector, trainer, policy server and dashboard by --hub");
  std::string peers = "\n";
  std::set<std::string> known;
  for (const auto& hub : hubs) {
    ETUDE_RETURN_IF_ERROR(CheckHub(hub));
    if (known.insert(hub).second) peers += fmt::format("        <Peer address=\"{}\"/>\n", hub);
  }
  ETUDE_ASSIGN_OR_RETURN(std::string text, Replaced(cloud_xml, "<Peers>", "</Peers>", peers + "      "));
  // indices begin at 0, and Cyclone leaves the last one out
  return Replaced(text, "<MaxAutoParticipantIndex>", "</MaxAutoParticipantIndex>", std::to_string(processes));
}

CLI::App* AddDoctorNet(CLI::App& doctor, std::shared_ptr<DoctorArguments> common, std::function<Status()>& body) {
  auto* command = doctor.add_subcommand("net", "peers, ports, multicast, packet size, socket buffers, clocks");
  auto arguments = std::make_shared<NetArguments>();
  common->bus.Add(*command);
  command->add_flag("--json", common->as_json, "as JSON");
  command->add_option("--seconds", arguments->seconds, "to look for")
      ->check(CLI::Range(0.5, 600.0))
      ->capture_default_str();
  auto* write =
      command->add_option("--write-profile", arguments->profile,
                          "instead: write a Cyclone DDS profile for hosts without multicast, a star around --hub");
  command
      ->add_option("--hub", arguments->hubs,
                   "host of a collector, trainer, policy server or dashboard: address or name; repeatable")
      ->allow_extra_args(false)
      ->needs(write);
  command->add_option("--processes", arguments->processes, "most processes of a host on the bus")
      ->check(CLI::Range(1, 119))
      ->capture_default_str()
      ->needs(write);
  command->callback([arguments, common, &body] {
    arguments->common = *common;
    body = [arguments] { return DoctorNet(*arguments); };
  });
  return command;
}

}  // namespace etude::cli
