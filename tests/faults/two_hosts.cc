// SPDX-License-Identifier: Apache-2.0
#include "tests/faults/two_hosts.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cstdlib>

#include "services/core/stop.h"
#include "tests/support/run_command.h"

namespace etude::faults {
namespace {

void Do(const std::string& command) {
  const auto done = RunInShell(command + " 2>&1");
  EXPECT_EQ(done.code, 0) << command << ": " << done.text;
}

std::string IpProgram() { return std::filesystem::exists("/usr/sbin/ip") ? "/usr/sbin/ip" : "/sbin/ip"; }

}  // namespace

std::string ProfileOn(const std::string& address, const std::string& peers, const std::string& internal) {
  std::string text = ReadTextFile("deploy/dds/local.xml").value_or("");
  EXPECT_FALSE(text.empty()) << "run the test in the root of the sources";
  const auto replace = [&](const std::string& from, const std::string& to) {
    const auto at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    if (at != std::string::npos) text.replace(at, from.size(), to);
  };
  replace("<NetworkInterface address=\"127.0.0.1\"/>", "<NetworkInterface address=\"" + address + "\"/>");
  replace("<Peer address=\"127.0.0.1\"/>", peers);
  replace("</Internal>", internal + "</Internal>");
  return text;
}

TwoHosts::TwoHosts() : a_(fmt::format("etf{}a", ::getpid())), b_(fmt::format("etf{}b", ::getpid())) {
  const std::string make = fmt::format(
      "(ip netns add {0} && ip netns add {1} && ip link add {0} netns {0} type veth peer name {1} netns {1} && "
      "ip -n {0} addr add 10.98.0.1/24 dev {0} && ip -n {1} addr add 10.98.0.2/24 dev {1} && "
      "ip -n {0} link set lo up && ip -n {1} link set lo up && ip -n {0} link set {0} up && "
      "ip -n {1} link set {1} up) 2>&1",
      a_, b_);
  up_ = RunInShell(make).code == 0;
}

TwoHosts::~TwoHosts() { RunInShell(fmt::format("(ip netns del {}; ip netns del {}) 2>&1", a_, b_)); }

void TwoHosts::Link(bool on) const { Do(fmt::format("ip -n {0} link set {0} {1}", a_, on ? "up" : "down")); }

void TwoHosts::Mute(Side side, bool mute) const {
  const bool workers = side == Side::kWorkers;
  Do(fmt::format("ip -n {} route {} blackhole 10.98.0.{}/32", workers ? b_ : a_, mute ? "add" : "del",
                 workers ? 1 : 2));
}

RunOptions TwoHosts::Options(const std::string& name, std::uint64_t episodes, int ms_per_attempt) const {
  const std::string peers = "<Peer address=\"10.98.0.1\"/><Peer address=\"10.98.0.2\"/>";
  const auto prefix = [&](const std::string& address, const std::string& host) {
    return std::vector<std::string>{
        "/usr/bin/env", "CYCLONEDDS_URI=" + ProfileOn(address, peers), IpProgram(), "netns", "exec", host};
  };
  return {.name = name,
          .domain = 96,
          .episodes = episodes,
          .lease_s = "3",
          .ms_per_attempt = ms_per_attempt,
          .collector_prefix = prefix("10.98.0.1", a_),
          .worker_prefix = prefix("10.98.0.2", b_)};
}

void Last(std::chrono::milliseconds duration) { WaitForStop(duration); }

int SecondsOf(const char* variable, int otherwise) {
  const char* seconds = std::getenv(variable);
  return seconds == nullptr ? otherwise : std::atoi(seconds);
}

}  // namespace etude::faults
