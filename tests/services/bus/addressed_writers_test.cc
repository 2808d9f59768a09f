// SPDX-License-Identifier: Apache-2.0
// Tests services/bus/addressed_writers.cc: what is meant for one host comes to it, and to no other.
#include "services/bus/addressed_writers.h"

#include <gtest/gtest.h>

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "services/bus/owner.h"
#include "services/bus/topic.h"
#include "services/core/clock.h"
#include "services/core/file.h"
#include "services/core/stop.h"
#include "tests/services/bus/two_processes.h"

namespace etude::bus {
namespace addressed_writers_test {

using namespace std::chrono_literals;

constexpr std::uint32_t kDomain = 109;
constexpr double kPatienceS = 20;
constexpr char kCampaign[] = "q/1";

Lease To(const std::string& worker) {
  Lease lease;
  lease.worker = worker;
  return lease;
}

// Tidies up until `met`.
bool TidyUntil(AddressedWriters<Lease>& writers, const std::function<bool()>& met) {
  for (const Stopwatch watch; watch.Seconds() < kPatienceS; WaitForStop(5ms)) {
    writers.Tidy();
    if (met()) return true;
  }
  return false;
}

// What comes to one host.
class Host {
 public:
  Host(const Participant& participant, const std::string& partition)
      : reader_(Reader<Lease>::Open(participant, partition).value()) {}
  std::size_t Count() {
    for (auto& lease : reader_.Take()) workers.push_back(lease.worker);
    return workers.size();
  }
  int matched_writers() const { return reader_.matched_writers(); }

  std::vector<std::string> workers;

 private:
  Reader<Lease> reader_;
};

TEST(AddressedWriters, EachHostGetsWhatIsMeantForItAndNothingElse) {
  const auto peers = OpenTwo(kDomain);
  AddressedWriters<Lease> writers(peers.a, kCampaign);
  Host one(peers.b, PartitionOfAddress(kCampaign, "rack-1")), two(peers.b, PartitionOfAddress(kCampaign, "rack-2")),
      all(peers.b, kCampaign);
  constexpr std::size_t kLeases = 30;
  for (std::size_t k = 0; k < kLeases; ++k) {
    ASSERT_TRUE(writers.Write("rack-1", To("one")));
    if (k % 3 == 0) {
      ASSERT_TRUE(writers.Write("rack-2", To("two")));
    }
  }
  EXPECT_EQ(writers.addresses(), 2u);
  EXPECT_TRUE(TidyUntil(writers, [&] { return one.Count() == kLeases && two.Count() == kLeases / 3; }));
  EXPECT_EQ(one.workers, std::vector<std::string>(kLeases, "one"));
  EXPECT_EQ(two.workers, std::vector<std::string>(kLeases / 3, "two"));
  EXPECT_EQ(one.matched_writers(), 1) << "the other host's writer does not even know of it";
  EXPECT_EQ(two.matched_writers(), 1);
  EXPECT_EQ(all.Count(), 0u);
  EXPECT_EQ(all.matched_writers(), 0);
}

TEST(AddressedWriters, WithoutAHostItIsThePartitionItself) {
  const auto peers = OpenTwo(kDomain);
  AddressedWriters<Lease> writers(peers.a, kCampaign);
  Host all(peers.b, kCampaign), one(peers.b, PartitionOfAddress(kCampaign, "rack-1"));
  ASSERT_TRUE(writers.Write("", To("older")));
  EXPECT_TRUE(TidyUntil(writers, [&] { return all.Count() == 1; }));
  EXPECT_EQ(one.Count(), 0u);
}

TEST(AddressedWriters, TheFirstWordsWaitForTheirReader) {
  const auto peers = OpenTwo(kDomain);
  AddressedWriters<Lease> writers(peers.a, kCampaign, {.wait = 20s});
  ASSERT_TRUE(writers.Write("late", To("first")));
  ASSERT_TRUE(writers.Write("late", To("second")));
  EXPECT_TRUE(writers.waiting());
  Host late(peers.b, PartitionOfAddress(kCampaign, "late"));
  EXPECT_TRUE(TidyUntil(writers, [&] { return late.Count() == 2; }));
  EXPECT_EQ(late.workers, (std::vector<std::string>{"first", "second"}));
  EXPECT_FALSE(writers.waiting());
}

TEST(AddressedWriters, WhatWaitsIsBoundedInNumberAndTime) {
  const auto peers = OpenTwo(kDomain);
  AddressedWriters<Lease> writers(peers.a, kCampaign, {.most_waiting = 3, .wait = 50ms});
  for (const char* host : {"a", "b", "c"}) ASSERT_TRUE(writers.Write(host, To("nobody")));
  const Status one_more = writers.Write("d", To("nobody"));
  ASSERT_FALSE(one_more);
  EXPECT_EQ(one_more.error().code, Code::kExhausted);
  EXPECT_TRUE(TidyUntil(writers, [&] { return !writers.waiting(); }));
}

TEST(AddressedWriters, WhoIsToldAgainAndAgainHearsTheNewest) {
  const auto peers = OpenTwo(kDomain);
  AddressedWriters<Lease> writers(peers.a, kCampaign, {.most_waiting = 2, .most_waiting_each = 2, .wait = 20s});
  for (const char* word : {"first", "second", "third"}) ASSERT_TRUE(writers.Write("late", To(word)));
  Host late(peers.b, PartitionOfAddress(kCampaign, "late"));
  EXPECT_TRUE(TidyUntil(writers, [&] { return late.Count() == 2; }));
  EXPECT_EQ(late.workers, (std::vector<std::string>{"second", "third"}));
}

TEST(AddressedWriters, WhoseWordsFoundNoRoomIsForgottenToo) {
  const auto peers = OpenTwo(kDomain);
  AddressedWriters<Lease> writers(peers.a, kCampaign, {.most_waiting = 0, .gone = 100ms});
  EXPECT_FALSE(writers.Write("nobody", To("nobody")));
  EXPECT_EQ(writers.addresses(), 1u);
  EXPECT_TRUE(TidyUntil(writers, [&] { return writers.addresses() == 0; }));
}

TEST(AddressedWriters, HostsThatHaveGoneAreForgotten) {
  const auto peers = OpenTwo(kDomain);
  AddressedWriters<Lease> writers(peers.a, kCampaign, {.gone = 100ms});
  Host stays(peers.b, PartitionOfAddress(kCampaign, "stays"));
  for (int life = 0; life < 2; ++life) {  // and found again
    std::optional<Host> goes(std::in_place, peers.b, PartitionOfAddress(kCampaign, "goes"));
    ASSERT_TRUE(writers.Write("goes", To("goes")));
    ASSERT_TRUE(writers.Write("stays", To("stays")));
    EXPECT_TRUE(TidyUntil(writers, [&] { return goes->Count() == 1; })) << life;
    EXPECT_EQ(writers.addresses(), 2u);
    goes.reset();
    EXPECT_TRUE(TidyUntil(writers, [&] { return writers.addresses() == 1; })) << life;
  }
  ASSERT_TRUE(writers.Write("stays", To("stays")));
  EXPECT_TRUE(TidyUntil(writers, [&] { return stays.Count() == 3; }));
}

TEST(AddressedWriters, ThereAreNoMoreThanAllowed) {
  const auto peers = OpenTwo(kDomain);
  AddressedWriters<Lease> writers(peers.a, kCampaign, {.most_addresses = 2});
  for (const char* invented : {"a", "b", "c", "d"}) ASSERT_TRUE(writers.Write(invented, To("nobody")));
  EXPECT_EQ(writers.addresses(), 2u) << "those that nobody reads make room";
  Host one(peers.b, PartitionOfAddress(kCampaign, "one")), two(peers.b, PartitionOfAddress(kCampaign, "two"));
  ASSERT_TRUE(writers.Write("one", To("one")));
  EXPECT_TRUE(TidyUntil(writers, [&] { return one.Count() == 1; }));
  ASSERT_TRUE(writers.Write("two", To("two")));
  EXPECT_TRUE(TidyUntil(writers, [&] { return two.Count() == 1; }));
  const Status third = writers.Write("three", To("three"));
  ASSERT_FALSE(third) << "those that are there stay";
  EXPECT_EQ(third.error().code, Code::kExhausted);
  ASSERT_TRUE(writers.Write("one", To("one")));
  EXPECT_TRUE(TidyUntil(writers, [&] { return one.Count() == 2; }));
}

TEST(AddressedWriters, NamesFromTheBusAreLookedAt) {
  const auto peers = OpenTwo(kDomain);
  AddressedWriters<Lease> writers(peers.a, kCampaign);
  for (const std::string& name : {std::string("*"), std::string("../q"), std::string("a/b"), std::string("rack?"),
                                  std::string("RACK"), std::string("a b"), std::string(65, 'a')}) {
    const Status written = writers.Write(name, To("nobody"));
    ASSERT_FALSE(written) << name;
    EXPECT_EQ(written.error().code, Code::kInvalidArgument) << name;
  }
  EXPECT_EQ(writers.addresses(), 0u);
}

TEST(Address, OfAProcessIsAPlainNameThatTellsItsHost) {
  EXPECT_EQ(AddressOnHost("lab-7", 0x1c2d3e4), "lab-7--01c2d3e4");
  EXPECT_EQ(HostOfAddress("lab-7--01c2d3e4"), "lab-7");
  const std::string longest = AddressOnHost("b" + std::string(63, 'a'), 0xffffffffu);
  EXPECT_TRUE(IsPlainName(longest)) << longest;
  EXPECT_EQ(HostOfAddress(longest), std::string(54, 'a'));
  for (const char* own : {"rack-1", "", "--01c2d3e4", "lab--01c2d3e", "lab--01c2d3eg", "lab-01c2d3e4"})
    EXPECT_EQ(HostOfAddress(own), own);
}

TEST(ParticipantAddress, IsAPlainNameOfItsOwn) {
  const auto peers = OpenTwo(kDomain);
  EXPECT_TRUE(IsPlainName(peers.a.address())) << peers.a.address();
  EXPECT_NE(peers.a.address(), peers.b.address()) << "what one is told is no other's business";
  EXPECT_EQ(HostOfAddress(peers.a.address()), HostOfAddress(peers.b.address())) << "one machine";
  const std::string profile = LocalProfileWith("<ExternalDomainId>" + std::to_string(kDomain) + "</ExternalDomainId>");
  const auto named = Participant::Open({150, profile, "", {}, "rack-7"});
  ASSERT_TRUE(named) << named.error().message;
  EXPECT_EQ(named->address(), "rack-7");
  EXPECT_EQ(named->Share().address(), "rack-7");
  for (const char* bad : {"Rack", "a/b", "*"}) {
    const auto refused = Participant::Open({150, profile, "", {}, bad});
    ASSERT_FALSE(refused) << bad;
    EXPECT_EQ(refused.error().code, Code::kInvalidArgument) << bad;
  }
}

}  // namespace addressed_writers_test
}  // namespace etude::bus
