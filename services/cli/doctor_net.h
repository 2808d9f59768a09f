// SPDX-License-Identifier: Apache-2.0
// `etude doctor net`: how this host stands on the bus, with an advice for whatever slows it or keeps peers apart.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "services/bus/arguments.h"
#include "services/bus/network.h"
#include "services/core/result.h"

namespace etude::cli {

/// What was seen within `seconds`.
struct NetworkReport {
  std::uint32_t domain = 0;
  std::string profile;  ///< a file, "$CYCLONEDDS_URI ...", or "built in: this machine only"
  bool local_only = false;
  double seconds = 0;
  std::vector<bus::NetworkPeer> peers;  ///< this process among them
  std::vector<bus::ClockOffset> clocks;
  std::vector<bus::OwnSocket> sockets;  ///< of this process
  std::uint64_t rmem_max = 0;           ///< bytes; 0: unknown
  struct Interface : bus::NetworkInterface {
    std::string multicast_problem;  ///< "": a datagram by multicast came back
  };
  std::vector<Interface> interfaces;
  double sent_per_second = 0, closed_ports_per_second = 0, overflows_per_second = 0;  ///< UDP, of the whole host
};

/// What to do about it, a line each; empty where all is well.
std::vector<std::string> Advice(const NetworkReport& report);
std::string ToText(const NetworkReport& report);
nlohmann::ordered_json ToJson(const NetworkReport& report);

/// `cloud.xml`'s text with these hubs as its only peers, and room for `processes` processes a host.
/// @error kInvalidArgument: no hub, a hub that is no address or name, or a text without the elements to change
Result<std::string> StarProfile(const std::string& cloud_xml, const std::vector<std::string>& hubs, int processes);

/// What `etude doctor` and `etude doctor net` both understand, in front of `net` and behind it.
struct DoctorArguments {
  bus::Arguments bus;
  bool as_json = false;
};

/// Adds `etude doctor net` below `doctor`.
CLI::App* AddDoctorNet(CLI::App& doctor, std::shared_ptr<DoctorArguments> common, std::function<Status()>& body);

}  // namespace etude::cli
