// SPDX-License-Identifier: Apache-2.0
// A stop request ends every wait. A process of its own, since the request cannot be taken back.
#include "services/core/stop.h"

#include <gtest/gtest.h>

#include <thread>

#include "services/bus/blob_transfer.h"
#include "services/bus/topic.h"
#include "services/core/clock.h"
#include "tests/services/bus/two_processes.h"

namespace etude::bus {
namespace stop_test {

using namespace std::chrono_literals;

TEST(Stop, EndsEveryWait) {
  const auto peers = OpenTwo(107);
  auto reader = Reader<WorkRequest>::Open(peers.a, "stop");
  auto writer = Writer<WorkRequest>::Open(peers.a, "stop/nobody");
  auto sender = BlobSender::Open(peers.a, {"stop", "1"}, "episode", "s");
  auto receiver = BlobReceiver::Open(peers.b, {"stop", "1"}, "other");
  auto subscriber = BlobSubscriber::Open(peers.b, {"stop", "1"}, "");
  ASSERT_TRUE(reader && writer && sender && receiver && subscriber);
  const Stopwatch watch;
  std::vector<std::thread> waits;
  waits.emplace_back([&] { EXPECT_FALSE(reader->Wait(1h)); });
  waits.emplace_back([&] { EXPECT_FALSE(writer->WaitForReaders(1, 1h)); });
  waits.emplace_back([&] {
    const auto verdict = sender->Send(1, MakeBytes(10, 1), 0, "", 1h);
    ASSERT_FALSE(verdict);
    EXPECT_EQ(verdict.error().code, Code::kTimeout);
    EXPECT_NE(verdict.error().message.find("stop"), std::string::npos);
  });
  waits.emplace_back([&] { EXPECT_FALSE(receiver->Receive(1h)); });
  waits.emplace_back([&] { EXPECT_FALSE(subscriber->Wait(1h)); });
  RequestStop();
  for (auto& wait : waits) wait.join();
  EXPECT_LT(watch.Seconds(), 20.0);
}

}  // namespace stop_test
}  // namespace etude::bus
