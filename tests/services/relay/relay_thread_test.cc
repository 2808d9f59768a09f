// SPDX-License-Identifier: Apache-2.0
// Tests services/relay/relay_thread.cc, and RelayRuns
#include "services/relay/relay_thread.h"

#include <gtest/gtest.h>

#include <memory>
#include <optional>

#include "services/relay/kept_checkpoints.h"
#include "tests/services/bus/two_processes.h"
#include "tests/services/relay/example_run.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/wait_until.h"

namespace etude::relay {
namespace relay_thread_test {

using namespace std::chrono_literals;

constexpr std::uint32_t kDomain = 56;

std::string KeptId(const Path& folder) {
  const auto kept = KeptRun(folder);
  return kept && *kept ? (*kept)->id : "";
}

TEST(RelayThread, FollowsTheRunsOfItsNameAndServesTheLastOneAfterARestart) {
  const auto peers = bus::OpenTwo(kDomain);
  const TemporaryFolder folder;
  const bus::Owner first{"named", "aaaa000000000001"}, second{"named", "bbbb000000000002"};
  const RelayOptions options{.folder = folder / "relay", .patience = 50ms};
  const auto begin = [&](const bus::Owner& run, std::uint64_t version) {
    auto begun = std::make_unique<ExampleRun>(peers.b, run, folder / run.id);
    begun->Publish(ExampleBlob(run.id, "latest", version, version));
    return begun;
  };
  {
    const RelayThread relay(peers.a, {"named", ""}, options);
    auto run = begin(first, 900);
    ASSERT_TRUE(WaitUntil([&] { return KeptId(options.folder) == first.id; }));
    run.reset();
    run = begin(second, 1);
    ASSERT_TRUE(WaitUntil([&] { return KeptId(options.folder) == second.id; }));
  }
  const RelayThread relay(peers.a, {"named", ""}, options);
  auto subscriber = bus::BlobSubscriber::Open(peers.b, second, "latest").value();
  ExpectSame(subscriber.Wait(20s).value(), ExampleBlob(second.id, "latest", 1, 1));
}

// started again, it took the other user's run for its own, and removed what it was the last to have
TEST(RelayThread, StartedAgainItDoesNotGoOnWithAnotherUsersRun) {
  const auto peers = bus::OpenTwo(kDomain);
  const TemporaryFolder folder;
  const bus::Owner mine{"shared", "aaaa000000000001"}, theirs{"shared", "bbbb000000000002"};
  const RelayOptions options{.folder = folder / "relay", .patience = 50ms};
  {
    const RelayThread relay(peers.a, {"shared", ""}, options);
    ExampleRun run(peers.b, mine, folder / mine.id);
    run.Publish(ExampleBlob(mine.id, "latest", 900, 900));
    ASSERT_TRUE(WaitUntil([&] { return KeptId(options.folder) == mine.id; }));
  }
  auto presence = bus::MakePresence(bus::PresenceKind::kRun, theirs.name, theirs.id, folder / "theirs");
  presence.user = "somebody-else";
  const auto there = bus::Announcement::Open(peers.b, presence, Claim::kRefuse).value();
  auto publisher = bus::BlobPublisher::Open(peers.b, theirs).value();
  const auto blob = ExampleBlob(theirs.id, "latest", 1, 1);
  ASSERT_TRUE(publisher.Publish(blob.channel, blob.version, blob.bytes, blob.meta_json));
  const RelayThread again(peers.a, {"shared", ""}, options);
  auto subscriber = bus::BlobSubscriber::Open(peers.b, mine, "latest").value();
  ExpectSame(subscriber.Wait(20s).value(), ExampleBlob(mine.id, "latest", 900, 900));
  EXPECT_EQ(KeptId(options.folder), mine.id);
}

TEST(RelayThread, OffersTheLastRunUntilItIsClearWhichOneFollowsIt) {
  const auto peers = bus::OpenTwo(kDomain);
  const TemporaryFolder folder;
  const bus::Owner first{"unclear", "aaaa000000000001"}, second{"unclear", "bbbb000000000002"},
      third{"unclear", "cccc000000000003"};
  const RelayOptions options{.folder = folder / "relay", .patience = 50ms};
  auto run = std::make_unique<ExampleRun>(peers.b, first, folder / first.id);
  run->Publish(ExampleBlob(first.id, "latest", 900, 900));
  const RelayThread relay(peers.a, {"unclear", ""}, options);
  ASSERT_TRUE(WaitUntil([&] { return KeptId(options.folder) == first.id; }));
  ExampleRun next(peers.b, second, folder / second.id);
  auto other = std::make_unique<ExampleRun>(peers.b, third, folder / third.id);
  next.Publish(ExampleBlob(second.id, "latest", 1, 1));
  // both are known before the first one goes
  auto directory = bus::Directory::Open(peers.a).value();
  ASSERT_TRUE(WaitUntil([&] { return directory.Matching(bus::PresenceKind::kRun, {"unclear", ""}).size() == 3; }));
  run.reset();

  auto subscriber = bus::BlobSubscriber::Open(peers.b, first, "latest").value();
  ExpectSame(subscriber.Wait(20s).value(), ExampleBlob(first.id, "latest", 900, 900));
  EXPECT_EQ(KeptId(options.folder), first.id);
  other.reset();
  EXPECT_TRUE(WaitUntil([&] { return KeptId(options.folder) == second.id; }));
}

// two users with a default name: the server that it is beside of waits too
TEST(RelayThread, BegunWhereItsNameMeansTwoRunsItRelaysTheOneThatIsLeft) {
  const auto peers = bus::OpenTwo(kDomain);
  const TemporaryFolder folder;
  const bus::Owner first{"doubled", "aaaa000000000001"}, second{"doubled", "bbbb000000000002"};
  const RelayOptions options{.folder = folder / "relay", .patience = 50ms};
  auto run = std::make_unique<ExampleRun>(peers.b, first, folder / first.id);
  ExampleRun other(peers.b, second, folder / second.id);
  other.Publish(ExampleBlob(second.id, "latest", 1, 1));
  auto directory = bus::Directory::Open(peers.a).value();
  ASSERT_TRUE(WaitUntil([&] { return directory.Matching(bus::PresenceKind::kRun, {"doubled", ""}).size() == 2; }));
  const RelayThread relay(peers.a, {"doubled", ""}, options);
  run.reset();
  EXPECT_TRUE(WaitUntil([&] { return KeptId(options.folder) == second.id; }));
}

// What it is beside of goes on, and so does it once it can.
TEST(RelayThread, AFolderThatItCannotHaveYetIsSaidAndTriedAgain) {
  const auto peers = bus::OpenTwo(kDomain);
  const TemporaryFolder folder;
  const bus::Owner run{"kept-out", "aaaa000000000001"};
  auto holder = std::make_optional(KeptCheckpoints::Open(folder / "relay", run));
  ASSERT_THAT(*holder, IsOk());
  const RelayOptions options{.folder = folder / "relay", .patience = 50ms};
  EXPECT_THAT(RelayRuns(peers.a, {run.name, run.id}, options, [] { return false; }), HasCode(Code::kUnavailable));
  ExampleRun published(peers.b, run, folder / run.id);
  const RelayThread relay(peers.a, {run.name, run.id}, options);
  holder.reset();
  published.Publish(ExampleBlob(run.id, "latest", 5, 5));
  EXPECT_TRUE(WaitUntil([&] { return KeptId(options.folder) == run.id; }));
}

}  // namespace relay_thread_test
}  // namespace etude::relay
