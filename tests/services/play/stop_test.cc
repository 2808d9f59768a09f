// SPDX-License-Identifier: Apache-2.0
// Tests services/play/client.cc after a stop request, which nothing takes back: a program of its own.
#include "services/core/stop.h"

#include <gtest/gtest.h>

#include "services/bus/topic.h"
#include "services/play/client.h"

namespace etude::play {
namespace stop_test {

using namespace std::chrono_literals;

constexpr std::uint32_t kDomain = 163;

TEST(PlayClient, SaysACommandOnceAfterAStopRequest) {
  const auto there = bus::Participant::Open({kDomain, ""}).value();
  const auto here = bus::Participant::Open({kDomain, ""}).value();
  auto commands = bus::Reader<bus::PlayCommand>::Open(there, bus::kPlayPartition).value();
  auto states = bus::Writer<bus::PlayState>::Open(there, bus::kPlayPartition).value();
  auto client = Client::Open(here);
  ASSERT_TRUE(client);
  bus::PlayState state;
  state.session = "one";
  state.phase = "moving";
  ASSERT_TRUE(states.WaitForReaders(1, 10s));
  ASSERT_TRUE(states.Write(state));
  ASSERT_TRUE(client->Find("one", 10s));
  const auto deadline = MonotonicClock::now() + 20s;
  bool connected = false;
  while (!connected && MonotonicClock::now() < deadline) {
    (void)client->Command("one", bus::PlayAction::kReset, OrderedJson::object(), 100ms);
    connected = !commands.Take().empty();
  }
  ASSERT_TRUE(connected);
  RequestStop();
  EXPECT_FALSE(client->Command("one", bus::PlayAction::kStop, OrderedJson::object(), 2s)) << "nobody answers";
  int stops = 0;
  while (stops == 0 && MonotonicClock::now() < deadline)
    for (const auto& command : commands.Take()) stops += command.action == bus::PlayAction::kStop;
  EXPECT_EQ(stops, 1);
}

}  // namespace stop_test
}  // namespace etude::play
