// SPDX-License-Identifier: Apache-2.0
// What comes from those who do not belong, or do not know how: malformed samples and packets, episodes that are none,
// other authorities, other versions. Nothing of it gets into the dataset, and nobody dies of it.
#include <arpa/inet.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/socket.h>

#include <algorithm>
#include <limits>

#include "services/bus/typed.h"
#include "services/core/clock.h"
#include "services/core/command.h"
#include "services/core/descriptor.h"
#include "services/core/rng.h"
#include "tests/faults/two_hosts.h"
#include "tests/services/campaign/fake_work.h"
#include "tests/services/campaign/running_collector.h"
#include "tests/support/authority.h"
#include "tests/support/wait_until.h"

namespace etude::faults {
namespace stranger_faults_test {

using namespace std::chrono_literals;
using Bytes = std::vector<std::uint8_t>;

constexpr std::uint32_t kDomain = 63;

bus::Participant Join(std::uint32_t domain) {
  auto participant = bus::Participant::Open({domain, ""});
  EXPECT_TRUE(participant) << participant.error().message;
  return std::move(*participant);
}

std::string IdOf(const CampaignRun& run) {
  const auto identity = ReadIdentity(run.dataset());
  EXPECT_TRUE(identity) << identity.error().message;
  return identity ? identity->id : "";
}

// ---- malformed ----------------------------------------------------------------------------------------

void Put(Bytes& bytes, std::uint64_t value, int size) {
  for (int i = 0; i < size; ++i) bytes.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
}

// A datagram that begins like one of RTPS and goes on with submessages of any kind, length and content.
Bytes BrokenPacket(Rng& rng) {
  constexpr std::uint8_t kKinds[] = {0x01, 0x06, 0x07, 0x08, 0x09, 0x0c, 0x0d,
                                     0x0e, 0x0f, 0x12, 0x13, 0x15, 0x16, 0x80};
  constexpr std::uint32_t kEntities[] = {0x000100c2, 0x000003c2, 0x000004c2, 0x000200c2, 0x00000107};
  constexpr std::uint32_t kBoundaries[] = {0, 1, 0x7fffffff, 0x80000000, 0xffffffff};
  Bytes packet{'R', 'T', 'P', 'S', 2, 1, 1, 16};
  for (int i = 0; i < 12; ++i) Put(packet, rng.Below(256), 1);
  for (std::uint64_t count = 1 + rng.Below(4); count > 0; --count) {
    Put(packet, kKinds[rng.Below(std::size(kKinds))], 1);
    Put(packet, rng.Below(16), 1);
    const std::uint64_t length = 4 * rng.Below(40);
    Put(packet, rng.Below(3) == 0 ? rng.Below(65536) : length, 2);
    for (std::uint64_t word = 0; word < length / 4; ++word) {
      const std::uint64_t kind = rng.Below(4);
      Put(packet,
          kind == 0   ? kEntities[rng.Below(std::size(kEntities))]
          : kind == 1 ? kBoundaries[rng.Below(std::size(kBoundaries))]
                      : rng.Next(),
          4);
    }
  }
  if (rng.Below(4) == 0) packet.resize(rng.Below(packet.size()));
  return packet;
}

// To every port that a process of the domain may listen at on this host (DDSI-RTPS 9.6.1.1).
void SendBrokenPackets(std::uint32_t domain, int packets, Rng& rng) {
  constexpr std::uint32_t kProcesses = 8;
  const Descriptor socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  for (int k = 0; k < packets; ++k) {
    const Bytes packet = BrokenPacket(rng);
    const std::uint64_t port = 7400 + 250 * domain + 10 + rng.Below(2 * kProcesses);
    to.sin_port = htons(static_cast<std::uint16_t>(port));
    (void)::sendto(socket.get(), packet.data(), packet.size(), 0, reinterpret_cast<const sockaddr*>(&to), sizeof to);
  }
}

// One sample that our own writer would not write: `spoil` is given the C struct. It borrows the message's memory.
template <class Message, class Spoil>
void WriteSpoiled(const bus::Participant& participant, const std::string& partition, const Message& message,
                  const Spoil& spoil) {
  const auto raw = bus::OpenWriterOf<Message>(participant, partition);
  ASSERT_TRUE(raw) << raw.error().message;
  ASSERT_TRUE(WaitUntil([&] { return bus::MatchedReaders(*raw) > 0; }, 20s)) << bus::Traits<Message>::kTopic;
  auto wire = bus::Encode(message);
  ASSERT_TRUE(wire) << wire.error().message;
  spoil(*wire);
  EXPECT_EQ(dds_write(raw->get(), &*wire), DDS_RETCODE_OK);
}

constexpr char kTold[] = "told";  // where one of the workers reads its leases

// Of a campaign's own topics, as the collector and its workers read them.
void WriteMalformed(const bus::Participant& participant, const CampaignRun& run, const std::string& id) {
  const std::string partition = bus::Owner{run.spec().name, id}.partition();
  std::string endless(bus::kMaxText + 1, 'x');
  bus::AttemptReport report{.campaign = run.spec().name, .worker = "stranger", .campaign_id = id};
  WriteSpoiled(participant, partition, report, [&](auto& wire) { wire.details_json = endless.data(); });
  bus::CampaignControl control{.campaign = run.spec().name, .control_id = "x", .campaign_id = id};
  WriteSpoiled(participant, partition, control, [](auto& wire) { wire.action = 200; });
  bus::Lease lease{.campaign = run.spec().name, .worker = "stranger", .campaign_id = id};
  WriteSpoiled(participant, bus::PartitionOfAddress(partition, kTold), lease, [](auto& wire) { wire.kind = 200; });
  bus::BlobManifest manifest{.channel = "episode", .sender = "stranger", .owner = id};
  manifest.host = participant.address();
  manifest.size = 10;
  manifest.chunk_size = 4;
  manifest.chunk_count = 3;
  manifest.sha256.assign(32, 1);
  WriteSpoiled(participant, partition + "/episode", manifest, [](auto& wire) { wire.size = ~0ull; });
}

// Well formed, and nonsense: names that are paths, numbers that are none, JSON without an end.
void WriteNonsense(const bus::Participant& participant, const CampaignRun& run, const std::string& id) {
  const std::string partition = bus::Owner{run.spec().name, id}.partition();
  const auto nothing = [](const auto&) {};
  bus::WorkRequest request{.campaign = run.spec().name, .worker = "../../etc/passwd", .campaign_id = id};
  request.files_sha256 = "../../etc/passwd";
  request.host = "../../*";
  request.spec_sha256 = SpecHash(run.spec());
  request.content = kContentVersion;
  WriteSpoiled(participant, partition, request, nothing);
  bus::AttemptReport report{.campaign = run.spec().name, .worker = "stranger", .campaign_id = id};
  report.index = ~0ull;
  report.outcome = "../../etc/passwd";
  report.details_json = std::string(10'000, '[');
  report.spec_sha256 = request.spec_sha256;
  WriteSpoiled(participant, partition, report, nothing);
  bus::WorkerStatus status{.campaign = run.spec().name, .worker = "stranger", .phase = "play", .campaign_id = id};
  status.steps_per_second = std::numeric_limits<double>::quiet_NaN();
  status.plan_s = -std::numeric_limits<double>::infinity();
  WriteSpoiled(participant, partition, status, nothing);
}

// What a worker that holds a lease might send in the place of its episode.
std::vector<Bytes> Unfit(const CampaignSpec& spec, const bus::Lease& lease, Rng& rng) {
  const auto episode = [&] { return campaign::FakeEpisode(spec, lease.index, lease.attempt); };
  const Bytes whole = EncodeEpisode(episode());
  Bytes random(2000);
  for (auto& byte : random) byte = static_cast<std::uint8_t>(rng.Below(256));
  Episode no_number = episode();
  no_number.joint_pos.values.back() = std::numeric_limits<float>::quiet_NaN();
  Episode named_otherwise = episode();
  named_otherwise.campaign = "../other";
  Episode of_another = campaign::FakeEpisode(spec, (lease.index + 1) % spec.episodes, lease.attempt);
  return {random, Bytes(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(whole.size() / 2)),
          EncodeEpisode(no_number), EncodeEpisode(named_otherwise), EncodeEpisode(of_another)};
}

// Each by a worker of its own: one whose episodes do not fit is sent away. Returns how many were not taken.
int SendUnfit(const bus::Participant& participant, const CampaignRun& run, const std::string& id, Rng& rng) {
  int not_taken = 0;
  constexpr std::size_t kKinds = 5;
  for (std::size_t kind = 0; kind < kKinds; ++kind) {
    const std::string name = fmt::format("unfit-{}", kind);
    campaign::RawWorker worker(participant, run.spec(), id, name);
    const bus::Lease lease = worker.Ask();
    EXPECT_EQ(lease.kind, bus::LeaseKind::kWork) << lease.reason;
    const Bytes bytes = Unfit(run.spec(), lease, rng).at(kind);
    auto sender = bus::BlobSender::Open(participant, {run.spec().name, id}, "episode", name);
    EXPECT_TRUE(sender) << sender.error().message;
    const auto verdict = sender->Send(lease.token, bytes, lease.token, "{", 20s);
    EXPECT_TRUE(verdict) << kind << ": " << verdict.error().message;
    if (!verdict) continue;
    EXPECT_NE(verdict->kind, bus::AckKind::kDone) << kind;
    not_taken += verdict->kind != bus::AckKind::kDone;
  }
  return not_taken;
}

TEST(Faults, F19MalformedAndForeignBytesAreRefused) {
  CampaignRun run({.name = "f19", .domain = kDomain, .episodes = 80, .ms_per_attempt = 600});
  run.StartCollector();
  run.StartWorker();
  run.StartWorker({{"FAKE_ADDRESS", kTold}});
  run.WaitForCommitted(4);
  const std::string id = IdOf(run);
  const double before_mb = ResidentMb(run.collector().pid());
  Rng rng(19);
  constexpr int kPackets = 3000;
  SendBrokenPackets(kDomain, kPackets, rng);
  const auto participant = Join(kDomain);
  WriteMalformed(participant, run, id);
  WriteNonsense(participant, run, id);
  const int refused = SendUnfit(participant, run, id, rng);
  EXPECT_TRUE(run.collector().running()) << run.Logs();
  for (std::size_t i = 0; i < run.workers(); ++i) EXPECT_TRUE(run.worker(i).running()) << i << run.Logs();
  const double grown_mb = ResidentMb(run.collector().pid()) - before_mb;
  EXPECT_LT(grown_mb, 64);
  for (int i = 0; i < 6; ++i) run.StartWorker();  // it may end now
  const Counts counts = run.Finish();
  for (const char* topic : {"etude/campaign/report", "etude/campaign/control", "etude/campaign/lease"})
    EXPECT_NE(run.Logs().find(fmt::format("malformed samples were dropped topic={} count=1", topic)), std::string::npos)
        << topic << run.Logs();
  ReportRow("F19",
            fmt::format("{} broken RTPS packets, 7 malformed or nonsensical samples, {} episodes that do not fit, all "
                        "refused; nobody died",
                        kPackets, refused),
            counts);
}

// ---- authorities --------------------------------------------------------------------------------------

TEST(Faults, F20NobodyIsHeardWhoDoesNotBelong) {
  const Authority ours, theirs;
  const Path revoked = ours.Revoked("revoked");
  CampaignRun run({.name = "f20",
                   .domain = 64,
                   .episodes = 24,
                   .lease_s = "3",
                   .ms_per_attempt = 20,
                   .collector_flags = ours.CollectorFlags()});
  run.StartCollector();
  // those who wait for ever, as far as they can tell nobody is there
  for (const auto& identity : {theirs.Worker("foreign"), Path(), revoked}) run.StartWorker(WorkerOf(identity));
  const std::size_t outside = run.workers();
  // those who are told at once
  auto& expired = run.StartWorker(WorkerOf(ours.Issue("expired", security::Role::kWorker, -30)));
  EXPECT_NE(expired.Wait(20s).value_or(kExitOk), kExitOk) << run.Logs();
  auto& other_role = run.StartWorker(WorkerOf(ours.Issue("looker", security::Role::kSubscriber)));
  EXPECT_NE(other_role.Wait(30s).value_or(kExitOk), kExitOk) << run.Logs();
  EXPECT_EQ(run.Committed(), 0u);
  for (const char* name : {"good-1", "good-2"}) run.StartWorker(WorkerOf(ours.Worker(name)));
  ASSERT_TRUE(WaitUntil([&] { return !run.collector().running(); })) << run.Logs();
  for (std::size_t i = 0; i < outside; ++i) run.worker(i).Signal(SIGKILL);
  const Counts counts = run.Finish();
  for (std::size_t i = 0; i < outside + 2; ++i)
    EXPECT_EQ(ReadTextFile(run.folder() / fmt::format("acks-{}", i)).value_or(""), "") << i;
  for (const char* words : {"unknown authority", "revoked", "it expired on", "Not Allowed By Security"})
    EXPECT_NE(run.Logs().find(words), std::string::npos) << words << run.Logs();
  ReportRow("F20", "workers of a foreign authority, without one, revoked, expired, of another role: nothing either way",
            counts);
}

// Peers that knock for longer than the handshake's timeout (100 s) can close a participant of Cyclone DDS for good;
// ours leave before, and are started again here. ETUDE_FOREIGN_S: for how long.
TEST(Faults, F20ForeignAuthoritiesDoNotCloseTheDoor) {
  const int seconds = SecondsOf("ETUDE_FOREIGN_S", 5);
  const Authority ours, theirs;
  CampaignRun run(
      {.name = "f20b", .domain = 64, .episodes = 12, .lease_s = "3", .collector_flags = ours.CollectorFlags()});
  run.StartCollector();
  std::vector<Environment> foreign;
  for (int i = 0; i < 3; ++i) foreign.push_back(WorkerOf(theirs.Worker(fmt::format("foreign-{}", i))));
  for (const auto& environment : foreign) run.StartWorker(environment);
  const Stopwatch knocking;
  int starts = 3;
  while (knocking.Seconds() < seconds) {
    Last(100ms);
    for (std::size_t i = 0; i < foreign.size(); ++i) {
      if (run.worker(i).running()) continue;
      run.ReplaceWorker(i, foreign[i]);
      ++starts;
    }
  }
  if (seconds >= 60) {
    EXPECT_GE(starts, 6) << "each leaves within half a minute: " << run.Logs();
  }
  const Stopwatch admission;
  run.StartWorker(WorkerOf(ours.Worker("good")));
  run.WaitForCommitted(1);
  const double admitted = admission.Seconds();
  for (std::size_t i = 0; i < foreign.size(); ++i) run.worker(i).Signal(SIGKILL);
  ReportRow(
      "F20",
      fmt::format("3 workers of a foreign authority knock for {} s ({} starts); one of ours commits {:.1f} s after "
                  "its start",
                  seconds, starts, admitted),
      run.Finish());
}

// ---- versions -----------------------------------------------------------------------------------------

// Of another wire or content number: refused by name. Of the same numbers and an older program: it joins.
TEST(Faults, F23ProgramsOfOtherVersionsAreRefusedOrUnderstood) {
  CampaignRun run({.name = "f23", .domain = kDomain, .episodes = 48, .ms_per_attempt = 300});
  run.StartCollector();
  run.StartWorker();
  run.WaitForCommitted(2);
  auto& other_content = run.StartWorker({}, "977");
  EXPECT_EQ(other_content.Wait(20s), kExitMachine) << run.Logs();
  const std::string id = IdOf(run);
  const auto participant = Join(kDomain);
  campaign::RawWorker old_wire(participant, run.spec(), id, "old-wire");
  old_wire.request.wire = bus::kWireVersion - 1;
  const bus::Lease refused = old_wire.Ask();
  EXPECT_EQ(refused.kind, bus::LeaseKind::kRefused);
  EXPECT_NE(refused.reason.find("wire number"), std::string::npos) << refused.reason;
  campaign::RawWorker older(participant, run.spec(), id, "older");
  older.request.version = "0.0.1";
  const bus::Lease lease = older.Ask();
  ASSERT_EQ(lease.kind, bus::LeaseKind::kWork) << lease.reason;
  const std::uint32_t attempt = campaign::FakeCommittedAttempt(lease.index);
  if (attempt == lease.attempt) {
    EXPECT_EQ(older.Send(lease, campaign::FakeEpisode(run.spec(), lease.index, attempt)).kind, bus::AckKind::kDone);
  }
  for (int i = 0; i < 3; ++i) run.StartWorker();  // it may end now
  const Counts counts = run.Finish();
  for (const char* words : {"977", "programs of the same content number"})
    EXPECT_NE(run.Logs().find(words), std::string::npos) << words << run.Logs();
  ReportRow("F23", "workers of another wire and of another content number, and of an older program of the same ones",
            counts);
}

// A rolling upgrade, half of it done: this build's collector with another build's workers, and the other way round.
// ETUDE_OTHER_BUILD: its build folder.
TEST(Faults, F23TwoBuildsShareACampaign) {
  const char* other = std::getenv("ETUDE_OTHER_BUILD");
  if (other == nullptr) GTEST_SKIP() << "F23 with two builds: ETUDE_OTHER_BUILD names the build folder of another one";
  const Path build = other;
  Counts sum;
  for (const bool collector_is_other : {true, false}) {
    RunOptions options{.name = "f23b", .domain = kDomain, .episodes = 24, .ms_per_attempt = 10};
    if (collector_is_other)
      options.collector_program = build / "bin" / "etude-collector";
    else
      options.worker_program = build / "tests" / "fake_worker";
    CampaignRun run(options);
    run.StartCollector();
    for (int i = 0; i < 2; ++i) run.StartWorker();
    sum += run.Finish();
  }
  ReportRow("F23", "collector of one build and workers of another, and the other way round", sum);
}

}  // namespace stranger_faults_test
}  // namespace etude::faults
