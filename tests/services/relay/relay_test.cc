// SPDX-License-Identifier: Apache-2.0
// Tests services/relay/relay.cc
#include "services/relay/relay.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <map>
#include <optional>

#include "services/core/clock.h"
#include "services/relay/kept_checkpoints.h"
#include "services/security/checkpoint_signature.h"
#include "tests/services/bus/two_processes.h"
#include "tests/services/relay/example_run.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/wait_until.h"

namespace etude::relay {
namespace relay_test {

using namespace std::chrono_literals;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr std::uint32_t kDomain = 55;
constexpr auto kPatience = 50ms;
// versions as a trainer makes them: start and count
constexpr std::uint64_t kStart = 1ull << 32;

// Each test has a run of its own, so that none hears another one's.
class RelayTest : public ::testing::Test {
 protected:
  Relay OpenRelay(const bus::Participant& participant, const std::string& folder = "relay",
                  std::function<Status(const bus::PublishedBlob&)> accept = {}) {
    auto opened = Relay::Open(participant, run_, {folder_ / folder, std::move(accept), kPatience});
    EXPECT_THAT(opened, IsOk());
    return std::move(*opened);
  }
  std::unique_ptr<ExampleRun> Begin(const std::vector<bus::PublishedBlob>& blobs) {
    auto run = std::make_unique<ExampleRun>(peers_.b, run_, folder_ / "run");
    for (const auto& blob : blobs) run->Publish(blob);
    return run;
  }
  bus::PublishedBlob Blob(const std::string& channel, std::uint64_t version) const {
    return ExampleBlob(run_.id, channel, version, version % 1000);
  }
  static bool StepUntil(Relay& relay, const std::function<bool()>& condition) {
    const Stopwatch watch;
    while (!condition() && watch.Seconds() < 20) relay.Step(10ms);
    return condition();
  }
  static bool StepUntilOffered(Relay& relay, const std::vector<std::string>& channels) {
    return StepUntil(relay, [&] { return relay.offered() == channels; });
  }
  // What is kept, as the record on the disk says it.
  std::string Record(const std::string& folder = "relay") const {
    return ReadTextFile(folder_ / folder / "kept.json").value_or("");
  }
  bool StepUntilKept(Relay& relay, std::uint64_t version, const std::string& folder = "relay") const {
    return StepUntil(relay, [&] { return Record(folder).find(std::to_string(version)) != std::string::npos; });
  }
  bus::BlobSubscriber Subscribe(const std::string& channel = "latest", const bus::ReceiveOptions& options = {}) {
    return bus::BlobSubscriber::Open(peers_.b, run_, channel, options).value();
  }

  bus::TwoProcesses peers_ = bus::OpenTwo(kDomain);
  TemporaryFolder folder_;
  bus::Owner run_{"relayed", NewId()};
};

TEST_F(RelayTest, ALateSubscriberGetsTheCheckpointsOfARunThatHasEnded) {
  const auto latest = Blob("latest", kStart + 3), best = Blob("best", kStart + 2);
  auto relay = OpenRelay(peers_.a);
  {
    const auto run = Begin({Blob("latest", kStart + 1), best, latest});
    ASSERT_TRUE(StepUntilKept(relay, latest.version));
    ASSERT_TRUE(StepUntilKept(relay, best.version));
    for (int i = 0; i < 3; ++i) relay.Step(2 * kPatience);
    EXPECT_THAT(relay.offered(), IsEmpty()) << "the run itself is there";
  }
  ASSERT_TRUE(StepUntilOffered(relay, {"best", "latest"}));

  auto subscriber = Subscribe("");
  std::map<std::string, bus::PublishedBlob> got;
  while (got.size() < 2) {
    auto blob = subscriber.Wait(20s);
    ASSERT_TRUE(blob);
    got[blob->channel] = std::move(*blob);
  }
  ExpectSame(got["latest"], latest);
  ExpectSame(got["best"], best);
  EXPECT_FALSE(subscriber.Wait(50ms)) << "each of them once";
}

TEST_F(RelayTest, WhenTheRunIsThereAgainItStepsBackAndTheNewerOneWins) {
  const auto old = Blob("latest", kStart + 3), fresh = Blob("latest", 2 * kStart + 1);
  auto relay = OpenRelay(peers_.a);
  {
    const auto run = Begin({old});
    ASSERT_TRUE(StepUntilKept(relay, old.version));
  }
  ASSERT_TRUE(StepUntilOffered(relay, {"latest"}));
  auto early = Subscribe();
  ASSERT_EQ(early.Wait(20s).value().version, old.version);

  auto run = Begin({fresh});
  ExpectSame(early.Wait(20s).value(), fresh);
  ASSERT_TRUE(StepUntilOffered(relay, {}));
  EXPECT_TRUE(StepUntilKept(relay, fresh.version));
  auto late = Subscribe();
  ExpectSame(late.Wait(20s).value(), fresh);
  EXPECT_FALSE(late.Wait(50ms));

  run.reset();
  ASSERT_TRUE(StepUntilOffered(relay, {"latest"}));
  auto last = Subscribe();
  ExpectSame(last.Wait(20s).value(), fresh);
}

// As when its folder was restored from an older copy.
TEST_F(RelayTest, ARunThatWasRolledBackTakesNothingAway) {
  const auto newest = Blob("latest", 2 * kStart + 5), older = Blob("latest", kStart + 4);
  auto relay = OpenRelay(peers_.a);
  {
    const auto run = Begin({newest});
    ASSERT_TRUE(StepUntilKept(relay, newest.version));
  }
  ASSERT_TRUE(StepUntilOffered(relay, {"latest"}));
  const auto run = Begin({older});
  auto watching = Subscribe();
  std::uint64_t version = 0;
  while (version != newest.version) {  // the older one may come first, never last
    const auto blob = watching.Wait(20s);
    ASSERT_TRUE(blob);
    version = blob->version;
  }
  for (int i = 0; i < 3; ++i) relay.Step(2 * kPatience);
  EXPECT_THAT(relay.offered(), ElementsAre("latest"));
  EXPECT_THAT(Record(), ::testing::HasSubstr(std::to_string(newest.version)));
  EXPECT_FALSE(watching.Wait(50ms));
}

TEST_F(RelayTest, GoesOnFromItsDiskAlone) {
  const auto newest = Blob("latest", kStart + 9);
  {
    auto relay = OpenRelay(peers_.a);
    const auto run = Begin({newest});
    ASSERT_TRUE(StepUntilKept(relay, newest.version));
  }
  auto relay = OpenRelay(peers_.a);
  ASSERT_TRUE(StepUntilOffered(relay, {"latest"}));
  auto subscriber = Subscribe();
  ExpectSame(subscriber.Wait(20s).value(), newest);
}

TEST_F(RelayTest, TwoOfThemDoNoHarm) {
  const auto old = Blob("latest", kStart + 3), fresh = Blob("latest", 2 * kStart + 1);
  auto one = OpenRelay(peers_.a, "one"), other = OpenRelay(peers_.b, "other");
  {
    const auto run = Begin({old});
    ASSERT_TRUE(StepUntilKept(one, old.version, "one"));
    ASSERT_TRUE(StepUntilKept(other, old.version, "other"));
  }
  ASSERT_TRUE(StepUntilOffered(one, {"latest"}));
  ASSERT_TRUE(StepUntilOffered(other, {"latest"}));
  auto subscriber = Subscribe();
  ExpectSame(subscriber.Wait(20s).value(), old);
  EXPECT_FALSE(subscriber.Wait(50ms)) << "the same version of both is one";

  const auto run = Begin({fresh});
  ExpectSame(subscriber.Wait(20s).value(), fresh);
  ASSERT_TRUE(StepUntilOffered(one, {}));
  ASSERT_TRUE(StepUntilOffered(other, {}));
}

TEST_F(RelayTest, SignaturesAreCheckedAndPassedOn) {
  const Path key = folder_ / "signing.key", public_key = key.string() + ".pub";
  ASSERT_THAT(security::MakeSigningKey(key), IsOk());
  const auto signer = security::CheckpointSigner::Open(key).value();
  const auto verifier = [&](const char* floor) {
    return bus::AcceptSigned(std::make_shared<security::CheckpointVerifier>(
        security::CheckpointVerifier::Open(public_key, folder_ / floor).value()));
  };
  const auto forged = Blob("latest", kStart + 2);
  auto is_signed = Blob("latest", kStart + 1);
  is_signed.meta_json =
      signer.Sign({run_.id, "latest", is_signed.version, is_signed.sha256}, is_signed.meta_json).value();
  auto relay = OpenRelay(peers_.a, "relay", verifier("relay.floor"));
  {
    const auto run = Begin({is_signed});
    ASSERT_TRUE(StepUntilKept(relay, is_signed.version));
    run->Publish(forged);
    for (int i = 0; i < 5; ++i) relay.Step(kPatience);
  }
  ASSERT_TRUE(StepUntilOffered(relay, {"latest"}));
  auto subscriber = Subscribe("latest", {.accept = verifier("subscriber.floor")});
  ExpectSame(subscriber.Wait(20s).value(), is_signed);
}

// before, it was offered for ever, and kept every signed one of a lower version away
TEST_F(RelayTest, WhatWasKeptUnsignedIsForgottenOnceSignaturesAreAskedFor) {
  const Path key = folder_ / "signing.key", public_key = key.string() + ".pub";
  ASSERT_THAT(security::MakeSigningKey(key), IsOk());
  const auto forged = Blob("latest", kStart + 5);
  {
    auto relay = OpenRelay(peers_.a);
    const auto run = Begin({forged});
    ASSERT_TRUE(StepUntilKept(relay, forged.version));
  }
  auto is_signed = Blob("latest", kStart + 4);
  is_signed.meta_json = security::CheckpointSigner::Open(key)
                            .value()
                            .Sign({run_.id, "latest", is_signed.version, is_signed.sha256}, is_signed.meta_json)
                            .value();
  auto relay = OpenRelay(peers_.a, "relay",
                         bus::AcceptSigned(std::make_shared<security::CheckpointVerifier>(
                             security::CheckpointVerifier::Open(public_key, folder_ / "relay.floor").value())));
  EXPECT_EQ(Record().find("latest"), std::string::npos);
  for (int i = 0; i < 5; ++i) relay.Step(kPatience);
  EXPECT_THAT(relay.offered(), IsEmpty());
  {
    const auto run = Begin({is_signed});
    ASSERT_TRUE(StepUntilKept(relay, is_signed.version));
  }
  ASSERT_TRUE(StepUntilOffered(relay, {"latest"}));
  auto subscriber = Subscribe();
  ExpectSame(subscriber.Wait(20s).value(), is_signed);
}

// before, what was kept went, signed as it was
TEST_F(RelayTest, AFloorThatIsDamagedMeanwhileTakesNothingAway) {
  const Path key = folder_ / "signing.key", floor = folder_ / "relay.floor";
  ASSERT_THAT(security::MakeSigningKey(key), IsOk());
  auto is_signed = Blob("latest", kStart + 1);
  is_signed.meta_json = security::CheckpointSigner::Open(key)
                            .value()
                            .Sign({run_.id, "latest", is_signed.version, is_signed.sha256}, is_signed.meta_json)
                            .value();
  {
    auto relay = OpenRelay(peers_.a);
    const auto run = Begin({is_signed});
    ASSERT_TRUE(StepUntilKept(relay, is_signed.version));
  }
  auto accept = bus::AcceptSigned(std::make_shared<security::CheckpointVerifier>(
      security::CheckpointVerifier::Open(key.string() + ".pub", floor).value()));
  ASSERT_THAT(WriteFileAtomically(floor, std::string_view("{")), IsOk());
  auto relay = OpenRelay(peers_.a, "relay", std::move(accept));
  EXPECT_NE(Record().find(std::to_string(is_signed.version)), std::string::npos);
  EXPECT_TRUE(StepUntilOffered(relay, {"latest"}));
}

// before, with a full disk an old checkpoint was offered beside the run that had newer ones
TEST_F(RelayTest, WhatCannotBeKeptNowShowsThatTheRunIsThere) {
  const auto old = Blob("latest", kStart + 1);
  auto relay = OpenRelay(peers_.a, "relay", [&](const bus::PublishedBlob& blob) -> Status {
    if (blob.version > old.version) return Fail(Code::kUnavailable, "no space left");
    return {};
  });
  auto run = Begin({old});
  ASSERT_TRUE(StepUntilKept(relay, old.version));
  for (std::uint64_t version : {kStart + 2, kStart + 3}) run->Publish(Blob("latest", version));
  for (int i = 0; i < 20; ++i) relay.Step(kPatience);
  EXPECT_THAT(relay.offered(), IsEmpty());

  run.reset();
  EXPECT_TRUE(StepUntilOffered(relay, {"latest"})) << "better than nothing";
}

TEST_F(RelayTest, WhatIsNoCheckpointIsNotKept) {
  auto relay = OpenRelay(peers_.a);
  auto garbage = Blob("latest", kStart + 1);
  garbage.bytes.assign(1000, 7);
  const auto good = Blob("best", kStart + 2);
  const auto run = Begin({garbage, good});
  ASSERT_TRUE(StepUntilKept(relay, good.version));
  EXPECT_EQ(Record().find("latest"), std::string::npos);
}

TEST_F(RelayTest, IsFoundByTheRunsNameWhileTheRunIsNotThere) {
  auto directory = bus::Directory::Open(peers_.b).value();
  const Selector by_name{run_.name, ""};
  EXPECT_FALSE(directory.FindPublisher(by_name, 1ms).value());
  const auto relay = OpenRelay(peers_.a);
  const auto found = directory.FindPublisher(by_name, 10s).value();
  ASSERT_TRUE(found);
  EXPECT_EQ(found->kind, bus::PresenceKind::kRelay);
  EXPECT_EQ(found->id, run_.id);
  const auto run = Begin({});
  ASSERT_TRUE(WaitUntil([&] { return directory.FindPublisher(by_name, 1s).value()->kind == bus::PresenceKind::kRun; }));
}

TEST_F(RelayTest, AFolderOfAnotherNameIsLeftAlone) {
  const Path folder = folder_ / "relay";
  {
    auto relay = OpenRelay(peers_.a);
    const auto run = Begin({Blob("latest", kStart + 1)});
    ASSERT_TRUE(StepUntilKept(relay, kStart + 1));
  }
  const Status ended =
      RelayRuns(peers_.b, Selector{"other", "00000000000000aa"}, {.folder = folder}, [] { return false; });
  ASSERT_FALSE(ended);
  EXPECT_EQ(ended.error().code, Code::kInvalidArgument);
  EXPECT_THAT(ended.error().message, HasSubstr("give another folder"));
  EXPECT_EQ(KeptRun(folder).value()->id, run_.id);
}

}  // namespace relay_test
}  // namespace etude::relay
