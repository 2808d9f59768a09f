// SPDX-License-Identifier: Apache-2.0
// Trainers that die, and checkpoints that are broken, forged or old on their way to a policy server. The programs are
// etude-trainer and etude-policy; who publishes is this test.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <functional>
#include <map>

#include "services/bus/assembly.h"
#include "services/bus/blob_transfer.h"
#include "services/bus/topic.h"
#include "services/bus/typed.h"
#include "services/core/clock.h"
#include "services/core/hash.h"
#include "services/security/checkpoint_signature.h"
#include "tests/faults/campaign_run.h"
#include "tests/faults/trainer_run.h"
#include "tests/support/etude_command.h"
#include "tests/support/small_disk.h"
#include "tests/support/wait_until.h"
#include "tests/trainer/data/synthetic_dataset.h"
#include "tests/trainer/learn/tiny_config.h"

namespace etude::faults {
namespace checkpoint_faults_test {

using namespace std::chrono_literals;
using Bytes = std::vector<std::uint8_t>;

constexpr std::uint32_t kDomain = 62;
constexpr int kKilled = 128 + SIGKILL;

// What is published, and who signs it.
const bus::Owner kOwner{"faults", "aaaa000000000001"};

// A run that nothing happens to, made once, and a key to publish its checkpoints with.
class CheckpointFaults : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    const CampaignSpec spec = SyntheticSpec(learn::kTinyPicture, learn::kTinyPicture);
    AddSyntheticEpisodes(*folder_ / "data", spec, 0, 24);
    auto trainer = StartTrainer("calm", false, {{"ETUDE_CRASH_LOG", (*folder_ / "points").string()}});
    ASSERT_EQ(trainer.Wait(120s), 0) << Logs("calm");
  }
  static void TearDownTestSuite() { delete folder_; }

  static campaign::Process StartTrainer(const std::string& run, bool resume, const Environment& environment = {}) {
    return faults::StartTrainer({.data = *folder_ / "data",
                                 .out = FolderOf(run),
                                 .log = *folder_ / (run + ".log"),
                                 .resume = resume,
                                 .environment = environment});
  }
  static Path FolderOf(const std::string& run) { return *folder_ / run; }
  static std::string Logs(const std::string& run) {
    return "\n" + ReadTextFile(*folder_ / (run + ".log")).value_or("");
  }
  static Path FileOf(const std::string& run, int step) {
    return FolderOf(run) / "checkpoints" / fmt::format("{:08}.safetensors", step);
  }
  static Bytes CheckpointOf(int step) {
    const auto bytes = ReadBinaryFile(FileOf("calm", step));
    EXPECT_TRUE(bytes) << bytes.error().message;
    return bytes.value_or(Bytes());
  }

  void SetUp() override {
    ASSERT_TRUE(security::MakeSigningKey(own_ / "key"));
    auto signer = security::CheckpointSigner::Open(own_ / "key");
    ASSERT_TRUE(signer) << signer.error().message;
    signer_.emplace(std::move(*signer));
  }
  // The signature of these bytes as this version of kOwner.
  std::string Signed(std::uint64_t version, const Bytes& bytes) const {
    const auto meta = signer_->Sign({kOwner.id, "latest", version, Sha256Hex(bytes)}, "{}");
    EXPECT_TRUE(meta) << meta.error().message;
    return meta.value_or("{}");
  }
  std::vector<std::string> VerifyFlags() const {
    return {"--verify", (own_ / "key.pub").string(), "--floor", (own_ / "floor.json").string()};
  }
  static bus::Participant Join() {
    auto participant = bus::Participant::Open({kDomain, ""});
    EXPECT_TRUE(participant) << participant.error().message;
    return std::move(*participant);
  }

  static TemporaryFolder* folder_;
  const TemporaryFolder own_;

 private:
  std::optional<security::CheckpointSigner> signer_;
};
TemporaryFolder* CheckpointFaults::folder_ = nullptr;

// ---- the trainer --------------------------------------------------------------------------------------

// How many durable files a calm run has written when its first checkpoint is there, that one included.
int FilesUpToFirstCheckpoint(const std::string& points) {
  const auto end = points.find("trainer.checkpoint_kept");
  EXPECT_NE(end, std::string::npos) << points;
  int files = 0;
  for (auto at = points.find("file.written"); at < end; at = points.find("file.written", at + 1)) ++files;
  return files;
}

TEST_F(CheckpointFaults, F4TrainersThatDieGoOnBitForBit) {
  const int first = FilesUpToFirstCheckpoint(ReadTextFile(FolderOf("points")).value_or(""));
  struct Life {
    std::string crash_at;
    int kept;  // step that the next one goes on from
  };
  // a run that is resumed writes neither its identity nor its name again: two files less
  const std::vector<Life> lives{
      {fmt::format("file.written:{}", first + 2), 10},  // in the middle of the second checkpoint
      {"trainer.checkpoint_kept:1", 10},                // it is there, the state is not
      {fmt::format("file.synced:{}", first - 1), 10},   // in the middle of the state
      {fmt::format("file.renamed:{}", first - 1), 20},  // just behind it
  };
  const Path run = FolderOf("killed");
  int killed = 0;
  const auto after_death = [&](const std::string& how) {
    ++killed;
    EXPECT_GE(StepOfState(run) + kInterval, LastValidation(run)) << how << ": more than an interval was lost";
    EXPECT_TRUE(IsWhole(run / "checkpoints" / "latest.safetensors")) << how;
  };
  for (const Life& life : lives) {
    auto trainer = StartTrainer("killed", killed > 0, {{"ETUDE_CRASH_AT", life.crash_at}});
    ASSERT_EQ(trainer.Wait(120s), kKilled) << life.crash_at << Logs("killed");
    after_death(life.crash_at);
    EXPECT_EQ(StepOfState(run), life.kept) << life.crash_at << Logs("killed");
  }
  auto trainer = StartTrainer("killed", true);
  ASSERT_TRUE(WaitUntil([&] { return LastValidation(run) >= 30; })) << Logs("killed");
  trainer.Signal(SIGKILL);  // somewhere in the steps behind it
  trainer.Wait(5s);
  after_death("mid-epoch");
  auto rest = StartTrainer("killed", true);
  ASSERT_EQ(rest.Wait(120s), 0) << Logs("killed");

  const auto calm = Validations(FolderOf("calm"));
  ASSERT_EQ(calm.size(), static_cast<std::size_t>(kSteps / kInterval));
  EXPECT_EQ(Validations(run), calm);
  const auto bytes = ReadBinaryFile(FileOf("killed", kSteps));
  ASSERT_TRUE(bytes) << bytes.error().message;
  EXPECT_TRUE(*bytes == CheckpointOf(kSteps)) << "the last checkpoints differ";
  ReportAsserted("F4",
                 fmt::format("trainer killed {} times, in and between its steps, checkpoint and state: an interval "
                             "of steps lost at most, losses and last checkpoint bit for bit those of a calm run",
                             killed));
}

// What a tmpfs takes for it.
std::uint64_t PagesOf(const Path& file) {
  constexpr std::uint64_t kPage = 4096;
  return (std::filesystem::file_size(file) + kPage - 1) / kPage * kPage;
}

// Everything of a run but its checkpoints and its state.
std::uint64_t PagesOfTheRest(const Path& run) {
  std::uint64_t sum = 0;
  for (const auto& item : std::filesystem::recursive_directory_iterator(run))
    if (item.is_regular_file() && !item.is_symlink() && item.path().extension() != ".safetensors")
      sum += PagesOf(item.path());
  return sum;
}

// Room for one checkpoint, the state and half of the next checkpoint.
TEST_F(CheckpointFaults, F10ATrainerWaitsForRoomAndLosesNothing) {
  const Path calm = FolderOf("calm"), run = FolderOf("full");
  const std::uint64_t checkpoint = PagesOf(FileOf("calm", kInterval)), rest = PagesOfTheRest(calm);
  const std::uint64_t state = PagesOf(calm / "training_state.safetensors");
  ASSERT_LT(rest, checkpoint / 2) << "the second checkpoint would fit";
  const SmallDisk disk(run, std::to_string(checkpoint + state + rest + checkpoint / 2));
  if (!disk.mounted()) GTEST_SKIP() << "F10 on a small tmpfs needs root";
  auto trainer = StartTrainer("full", false);
  const std::string words = "the disk does not take the checkpoint of step 20";
  ASSERT_TRUE(WaitUntil([&] { return Logs("full").find(words) != std::string::npos; })) << Logs("full");
  EXPECT_TRUE(trainer.running());
  EXPECT_EQ(StepOfState(run), kInterval);
  EXPECT_TRUE(IsWhole(run / "checkpoints" / "latest.safetensors")) << "what is there stays";

  ASSERT_TRUE(disk.Grow(std::to_string(16 * (checkpoint + state))));
  ASSERT_EQ(trainer.Wait(120s), 0) << Logs("full");
  EXPECT_NE(Logs("full").find("the disk took the checkpoint of step 20"), std::string::npos) << Logs("full");
  EXPECT_EQ(Validations(run), Validations(calm));
  const auto bytes = ReadBinaryFile(FileOf("full", kSteps));
  ASSERT_TRUE(bytes) << bytes.error().message;
  EXPECT_TRUE(*bytes == CheckpointOf(kSteps)) << "the last checkpoints differ";
  ReportAsserted(
      "F10",
      "no room for a trainer's second checkpoint: it waits with words, and goes on when there is; losses and "
      "last checkpoint bit for bit those of a calm run");
}

// before, it ended with code 3, and `etude up` with it
TEST_F(CheckpointFaults, F10ATrainerThatBeginsOnAFullDiskWaits) {
  const Path run = FolderOf("begun_full");
  const SmallDisk disk(run, "16m");
  if (!disk.mounted()) GTEST_SKIP() << "F10 on a small tmpfs needs root";
  {
    std::ofstream ballast(run / "ballast", std::ios::binary);
    const std::string block(4096, 'x');
    while (ballast.write(block.data(), static_cast<std::streamsize>(block.size())).flush()) {
    }
  }
  auto trainer = StartTrainer("begun_full", false);
  const std::string words = "the disk does not take";
  ASSERT_TRUE(WaitUntil([&] { return Logs("begun_full").find(words) != std::string::npos; })) << Logs("begun_full");
  EXPECT_TRUE(trainer.running());
  std::filesystem::remove(run / "ballast");
  ASSERT_TRUE(disk.Grow("256m"));
  ASSERT_EQ(trainer.Wait(120s), 0) << Logs("begun_full");
  EXPECT_EQ(Validations(run), Validations(FolderOf("calm")));
  ReportAsserted("F10",
                 "a trainer that begins on a full disk waits with words; losses bit for bit those of a calm run");
}

// ---- checkpoints on their way -------------------------------------------------------------------------

// etude-policy that follows kOwner, and what it says of itself.
class FollowingPolicy {
 public:
  FollowingPolicy(const bus::Participant& participant, const Path& log, const std::vector<std::string>& flags)
      : log_(log), statuses_(std::move(*bus::Reader<bus::PolicyStatus>::Open(participant, kOwner.partition()))) {
    std::vector<std::string> argv{(ProgramsFolder() / "etude-policy").string(), "--subscribe",
                                  kOwner.name + "@" + kOwner.id, "--domain", std::to_string(kDomain)};
    argv.insert(argv.end(), flags.begin(), flags.end());
    auto process = campaign::Process::Start({.argv = argv, .log = log, .environment = {}});
    EXPECT_TRUE(process) << process.error().message;
    process_.emplace(std::move(*process));
  }

  /// Until it says so, at most a minute; its last word.
  bus::PolicyStatus WaitFor(const std::function<bool(const bus::PolicyStatus&)>& met) {
    const Stopwatch watch;
    while (!met(last_) && watch.Seconds() < 60) {
      statuses_.Wait(200ms);
      for (auto& status : statuses_.Take()) last_ = std::move(status);
    }
    EXPECT_TRUE(met(last_)) << "serves step " << last_.step << ", refused " << last_.refused << Log();
    EXPECT_TRUE(process_->running()) << Log();
    return last_;
  }
  bus::PolicyStatus WaitForStep(std::uint64_t step) {
    return WaitFor([step](const bus::PolicyStatus& status) { return status.step == step; });
  }
  bool WaitForWords(const std::string& words) const {
    return WaitUntil([&] { return Log().find(words) != std::string::npos; });
  }
  std::string Log() const { return "\n" + ReadTextFile(log_).value_or(""); }

 private:
  Path log_;
  bus::Reader<bus::PolicyStatus> statuses_;
  bus::PolicyStatus last_;
  std::optional<campaign::Process> process_;
};

// Writes the samples of a version one by one, whole or not.
class HandPublisher {
 public:
  HandPublisher(const bus::Participant& participant, std::string name)
      : name_(std::move(name)),
        chunks_(std::move(*bus::OpenWriter(participant, kOwner.partition(), etude_wire_PublishedChunk_desc,
                                           bus::kPublishedChunkTopic, bus::kPublishedWriter))),
        manifests_(std::move(*bus::OpenWriter(participant, kOwner.partition(), etude_wire_PublishedManifest_desc,
                                              bus::kPublishedManifestTopic, bus::kPublishedWriter))) {}

  static std::uint32_t Chunks(const Bytes& bytes) { return bus::ChunkCount(bytes.size(), kChunk); }
  void WriteChunk(std::uint64_t version, const Bytes& bytes, std::uint32_t index) const {
    const auto data = bus::ChunkOf(bytes, kChunk, index);
    etude_wire_PublishedChunk wire{};
    std::snprintf(wire.channel, sizeof wire.channel, "latest");
    std::snprintf(wire.publisher, sizeof wire.publisher, "%s", name_.c_str());
    wire.slot = static_cast<std::uint8_t>(version % 2);
    wire.version = version;
    wire.size = bytes.size();
    wire.chunk_size = kChunk;
    wire.index = index;
    wire.data._length = wire.data._maximum = static_cast<std::uint32_t>(data.size());
    wire.data._buffer = const_cast<std::uint8_t*>(data.data());
    EXPECT_EQ(dds_write(chunks_.get(), &wire), DDS_RETCODE_OK);
  }
  void WriteManifest(std::uint64_t version, const Bytes& bytes, std::string meta_json) const {
    etude_wire_PublishedManifest wire{};
    std::snprintf(wire.channel, sizeof wire.channel, "latest");
    std::snprintf(wire.publisher, sizeof wire.publisher, "%s", name_.c_str());
    std::snprintf(wire.owner, sizeof wire.owner, "%s", kOwner.id.c_str());
    wire.slot = static_cast<std::uint8_t>(version % 2);
    wire.version = version;
    wire.size = bytes.size();
    wire.chunk_size = kChunk;
    wire.chunk_count = Chunks(bytes);
    auto digest = Sha256Of(bytes);
    wire.sha256._length = wire.sha256._maximum = static_cast<std::uint32_t>(digest.size());
    wire.sha256._buffer = digest.data();
    wire.meta_json = meta_json.data();
    EXPECT_EQ(dds_write(manifests_.get(), &wire), DDS_RETCODE_OK);
  }

 private:
  static constexpr std::uint32_t kChunk = 10'000;
  std::string name_;
  bus::Endpoint chunks_, manifests_;
};

Bytes WithOneBitFlipped(Bytes bytes) {
  bytes.at(bytes.size() - 100) ^= 4;  // of a tensor
  return bytes;
}

// What a publisher with altered software, or a bad disk, may publish; each in the place of a good one.
struct Forgery {
  const char* what;
  Bytes bytes;
  std::string meta_json;
  const char* words;  // of the refusal
};

TEST_F(CheckpointFaults, F14BrokenAndForgedOnesAreRefusedAndTheLastGoodOneServesOn) {
  const auto participant = Join();
  const Bytes good = CheckpointOf(30), next = CheckpointOf(40), flipped = WithOneBitFlipped(next);
  const Bytes half(next.begin(), next.begin() + static_cast<std::ptrdiff_t>(next.size() / 2));
  auto publisher = bus::BlobPublisher::Open(participant, kOwner);
  ASSERT_TRUE(publisher) << publisher.error().message;
  FollowingPolicy policy(participant, own_ / "policy.log", VerifyFlags());
  std::uint64_t version = 100;
  ASSERT_TRUE(publisher->Publish("latest", version, good, Signed(version, good)));
  std::uint64_t refused = policy.WaitForStep(30).refused;
  EXPECT_EQ(refused, 0u);

  const auto expect_refusal = [&](const char* what, const char* words) {
    const auto status = policy.WaitFor([&](const bus::PolicyStatus& last) { return last.refused > refused; });
    EXPECT_EQ(status.refused, ++refused) << what;
    EXPECT_EQ(status.step, 30u) << what;
    EXPECT_EQ(status.sha256, Sha256Hex(good)) << what;
    EXPECT_NE(status.last_refusal.find(words), std::string::npos) << what << ": " << status.last_refusal;
  };
  const std::vector<Forgery> forgeries{
      {"not signed", next, "{}", "not signed"},
      {"tampered and hashed again", flipped, Signed(102, next), "signature does not fit"},
      {"signed as another version", next, Signed(100, next), "signature does not fit"},
      {"cut off before it was signed", half, Signed(104, half), "checkpoint: "},
  };
  for (const Forgery& forgery : forgeries) {
    ASSERT_TRUE(publisher->Publish("latest", ++version, forgery.bytes, forgery.meta_json));
    expect_refusal(forgery.what, forgery.words);
  }

  // a bit that flips on the way, behind the publisher's hash
  const HandPublisher hand(participant, "hand");
  ++version;
  hand.WriteManifest(version, next, Signed(version, next));
  for (std::uint32_t i = 0; i < HandPublisher::Chunks(next); ++i) hand.WriteChunk(version, flipped, i);
  expect_refusal("one bit on the way", "checksum");
  // one that lacks a chunk is nothing yet, and does not hold the next one up, whose chunks come backwards and twice
  ++version;
  hand.WriteManifest(version, next, Signed(version, next));
  for (std::uint32_t i = 1; i < HandPublisher::Chunks(next); ++i) hand.WriteChunk(version, next, i);
  ++version;
  for (std::uint32_t i = HandPublisher::Chunks(next); i-- > 0;) {
    hand.WriteChunk(version, next, i);
    hand.WriteChunk(version, next, i);
  }
  hand.WriteManifest(version, next, Signed(version, next));
  const auto status = policy.WaitForStep(40);
  EXPECT_EQ(status.sha256, Sha256Hex(next));
  EXPECT_EQ(status.refused, refused);
  ReportAsserted("F14",
                 fmt::format("checkpoint unsigned, tampered and hashed again, signed as another version, cut off, a "
                             "bit flipped on the way, a chunk missing: {} refusals counted with their reason, the "
                             "last good one served on; chunks twice and backwards: taken",
                             refused));
}

TEST_F(CheckpointFaults, F14AnOldOneIsRefusedByAServerThatWasStartedAgain) {
  const auto participant = Join();
  const Bytes older = CheckpointOf(30), newer = CheckpointOf(40);
  {
    auto publisher = bus::BlobPublisher::Open(participant, kOwner);
    ASSERT_TRUE(publisher) << publisher.error().message;
    FollowingPolicy policy(participant, own_ / "before.log", VerifyFlags());
    ASSERT_TRUE(publisher->Publish("latest", 200, newer, Signed(200, newer)));
    policy.WaitForStep(40);
  }
  auto replay = bus::BlobPublisher::Open(participant, kOwner);
  ASSERT_TRUE(replay) << replay.error().message;
  FollowingPolicy policy(participant, own_ / "after.log", VerifyFlags());
  ASSERT_TRUE(replay->Publish("latest", 199, older, Signed(199, older)));
  EXPECT_TRUE(policy.WaitForWords("version 199 is not newer than 200")) << policy.Log();
  EXPECT_EQ(policy.Log().find("serving run"), std::string::npos) << policy.Log();
  ASSERT_TRUE(replay->Publish("latest", 201, older, Signed(201, older)));
  policy.WaitForStep(30);
  ReportAsserted("F14", "signed checkpoint of an earlier version, to a server that was started again: refused");
}

// Started when all is published and the next version is half there.
TEST_F(CheckpointFaults, F18ALateServerGetsTheNewestWholeOne) {
  const auto participant = Join();
  const Bytes older = CheckpointOf(30), newer = CheckpointOf(40);
  auto publisher = bus::BlobPublisher::Open(participant, kOwner);
  ASSERT_TRUE(publisher) << publisher.error().message;
  ASSERT_TRUE(publisher->Publish("latest", 300, older, "{}"));
  ASSERT_TRUE(publisher->Publish("latest", 301, newer, "{}"));
  const HandPublisher hand(participant, "next");
  const Bytes unfinished = WithOneBitFlipped(newer);
  for (std::uint32_t i = 0; i < HandPublisher::Chunks(unfinished) / 2; ++i) hand.WriteChunk(302, unfinished, i);
  const Stopwatch watch;
  FollowingPolicy policy(participant, own_ / "late.log", {});
  const auto status = policy.WaitForStep(40);
  const double seconds = watch.Seconds();
  EXPECT_EQ(status.sha256, Sha256Hex(newer)) << "not a byte of another version";
  EXPECT_EQ(status.refused, 0u);
  ReportAsserted("F18",
                 fmt::format("policy server started after the last publication, with half of the next version on "
                             "the bus: it serves the newest whole one, bit for bit, {:.1f} s after its start",
                             seconds));
}

}  // namespace checkpoint_faults_test
}  // namespace etude::faults
