// SPDX-License-Identifier: Apache-2.0
// Who may what on a secured bus, with real participants: two DDS domains of this process that are one outside.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "services/bus/access.h"
#include "services/bus/participant_watch.h"
#include "services/bus/profile.h"
#include "services/bus/security_log.h"
#include "services/bus/topic.h"
#include "services/bus/topology.h"
#include "services/bus/typed.h"
#include "services/bus/wire.h"
#include "services/core/clock.h"
#include "services/security/authority.h"
#include "tests/services/bus/two_processes.h"
#include "tests/support/temporary_folder.h"

namespace etude::bus {
namespace security_test {

using namespace std::chrono_literals;
using security::Role;
using ::testing::HasSubstr;

constexpr std::uint32_t kOutside = 85;

std::string Profile() {
  return LocalProfileWith("<ExternalDomainId>" + std::to_string(kOutside) + "</ExternalDomainId>");
}

std::int64_t Now() { return static_cast<std::int64_t>(WallSeconds()); }

class SecurityTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    ours_ = new TemporaryFolder;
    theirs_ = new TemporaryFolder;
    ASSERT_TRUE(security::InitAuthority(ours_->path(), security::Protection::kEncrypt));
    ASSERT_TRUE(security::InitAuthority(theirs_->path(), security::Protection::kEncrypt));
  }
  static void TearDownTestSuite() {
    delete ours_;
    delete theirs_;
  }

  static std::string Identity(const TemporaryFolder& authority, const std::string& name, const std::vector<Role>& roles,
                              const std::vector<std::string>& campaigns = {},
                              const std::vector<std::uint32_t>& domains = {}) {
    const auto issued = security::Issue(authority.path(), {.name = name,
                                                           .roles = roles,
                                                           .grants = GrantsFor(roles, campaigns, {}),
                                                           .domains = domains,
                                                           .not_before = Now() - 60,
                                                           .not_after = Now() + 86400});
    EXPECT_TRUE(issued) << issued.error().message;
    return issued ? issued->string() : "";
  }
  static Participant Join(std::uint32_t domain, const std::string& identity) {
    auto participant = Participant::Open({domain, Profile(), identity});
    EXPECT_TRUE(participant) << participant.error().message;
    return std::move(*participant);
  }

  static TemporaryFolder *ours_, *theirs_;
};
TemporaryFolder* SecurityTest::ours_ = nullptr;
TemporaryFolder* SecurityTest::theirs_ = nullptr;

std::string PartitionIn(Scope scope) {
  switch (scope) {
    case Scope::kDirectory:
      return "directory";
    case Scope::kEpisodes:
      return "q/1/episode";
    case Scope::kPlay:
      return "play";
    default:
      return "q/1";
  }
}

template <class Message>
void ExpectAccess(const Participant& participant, Role role) {
  using T = Traits<Message>;
  const std::string partition = PartitionIn(T::kAccess.scope);
  const bool may_write = (T::kAccess.publish & MaskOf(role)) != 0;
  const bool may_read = (T::kAccess.subscribe & MaskOf(role)) != 0;
  EXPECT_EQ(OpenWriterOf<Message>(participant, partition).has_value(), may_write) << ToString(role) << T::kTopic;
  EXPECT_EQ(OpenReaderOf<Message>(participant, partition).has_value(), may_read) << ToString(role) << T::kTopic;
}

TEST_F(SecurityTest, EveryRoleMayWhatTheTableSaysAndNothingElse) {
  for (const Role role : security::kRoles) {
    const auto participant = Join(150, Identity(*ours_, "role-" + ToString(role), {role}));
#define ETUDE_EXPECT_ACCESS(Name) ExpectAccess<Name>(participant, role);
    ETUDE_MESSAGES(ETUDE_EXPECT_ACCESS)
#undef ETUDE_EXPECT_ACCESS
  }
}

TEST_F(SecurityTest, PublishedCheckpointsAreTheTrainersAndTheRelays) {
  for (const Role role : security::kRoles) {
    const auto participant = Join(150, Identity(*ours_, "published-" + ToString(role), {role}));
    const auto publish = [&](const char* partition) {
      return OpenWriter(participant, partition, etude_wire_PublishedManifest_desc, kPublishedManifestTopic,
                        kPublishedWriter)
          .has_value();
    };
    EXPECT_EQ(publish("run/1"), role == Role::kTrainer) << ToString(role);
    EXPECT_EQ(publish("run/1/relay"), role == Role::kTrainer || role == Role::kRelay) << ToString(role);
    const bool reads =
        OpenReader(participant, "run/1", etude_wire_PublishedChunk_desc, kPublishedChunkTopic, kPublishedReader)
            .has_value();
    EXPECT_EQ(reads, role == Role::kPolicy || role == Role::kSubscriber || role == Role::kRelay) << ToString(role);
    // as a subscriber does: one reader for what the run publishes and what is passed on
    const bool reads_both = OpenReaderIn(participant, {"run/1", "run/1/relay"}, etude_wire_PublishedChunk_desc,
                                         kPublishedChunkTopic, kPublishedReader)
                                .has_value();
    EXPECT_EQ(reads_both, reads) << ToString(role);
  }
}

TEST_F(SecurityTest, ACampaignsWorkerStaysInIt) {
  const auto participant = Join(150, Identity(*ours_, "of-q", {Role::kWorker}, {"q"}));
  EXPECT_TRUE(Writer<WorkRequest>::Open(participant, "q/1"));
  EXPECT_TRUE(Writer<WorkRequest>::Open(participant, "eval-0123/1"));
  for (const char* other : {"q2/1", "r/1", "directory"}) {
    const auto writer = Writer<WorkRequest>::Open(participant, other);
    ASSERT_FALSE(writer) << other;
    EXPECT_THAT(writer.error().message, HasSubstr("Not Allowed By Security"));
  }
}

TEST_F(SecurityTest, EveryTopicHasItsRule) {
  for (const auto& topic : KnownTopics()) EXPECT_TRUE(IsKnownTopic(topic)) << topic;
  for (const auto& [topic, access] : TopicAccesses()) {
    EXPECT_NE(access.publish, 0u) << topic;
    const bool relayed = access.scope == Scope::kRelay;
    EXPECT_TRUE(relayed || access.subscribe != 0u) << topic;
  }
}

template <class Message>
void ExpectTheGatewayReads() {
  EXPECT_NE(Traits<Message>::kAccess.subscribe & MaskOf(Role::kGateway), 0u) << Traits<Message>::kTopic;
}

// One reader that is refused keeps a campaign or a run off the pages altogether.
TEST(GatewayAccess, HasEveryTopicThatThePagesShow) {
  ExpectTheGatewayReads<Presence>();
  ExpectTheGatewayReads<CampaignStatus>();
  ExpectTheGatewayReads<CampaignAnnouncement>();
  ExpectTheGatewayReads<WorkerStatus>();
  ExpectTheGatewayReads<AttemptReport>();
  ExpectTheGatewayReads<WorkRequest>();
  ExpectTheGatewayReads<TrainStatus>();
  ExpectTheGatewayReads<PolicyStatus>();
  ExpectTheGatewayReads<ProcessStatus>();
  ExpectTheGatewayReads<ProcessEvent>();
  ExpectTheGatewayReads<PlayState>();
  ExpectTheGatewayReads<PlayFrame>();
  ExpectTheGatewayReads<Action>();
  ExpectTheGatewayReads<Insight>();
}

// A collector, and a worker of its authority that it hears.
struct Heard {
  Participant hub, good;
  Reader<WorkRequest> requests;
  Writer<WorkRequest> writer;
};

Heard OpenHeard(Participant hub, Participant good) {
  auto requests = Reader<WorkRequest>::Open(hub, "q/1");
  auto writer = Writer<WorkRequest>::Open(good, "q/1");
  EXPECT_TRUE(requests && writer && writer->WaitForReaders(1, 10s));
  return {std::move(hub), std::move(good), std::move(*requests), std::move(*writer)};
}

// What becomes of others who make requests.
TEST_F(SecurityTest, OnlyThoseOfTheAuthorityAreHeard) {
  const auto foreign = Join(151, Identity(*theirs_, "foreign", {Role::kWorker}));
  const auto stranger = Join(152, "");
  auto foreign_writer = Writer<WorkRequest>::Open(foreign, "q/1");
  auto stranger_writer = Writer<WorkRequest>::Open(stranger, "q/1");
  ASSERT_TRUE(foreign_writer && stranger_writer);
  auto own = OpenHeard(Join(150, Identity(*ours_, "hub", {Role::kCollector})),
                       Join(153, Identity(*ours_, "good", {Role::kWorker})));

  WorkRequest request;
  request.worker = "foreign";
  (void)foreign_writer->Write(request);
  request.worker = "stranger";
  (void)stranger_writer->Write(request);
  request.worker = "good";
  ASSERT_TRUE(own.writer.Write(request));
  ASSERT_TRUE(own.requests.Wait(5s));
  EXPECT_FALSE(foreign_writer->WaitForReaders(1, 1500ms));
  EXPECT_EQ(stranger_writer->matched_readers(), 0);
  const auto heard = own.requests.Take();
  ASSERT_EQ(heard.size(), 1u);
  EXPECT_EQ(heard[0].worker, "good");
  EXPECT_FALSE(own.hub.AllAdmitted()) << "strangers are seen, and never admitted";
}

TEST_F(SecurityTest, TheRevokedAreNotHeard) {
  const std::string identity = Identity(*ours_, "revoked", {Role::kWorker});
  const auto revoked = Join(151, identity);  // is there already
  ASSERT_TRUE(security::Revoke(ours_->path(), "revoked"));
  auto writer = Writer<WorkRequest>::Open(revoked, "q/1");
  ASSERT_TRUE(writer);
  const auto own = OpenHeard(Join(150, Identity(*ours_, "hub-2", {Role::kCollector})),
                             Join(153, Identity(*ours_, "good-2", {Role::kWorker})));
  EXPECT_FALSE(writer->WaitForReaders(1, 1500ms));
}

TEST_F(SecurityTest, AnotherDomainIsRefusedAtTheStart) {
  const std::string identity = Identity(*ours_, "elsewhere", {Role::kWorker}, {}, {7});
  const auto participant = Participant::Open({154, "", identity});
  ASSERT_FALSE(participant);
  EXPECT_THAT(participant.error().message, HasSubstr("--domain"));
}

std::string WithLargeFragments() {
  std::string profile = Profile();
  profile.replace(profile.find("65000B"), 6, "65200B");
  return profile;
}

// In the place before </Domain>.
std::string With(const std::string& elements) {
  std::string profile = Profile();
  return profile.insert(profile.find("</Domain>"), elements);
}

constexpr char kSharedMemoryOn[] = "<SharedMemory><Enable>true</Enable></SharedMemory>";

TEST_F(SecurityTest, ProfilesThatFailInSilenceAreRefused) {
  const std::string identity = Identity(*ours_, "profiles", {Role::kWorker});
  const auto fragments = Participant::Open({155, WithLargeFragments(), identity});
  ASSERT_FALSE(fragments);
  EXPECT_THAT(fragments.error().message, HasSubstr("FragmentSize is 65200"));
  const auto memory = Participant::Open({155, With(kSharedMemoryOn), identity});
  ASSERT_FALSE(memory);
  EXPECT_THAT(memory.error().message, HasSubstr("SharedMemory"));
}

TEST_F(SecurityTest, ProfilesOfTheEnvironmentAreLookedIntoToo) {
  const std::string identity = Identity(*ours_, "environment", {Role::kWorker});
  const Path file = ours_->path() / "profile.xml";
  const auto refusal = [&](const std::string& text, const std::string& uri) {
    EXPECT_TRUE(WriteFileAtomically(file, std::string_view(text)));
    ::setenv("CYCLONEDDS_URI", uri.c_str(), 1);
    const auto participant = Participant::Open({156, "", identity});
    ::unsetenv("CYCLONEDDS_URI");
    return participant ? std::string() : participant.error().message;
  };
  for (const std::string& uri : {"file://" + file.string(), file.string()}) {
    EXPECT_THAT(refusal(WithLargeFragments(), uri), HasSubstr("FragmentSize is 65200")) << uri;
    EXPECT_THAT(refusal(With(kSharedMemoryOn), uri), HasSubstr("SharedMemory")) << uri;
    EXPECT_EQ(refusal(Profile(), uri), "") << uri;
  }
  EXPECT_THAT(refusal(Profile(), file.string() + "," + file.string()), HasSubstr("one file"));
  EXPECT_THAT(refusal(Profile(), "file:///none.xml"), HasSubstr("/none.xml"));
}

TEST(SecuredProfile, IsCheckedElementByElement) {
  const auto refused = [](const std::string& text) { return !CheckSecuredProfile("<Domain>" + text + "</Domain>"); };
  EXPECT_TRUE(refused("<sharedmemory >\n<Enable> TRUE </Enable></sharedmemory>"));
  EXPECT_TRUE(refused("<Shm><Enable>false</Enable></Shm><Shm><Enable>true</Enable></Shm>"));
  EXPECT_FALSE(refused("<SharedMemory><Enable>false</Enable></SharedMemory><TCP><Enable>true</Enable></TCP>"));
  EXPECT_FALSE(refused("<SharedMemory/><TCP><Enable>true</Enable></TCP>"));
  EXPECT_FALSE(refused("<!-- <SharedMemory><Enable>true</Enable></SharedMemory> -->"));
  EXPECT_TRUE(refused("<FragmentSize>1400B</FragmentSize><FragmentSize> 64 KiB </FragmentSize>"));
  EXPECT_FALSE(refused("<FragmentSize>64000</FragmentSize>"));
  EXPECT_FALSE(refused("<Description>" + std::string(1 << 19, ' ') + "</Description>")) << "of any length";
}

// ---- what the library says, in words ---------------------------------------------------------------

TEST(SecurityLog, SaysEachPeerAndReasonOnce) {
  const auto line = TranslateSecurity(
      "Begin handshake reply failed: Certificate not valid: error: unable to get local issuer certificate; subject: "
      "/O=Etude/OU=worker/CN=rack-7(code: 200)");
  ASSERT_TRUE(line);
  EXPECT_EQ(line->peer, "rack-7");
  EXPECT_EQ(line->reason, "unknown authority");
  EXPECT_EQ(
      TranslateSecurity("Begin handshake reply failed: Certificate not valid: error: certificate signature failure; "
                        "subject: /O=Etude/OU=worker/CN=rack-8(code: 200)")
          ->reason,
      "unknown authority");
  SecurityLines lines;
  EXPECT_TRUE(lines.Take(*line));
  EXPECT_FALSE(lines.Take(*line));
  EXPECT_TRUE(
      lines.Take(*TranslateSecurity("Process handshake failed: certificate revoked; subject: /CN=rack-7(code)")));
}

TEST(SecurityLog, FalseAlarmsAreSilentAndOtherLinesAreNone) {
  const auto harmless = TranslateSecurity("Remote secure participant 1100a0b:c0d0:e0f0:1c1 not allowed");
  ASSERT_TRUE(harmless);
  EXPECT_FALSE(SecurityLines().Take(*harmless));
  EXPECT_FALSE(TranslateSecurity("failed to increase socket receive buffer size"));
}

TEST(PeerJudge, FindsWhoWasLostOnThisSideOnly) {
  PeerJudge judge;
  EXPECT_TRUE(judge.Look({{"a"}, {"a"}}, 0).lost.empty());
  EXPECT_TRUE(judge.Look({{}, {}}, 10).lost.empty());
  EXPECT_TRUE(judge.Look({{"a"}, {}}, 20).lost.empty()) << "a handshake may be under way";
  EXPECT_EQ(judge.Look({{"a"}, {}}, 51).lost, std::vector<std::string>{"a"});
  EXPECT_TRUE(judge.Look({{"a"}, {}}, 52).lost.empty()) << "said once";
}

TEST(PeerJudge, KnowsWhenNobodyAdmitsIt) {
  PeerJudge judge;
  EXPECT_FALSE(judge.Look({{"a"}, {}}, 0).alone);
  EXPECT_TRUE(judge.Look({{"a"}, {}}, 31).alone);
  PeerJudge admitted;
  (void)admitted.Look({{"hub"}, {"hub"}}, 0);
  (void)admitted.Look({{"hub", "stranger"}, {"hub"}}, 1);
  EXPECT_FALSE(admitted.Look({{"hub", "stranger"}, {"hub"}}, 60).alone);
}

}  // namespace security_test
}  // namespace etude::bus
