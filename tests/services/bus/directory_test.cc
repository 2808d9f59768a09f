// SPDX-License-Identifier: Apache-2.0
#include "services/bus/directory.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "services/bus/access.h"
#include "services/bus/topic.h"
#include "services/core/clock.h"
#include "services/security/authority.h"
#include "tests/services/bus/two_processes.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/wait_until.h"

namespace etude::bus {
namespace directory_test {

using namespace std::chrono_literals;

constexpr std::uint32_t kDomain = 71;

Presence MakeRun(const std::string& name, const std::string& id, const std::string& folder, std::uint64_t epoch = 1) {
  Presence presence = MakePresence(PresenceKind::kRun, name, id, folder);
  presence.epoch = epoch;
  return presence;
}

Announcement Announce(const Participant& participant, const Presence& presence, Claim claim = Claim::kRefuse) {
  auto announcement = Announcement::Open(participant, presence, claim);
  EXPECT_TRUE(announcement) << announcement.error().message;
  return std::move(*announcement);
}

// Until `participant` sees another one: who claims looks around for 0.3 s, which is short on a busy machine.
void WaitUntilSeen(const Participant& participant) {
  auto directory = Directory::Open(participant).value();
  ASSERT_TRUE(WaitUntil([&] { return !directory.Live().empty(); }));
}

TEST(Directory, FindsByNameAndByIdAndForgetsWhoEnded) {
  const auto peers = OpenTwo(kDomain);
  auto directory = Directory::Open(peers.b).value();
  {
    const auto run = Announce(peers.a, MakeRun("demo", "aaaa000000000001", "/a"));
    for (const char* text : {"demo", "demo@a", "demo@aaaa000000000001"}) {
      const auto found = directory.Find(PresenceKind::kRun, ParseSelector(text, "run").value(), 10s);
      ASSERT_TRUE(found) << found.error().message;
      ASSERT_TRUE(*found) << text;
      EXPECT_EQ((*found)->id, "aaaa000000000001");
      EXPECT_EQ((*found)->folder, "/a");
      EXPECT_EQ((*found)->host, HostName());
    }
    EXPECT_FALSE(directory.Find(PresenceKind::kRun, {"demo", "b"}, 1ms).value());
    EXPECT_FALSE(directory.Find(PresenceKind::kRun, {"dem", ""}, 1ms).value());
    EXPECT_FALSE(directory.Find(PresenceKind::kCampaign, {"demo", ""}, 1ms).value());
  }
  EXPECT_TRUE(WaitUntil([&] { return directory.Live().empty(); }));
}

// A name is free for everybody: what followed one user's run must not go on with another's.
TEST(Directory, OnlyTheSameUsersNextOneTakesThePlaceOfOneThatHasGone) {
  const auto peers = OpenTwo(kDomain);
  auto directory = Directory::Open(peers.b).value();
  const auto replaced = [&](const std::string& user) {
    return directory.Replaced(PresenceKind::kRun, {"next", ""}, "aaaa000000000001", user);
  };
  Presence others = MakeRun("next", "bbbb000000000002", "/b");
  others.user = "somebody-else";
  const auto other = Announce(peers.a, others);
  ASSERT_TRUE(WaitUntil([&] { return directory.Live().size() == 1; }));
  EXPECT_FALSE(replaced(UserName()));
  EXPECT_TRUE(replaced("somebody-else"));
  EXPECT_TRUE(replaced("")) << "whoever's";
  const auto own = Announce(peers.a, MakeRun("next", "cccc000000000003", "/c"));
  EXPECT_TRUE(WaitUntil([&] { return replaced(UserName()); }));
}

TEST(Directory, CheckpointsComeFromTheRunOrWhereItIsNotThereFromARelay) {
  const auto peers = OpenTwo(kDomain);
  auto directory = Directory::Open(peers.b).value();
  const auto publisher = [&] { return directory.FindPublisher({"passed-on", ""}, 10s).value(); };
  const auto relay = Announce(peers.a, MakePresence(PresenceKind::kRelay, "passed-on", "aaaa000000000001", "/relay"));
  const auto other =
      Announce(peers.b, MakePresence(PresenceKind::kRelay, "passed-on", "aaaa000000000001", "/other"), Claim::kAdopt);
  ASSERT_TRUE(publisher());
  EXPECT_EQ(publisher()->kind, PresenceKind::kRelay);
  {
    const auto run = Announce(peers.a, MakeRun("passed-on", "aaaa000000000001", "/run"));
    EXPECT_TRUE(WaitUntil([&] { return publisher()->kind == PresenceKind::kRun; }));
    EXPECT_EQ(publisher()->folder, "/run");
  }
  EXPECT_TRUE(WaitUntil([&] { return publisher()->kind == PresenceKind::kRelay; }));
}

TEST(Directory, ANameThatMeansTwoThingsIsAnsweredByAList) {
  const auto peers = OpenTwo(kDomain);
  const auto one = Announce(peers.a, MakeRun("two", "aaaa000000000001", "/one"));
  const auto other = Announce(peers.b, MakeRun("two", "bbbb000000000002", "/other"));
  auto directory = Directory::Open(peers.b).value();
  ASSERT_TRUE(WaitUntil([&] { return directory.Live().size() == 2; }));

  const auto found = directory.Find(PresenceKind::kRun, {"two", ""}, 10s);

  ASSERT_FALSE(found);
  EXPECT_EQ(found.error().code, Code::kInvalidArgument);
  for (const std::string& text :
       {std::string("two@aaaa000000000001"), std::string("two@bbbb000000000002"), std::string("/one"),
        std::string("/other"), HostName(), UserName(), std::string("since 20")})
    EXPECT_NE(found.error().message.find(text), std::string::npos) << text << "\n" << found.error().message;
  const auto selected = directory.Find(PresenceKind::kRun, {"two", "bb"}, 10s);
  ASSERT_TRUE(selected && *selected);
  EXPECT_EQ((*selected)->folder, "/other");
}

Presence MakeShard(const std::string& id, std::uint32_t shard, std::uint32_t shards, const std::string& spec = "abc") {
  Presence presence = MakePresence(PresenceKind::kCampaign, "shared", id, "/" + id);
  presence.epoch = 1;
  presence.shard = shard;
  presence.shards = shards;
  presence.spec_sha256 = spec;
  return presence;
}

TEST(Directory, ShardsOfACampaignAreOne) {
  const auto peers = OpenTwo(kDomain);
  const auto second = Announce(peers.a, MakeShard("bbbb000000000002", 2, 2));
  const auto first = Announce(peers.b, MakeShard("aaaa000000000001", 1, 2));
  auto directory = Directory::Open(peers.b).value();
  ASSERT_TRUE(WaitUntil([&] { return directory.Live().size() == 2; }));

  const auto found = directory.FindCampaign({"shared", ""}, 10s);
  ASSERT_TRUE(found) << found.error().message;
  ASSERT_EQ(found->size(), 2u);
  EXPECT_EQ(found->front().shard, 1u);
  EXPECT_EQ(found->back().shard, 2u);
  EXPECT_EQ(directory.FindCampaign({"shared", "b"}, 10s)->size(), 1u) << "an id is one of them";
  EXPECT_FALSE(directory.Find(PresenceKind::kCampaign, {"shared", ""}, 10s));
  EXPECT_TRUE(directory.FindCampaign({"none", ""}, 1ms)->empty());

  const auto other = Announce(peers.a, MakeShard("cccc000000000003", 1, 2, "another spec"));
  ASSERT_TRUE(WaitUntil([&] { return directory.Live().size() == 3; }));
  const auto several = directory.FindCampaign({"shared", ""}, 10s);
  ASSERT_FALSE(several);
  for (const char* text : {"means 3 things", "shard 2/2"})
    EXPECT_NE(several.error().message.find(text), std::string::npos) << several.error().message;
}

TEST(Directory, AShardThatIsLiveElsewhereIsRefusedUnlessAdopted) {
  const auto peers = OpenTwo(kDomain);
  auto original = Announce(peers.a, MakeShard("aaaa000000000001", 1, 2));
  WaitUntilSeen(peers.b);
  for (const auto& rival : {MakeShard("bbbb000000000002", 1, 2), MakeShard("bbbb000000000002", 2, 3)}) {
    const auto refused = Announcement::Open(peers.b, rival, Claim::kRefuse);
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, Code::kUnavailable);
    for (const char* text : {"/aaaa000000000001", "shard 1/2", "--adopt", "--set name="})
      EXPECT_NE(refused.error().message.find(text), std::string::npos) << refused.error().message;
  }
  EXPECT_TRUE(Announcement::Open(peers.b, MakeShard("bbbb000000000002", 1, 2, "another spec"), Claim::kRefuse));
  EXPECT_TRUE(Announcement::Open(peers.b, MakeShard("bbbb000000000002", 2, 2), Claim::kRefuse));

  const auto adopted = Announce(peers.b, MakeShard("bbbb000000000002", 1, 2), Claim::kAdopt);
  EXPECT_EQ(adopted.presence().epoch, 2u);
  ASSERT_TRUE(WaitUntil([&] { return original.Successor().has_value(); }));
  EXPECT_NE(GivingWay(original.presence(), *original.Successor()).message.find("shard 1/2 of it"), std::string::npos);
}

TEST(Directory, AnotherWireNumberIsRefusedByName) {
  const auto peers = OpenTwo(kDomain);
  Presence old = MakeRun("old", "aaaa000000000001", "/a");
  old.wire = 1;
  old.version = "0.0.9";
  const auto announced = Announce(peers.a, old);
  auto directory = Directory::Open(peers.b).value();
  const auto found = directory.Find(PresenceKind::kRun, {"old", ""}, 10s);
  ASSERT_FALSE(found);
  EXPECT_EQ(found.error().code, Code::kUnavailable);
  EXPECT_NE(found.error().message.find("run 'old'"), std::string::npos) << found.error().message;
  EXPECT_NE(found.error().message.find("wire number 1"), std::string::npos) << found.error().message;
  EXPECT_NE(found.error().message.find("0.0.9"), std::string::npos) << found.error().message;
}

TEST(Directory, AnIdThatIsLiveElsewhereIsRefusedUnlessAdopted) {
  const auto peers = OpenTwo(kDomain);
  auto original = Announce(peers.a, MakeRun("copied", "aaaa000000000001", "/original", 5));
  EXPECT_FALSE(original.Successor());
  WaitUntilSeen(peers.b);

  const auto refused = Announcement::Open(peers.b, MakeRun("copied", "aaaa000000000001", "/copy", 5), Claim::kRefuse);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, Code::kUnavailable);
  for (const char* text : {"/original", "--new-id", "--adopt"})
    EXPECT_NE(refused.error().message.find(text), std::string::npos) << refused.error().message;

  auto adopted = Announce(peers.b, MakeRun("copied", "aaaa000000000001", "/copy", 5), Claim::kAdopt);
  EXPECT_EQ(adopted.presence().epoch, 6u);
  EXPECT_TRUE(WaitUntil([&] { return original.Successor().has_value(); }));
  EXPECT_EQ(original.Successor()->folder, "/copy");
  EXPECT_FALSE(adopted.Successor());
  // of two with one id the newer one is meant
  auto directory = Directory::Open(peers.a).value();
  EXPECT_EQ(directory.Find(PresenceKind::kRun, {"copied", ""}, 10s).value()->folder, "/copy");
}

// Who joins under security hears the others only once they have been authenticated: each of these looks around at once.
TEST(Directory, UnderSecurityAnIdThatIsLiveElsewhereIsRefusedToo) {
  const TemporaryFolder authority;
  ASSERT_TRUE(security::InitAuthority(authority.path(), security::Protection::kEncrypt));
  const auto join = [&](std::uint32_t domain, const std::string& name) {
    const std::vector roles{security::Role::kCollector};
    const auto now = static_cast<std::int64_t>(WallSeconds());
    const auto identity = security::Issue(authority.path(), {.name = name,
                                                             .roles = roles,
                                                             .grants = GrantsFor(roles, name, {}, {}),
                                                             .not_before = now - 60,
                                                             .not_after = now + 86400});
    EXPECT_TRUE(identity) << identity.error().message;
    auto participant =
        Participant::Open({domain, LocalProfileWith("<ExternalDomainId>101</ExternalDomainId>"), identity->string()});
    EXPECT_TRUE(participant) << participant.error().message;
    return std::move(*participant);
  };
  const auto campaign = [](const char* folder) {
    return MakePresence(PresenceKind::kCampaign, "secured", "aaaa000000000001", folder);
  };
  const auto first = join(150, "first");
  const auto original = Announce(first, campaign("/original"));
  {
    const auto second = join(151, "second");
    const auto refused = Announcement::Open(second, campaign("/copy"), Claim::kRefuse);
    ASSERT_FALSE(refused) << "two collectors of one campaign would work side by side";
    EXPECT_EQ(refused.error().code, Code::kUnavailable);
    EXPECT_NE(refused.error().message.find("/original"), std::string::npos) << refused.error().message;
  }
  const auto third = join(152, "third");
  auto directory = Directory::Open(third).value();
  directory.WaitForOthers();
  EXPECT_TRUE(directory.Find(PresenceKind::kCampaign, {"secured", ""}, 0s).value()) << "it was there first";
}

TEST(Directory, ThePastOfTheSameFolderIsNoOther) {
  const auto peers = OpenTwo(kDomain);
  const auto killed = Announce(peers.a, MakeRun("killed", "aaaa000000000001", "/same", 1));
  WaitUntilSeen(peers.b);
  auto again = Announce(peers.b, MakeRun("killed", "aaaa000000000001", "/same", 2));
  EXPECT_FALSE(again.Successor());
}

// Before, a campaign that was killed and begun again within its presence's time was refused for a slash.
TEST(Directory, AFolderInAnotherSpellingIsTheSame) {
  const TemporaryFolder folder;
  std::filesystem::create_directory(folder / "data");
  std::filesystem::create_directory_symlink(folder / "data", folder / "link");
  const auto peers = OpenTwo(kDomain);
  const auto killed = Announce(peers.a, MakeRun("spelled", "aaaa000000000001", (folder / "data").string(), 1));
  WaitUntilSeen(peers.b);
  for (const char* spelling : {"data/", "link"}) {
    auto again = Announce(peers.b, MakeRun("spelled", "aaaa000000000001", (folder.path() / spelling).string(), 2));
    EXPECT_FALSE(again.Successor()) << spelling;
  }
}

// Two containers of one host name, each with a copy of the dataset under the same path.
TEST(Directory, AnotherFolderOfTheSamePathIsAnother) {
  const auto peers = OpenTwo(kDomain);
  Presence first = MakeRun("copied", "aaaa000000000001", "/data", 1), second = first;
  second.instance = NewId();
  first.folder_key = "1:2";
  second.folder_key = "1:3";
  const auto there = Announce(peers.a, first);
  WaitUntilSeen(peers.b);
  const auto refused = Announcement::Open(peers.b, second, Claim::kRefuse);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, Code::kUnavailable);
}

// Two that were started before they could see each other: exactly one gives way.
TEST(Directory, OfTwoThatMeetLaterOneGivesWay) {
  const auto peers = OpenTwo(kDomain);
  Presence late = MakeRun("met", "aaaa000000000001", "/late", 3);
  late.since += 1;
  auto first = Announce(peers.a, MakeRun("met", "aaaa000000000001", "/first", 3));
  auto writer = Writer<Presence>::Open(peers.b, "directory").value();
  ASSERT_TRUE(writer.Write(late));
  auto directory = Directory::Open(peers.a).value();
  ASSERT_TRUE(WaitUntil([&] { return directory.Live().size() == 2; }));
  EXPECT_FALSE(first.Successor()) << "it was there first";
  late.epoch = 4;
  ASSERT_TRUE(writer.Write(late));
  EXPECT_TRUE(WaitUntil([&] { return first.Successor().has_value(); })) << "its tokens would be the older ones";
  EXPECT_NE(GivingWay(first.presence(), late).message.find("/late"), std::string::npos);
}

}  // namespace directory_test
}  // namespace etude::bus
