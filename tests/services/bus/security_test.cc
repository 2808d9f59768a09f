// SPDX-License-Identifier: Apache-2.0
// Who may what on a secured bus, with real participants: two DDS domains of this process that are one outside.
#include <fnmatch.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <iterator>
#include <set>
#include <string_view>

#include "services/bus/access.h"
#include "services/bus/addressed_writers.h"
#include "services/bus/owner.h"
#include "services/bus/profile.h"
#include "services/bus/topic.h"
#include "services/bus/topology.h"
#include "services/bus/typed.h"
#include "services/bus/wire.h"
#include "services/core/clock.h"
#include "services/core/stop.h"
#include "services/core/stop_reason.h"
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
                                                           .grants = GrantsFor(roles, name, campaigns, {}),
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

std::string PartitionIn(Scope scope, const std::string& host) {
  switch (scope) {
    case Scope::kCampaignHost:
    case Scope::kRunHost:
      return "q/1/" + host;
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

// Who writes and who reads each topic, written out: a slip in the table that the permissions are made from (wire.h) is
// none here. C collector, W worker, T trainer, P policy, S subscriber, R robot, G gateway, L relay; * everybody.
struct Row {
  const char* topic;
  const char* writers;
  const char* readers;
};
constexpr Row kRows[] = {{"etude/directory/presence", "CTPL", "*"},
                         {"etude/campaign/announcement", "C", "WGS"},
                         {"etude/campaign/request", "W", "CG"},
                         {"etude/campaign/lease", "C", "W"},
                         {"etude/campaign/worker", "W", "CG"},
                         {"etude/campaign/report", "W", "CG"},
                         {"etude/campaign/validation_errors", "T", "C"},
                         {"etude/campaign/status", "C", "WGS"},
                         {"etude/campaign/control", "G", "C"},
                         {"etude/blob/manifest", "W", "C"},
                         {"etude/blob/chunk", "W", "C"},
                         {"etude/blob/ack", "C", "W"},
                         {"etude/policy/observation", "RWG", "P"},
                         {"etude/policy/action", "P", "RWG"},
                         {"etude/policy/insight_wish", "G", "P"},
                         {"etude/policy/insight", "P", "G"},
                         {"etude/policy/status", "P", "RGS"},
                         {"etude/play/command", "G", "W"},
                         {"etude/play/state", "W", "G"},
                         {"etude/play/frame", "W", "G"},
                         {"etude/process/status", "*", "G"},
                         {"etude/process/event", "*", "G"},
                         {"etude/train/status", "T", "GS"}};

char LetterOf(Role role) {
  switch (role) {
    case Role::kCollector:
      return 'C';
    case Role::kWorker:
      return 'W';
    case Role::kTrainer:
      return 'T';
    case Role::kPolicy:
      return 'P';
    case Role::kSubscriber:
      return 'S';
    case Role::kRobot:
      return 'R';
    case Role::kGateway:
      return 'G';
    case Role::kRelay:
      return 'L';
  }
  return '?';
}

bool Includes(std::string_view letters, Role role) {
  return letters == "*" || letters.find(LetterOf(role)) != std::string_view::npos;
}

const Row* RowOf(std::string_view topic) {
  const auto* const found = std::ranges::find(kRows, topic, [](const Row& row) { return std::string_view(row.topic); });
  return found == std::end(kRows) ? nullptr : found;
}

template <class Message>
void ExpectAccess(const Participant& participant, Role role) {
  using T = Traits<Message>;
  const Row* const row = RowOf(T::kTopic);
  ASSERT_NE(row, nullptr) << T::kTopic << " is in no row of this test: who may write and read it?";
  const Scope scope = T::kAccess.scope;
  const std::string partition = PartitionIn(scope, participant.address());
  const bool may_write = Includes(row->writers, role), may_read = Includes(row->readers, role);
  EXPECT_EQ(OpenWriterOf<Message>(participant, partition).has_value(), may_write) << ToString(role) << T::kTopic;
  EXPECT_EQ(OpenReaderOf<Message>(participant, partition).has_value(), may_read) << ToString(role) << T::kTopic;
  if (scope != Scope::kCampaignHost && scope != Scope::kRunHost) return;
  // what is meant for the neighbour, and who asks for everybody's
  const bool may_read_all = may_read && (MaskOf(role) & kOfOneHost) == 0;
  for (const char* other : {"q/1/neighbour", "q/1"})
    EXPECT_EQ(OpenReaderOf<Message>(participant, other).has_value(), may_read_all)
        << ToString(role) << T::kTopic << other;
  EXPECT_EQ(OpenWriterOf<Message>(participant, "q/1/neighbour").has_value(), may_write) << ToString(role) << T::kTopic;
}

TEST_F(SecurityTest, EveryRoleMayWhatTheTableSaysAndNothingElse) {
  for (const Role role : security::kRoles) {
    const auto participant = Join(150, Identity(*ours_, "role-" + ToString(role), {role}));
#define ETUDE_EXPECT_ACCESS(Name) ExpectAccess<Name>(participant, role);
    ETUDE_MESSAGES(ETUDE_EXPECT_ACCESS)
#undef ETUDE_EXPECT_ACCESS
  }
}

TEST(AccessTable, HasARowForEachTopicAndNoOther) {
  std::set<std::string> topics, rows;
#define ETUDE_TOPIC_OF(Name) topics.insert(Traits<Name>::kTopic);
  ETUDE_MESSAGES(ETUDE_TOPIC_OF)
#undef ETUDE_TOPIC_OF
  for (const Row& row : kRows) EXPECT_TRUE(rows.insert(row.topic).second) << row.topic;
  EXPECT_EQ(rows, topics);
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

TEST_F(SecurityTest, AWorkerReadsWhatIsMeantForItsHostAndNoOther) {
  const auto participant = Join(150, Identity(*ours_, "rack-1", {Role::kWorker}, {"q"}));
  EXPECT_EQ(participant.address(), "rack-1");
  EXPECT_TRUE(Reader<Lease>::Open(participant, "q/1/rack-1"));
  EXPECT_TRUE(Reader<Lease>::Open(participant, "eval-0123/1/rack-1"));
  EXPECT_TRUE(Reader<BlobAck>::Open(participant, "q/1/episode/rack-1"));
  EXPECT_TRUE(Reader<Action>::Open(participant, "run/1/rack-1"));
  for (const char* other : {"q/1/rack-2", "q/1/rack-10", "q/1", "r/1/rack-1"}) {
    const auto reader = Reader<Lease>::Open(participant, other);
    ASSERT_FALSE(reader) << other;
    EXPECT_THAT(reader.error().message, HasSubstr("Not Allowed By Security"));
  }
  EXPECT_FALSE(Reader<BlobAck>::Open(participant, "q/1/episode/rack-2"));
  EXPECT_FALSE(Reader<BlobAck>::Open(participant, "q/1/episode"));
  EXPECT_FALSE(Reader<Action>::Open(participant, "run/1/rack-2"));
}

// With real peers: each host is told what is meant for it, its first message too, and what is not is not sent to it.
TEST_F(SecurityTest, LeasesComeToTheirHostAlone) {
  const auto hub = Join(150, Identity(*ours_, "hub-of-racks", {Role::kCollector}));
  const auto one = Join(151, Identity(*ours_, "rack-one", {Role::kWorker}));
  const auto two = Join(153, Identity(*ours_, "rack-two", {Role::kWorker}));
  auto of_one = Reader<Lease>::Open(one, PartitionOfAddress("q/1", one.address()));
  auto of_two = Reader<Lease>::Open(two, PartitionOfAddress("q/1", two.address()));
  ASSERT_TRUE(of_one && of_two);
  AddressedWriters<Lease> leases(hub, "q/1", {.wait = 20s});
  Lease lease;
  lease.worker = "worker-one";
  ASSERT_TRUE(leases.Write(one.address(), lease));
  lease.worker = "worker-two";
  ASSERT_TRUE(leases.Write(two.address(), lease));
  const auto take = [&](Reader<Lease>& reader) {
    std::vector<std::string> workers;
    for (const Stopwatch watch; workers.empty() && watch.Seconds() < 20;) {
      leases.Tidy();
      reader.Wait(20ms);
      for (const auto& taken : reader.Take()) workers.push_back(taken.worker);
    }
    return workers;
  };
  EXPECT_EQ(take(*of_one), std::vector<std::string>{"worker-one"});
  EXPECT_EQ(take(*of_two), std::vector<std::string>{"worker-two"});
  EXPECT_EQ(of_one->matched_writers(), 1);
  EXPECT_EQ(of_two->matched_writers(), 1);
}

TEST_F(SecurityTest, EveryTopicHasItsRule) {
  for (const auto& topic : KnownTopics()) EXPECT_TRUE(IsKnownTopic(topic)) << topic;
  for (const auto& [topic, access] : TopicAccesses()) {
    EXPECT_NE(access.publish, 0u) << topic;
    const bool relayed = access.scope == Scope::kRelay;
    EXPECT_TRUE(relayed || access.subscribe != 0u) << topic;
  }
}

// before, no identity of named runs could play with a checkpoint: it is served as a run of its own
TEST(GrantsOfNamedRuns, IncludeThoseOfEvaluationsAndOfPlay) {
  const auto grants = GrantsFor({Role::kWorker}, "w", {}, {"demo"});
  const auto granted = [&](bool publish, std::string_view topic, const char* partition) {
    return std::ranges::any_of(grants, [&](const security::Grant& one) {
      return one.publish == publish && one.topic == topic && ::fnmatch(one.partition.c_str(), partition, 0) == 0;
    });
  };
  for (const char* run : {"demo/1", "eval-0123/1", "play-1a2b3c/1"}) {
    EXPECT_TRUE(granted(true, Traits<Observation>::kTopic, run)) << run;
    EXPECT_TRUE(granted(false, Traits<Action>::kTopic, (std::string(run) + "/w").c_str())) << run;
    EXPECT_FALSE(granted(false, Traits<Action>::kTopic, (std::string(run) + "/other").c_str())) << run;
  }
  EXPECT_FALSE(granted(true, Traits<Observation>::kTopic, "other/1"));
  EXPECT_FALSE(granted(false, Traits<Action>::kTopic, "other/1/w"));
  EXPECT_FALSE(granted(true, Traits<Observation>::kTopic, "player/1"));
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

// The identity runs out while the process is at work.
TEST(DatesDeathTest, AProcessEndsWhenItsIdentityRunsOutMeanwhile) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(
      {
        TemporaryFolder authority;
        (void)security::InitAuthority(authority.path(), security::Protection::kEncrypt);
        const auto issued = security::Issue(authority.path(), {.name = "short",
                                                               .roles = {Role::kWorker},
                                                               .grants = GrantsFor({Role::kWorker}, "short", {}, {}),
                                                               .not_before = Now() - 1,
                                                               .not_after = Now() + 12});
        auto participant = Participant::Open({157, Profile(), issued.value_or(Path()).string()});
        const bool opened = participant.has_value();
        const Stopwatch watch;
        const bool stopped = WaitForStop(30s);
        const auto reason = ReasonOfStop();
        std::fputs(reason ? reason->message.c_str() : "nothing said", stderr);
        ::_exit(opened && stopped && watch.Seconds() < 25 ? 0 : 1);
      },
      ::testing::ExitedWithCode(0), "identity 'short' expires on");
}

}  // namespace security_test
}  // namespace etude::bus
