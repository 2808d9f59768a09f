// SPDX-License-Identifier: Apache-2.0
// What the bus promises between real processes: many of them on one host without multicast, and blobs
// that arrive although their receiver hung or died. The program starts itself again as the other side.
#include <gtest/gtest.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <future>
#include <optional>
#include <set>

#include "services/bus/blob_transfer.h"
#include "services/bus/topic.h"
#include "services/core/clock.h"
#include "services/core/hash.h"
#include "services/core/stop.h"
#include "tests/services/bus/two_processes.h"

namespace etude::bus {
namespace bus_processes_test {

using namespace std::chrono_literals;

constexpr std::uint32_t kDomain = 72;
constexpr double kPatienceS = 60;

/// deploy/dds/local.xml with a short lease, so that an outage beyond it takes seconds.
std::string ShortLeaseProfile() {
  std::string profile = LocalProfileWith("<LeaseDuration>1s</LeaseDuration>");
  const std::string interval = "<SPDPInterval>5s";
  profile.replace(profile.find(interval), interval.size(), "<SPDPInterval>1s");
  return profile;
}

// ---- the other side --------------------------------------------------------------------------------

// Says its name until it is answered.
int RunWorker(const std::string& name) {
  auto participant = Participant::Open({kDomain, ""});
  if (!participant) {
    std::fprintf(stderr, "%s: %s\n", name.c_str(), participant.error().message.c_str());
    return 1;
  }
  auto status = Writer<WorkerStatus>::Open(*participant, "many");
  auto leases = Reader<Lease>::Open(*participant, "many");
  if (!status || !leases) return 1;
  WorkerStatus said;
  said.worker = name;
  for (const Stopwatch watch; watch.Seconds() < kPatienceS;) {
    if (!status->Write(said)) return 1;
    leases->Wait(500ms);
    for (const auto& lease : leases->Take()) {
      if (lease.worker == name) return 0;
    }
  }
  return 1;
}

// Acknowledges blobs until one of 1 byte has come; the others' metadata is their SHA-256.
int RunReceiver() {
  auto participant = Participant::Open({kDomain, ShortLeaseProfile()});
  if (!participant) return 1;
  auto receiver = BlobReceiver::Open(*participant, {"outage", "1"}, "episode");
  if (!receiver) return 1;
  for (const Stopwatch watch; watch.Seconds() < kPatienceS;) {
    const auto blob = receiver->Receive(1s);
    if (!blob) continue;
    if (Sha256Hex(blob->bytes) != blob->manifest.meta_json) return 2;
    if (!receiver->Acknowledge(blob->manifest, {AckKind::kDone, ""})) return 1;
    if (blob->bytes.size() == 1) return 0;
  }
  return 1;
}

// ---- this side -------------------------------------------------------------------------------------

class Child {
 public:
  explicit Child(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "/proc/self/exe");
    std::vector<char*> argv;
    for (auto& argument : arguments) argv.push_back(argument.data());
    argv.push_back(nullptr);
    EXPECT_EQ(::posix_spawn(&pid_, argv[0], nullptr, nullptr, argv.data(), environ), 0);
  }
  Child(Child&& other) noexcept : pid_(std::exchange(other.pid_, 0)) {}
  ~Child() {
    if (pid_ <= 0) return;
    ::kill(pid_, SIGKILL);
    Wait();
  }
  void Signal(int number) const { EXPECT_EQ(::kill(pid_, number), 0); }
  int Wait() {
    int status = 0;
    EXPECT_EQ(::waitpid(std::exchange(pid_, 0), &status, 0) > 0, true);
    return status;
  }

 private:
  pid_t pid_ = 0;
};

TEST(BusProcesses, FortyFiveOnOneHostMeetWithoutMulticast) {
  constexpr std::size_t kWorkers = 45;
  ::unsetenv("CYCLONEDDS_URI");
  const Stopwatch watch;
  auto participant = Participant::Open({kDomain, ""});
  ASSERT_TRUE(participant) << participant.error().message;
  auto statuses = Reader<WorkerStatus>::Open(*participant, "many");
  auto leases = Writer<Lease>::Open(*participant, "many");
  ASSERT_TRUE(statuses && leases);
  std::vector<Child> children;
  for (std::size_t i = 0; i < kWorkers; ++i) children.push_back(Child({"worker", std::to_string(i)}));
  std::set<std::string> names;
  while (names.size() < kWorkers && watch.Seconds() < kPatienceS) {
    statuses->Wait(1s);
    for (const auto& status : statuses->Take()) names.insert(status.worker);
  }
  EXPECT_EQ(names.size(), kWorkers);
  ASSERT_TRUE(leases->WaitForReaders(kWorkers, 30s));
  for (const auto& name : names) {
    Lease lease;
    lease.worker = name;
    ASSERT_TRUE(leases->Write(lease));
  }
  for (auto& child : children) EXPECT_EQ(child.Wait(), 0);
  std::fprintf(stderr, "%zu processes met and were answered in %.1f s\n", kWorkers, watch.Seconds());
}

class Outage : public testing::Test {
 protected:
  using Sending = std::future<Result<Verdict>>;

  void SetUp() override {
    auto opened = Participant::Open({kDomain, ShortLeaseProfile()});
    ASSERT_TRUE(opened) << opened.error().message;
    participant_.emplace(std::move(*opened));
    SendOptions options;
    options.chunk_size = 64 * 1024;
    auto sender = BlobSender::Open(*participant_, {"outage", "1"}, "episode", "s", options);
    ASSERT_TRUE(sender);
    sender_.emplace(std::move(*sender));
  }
  // `bytes` must outlive it.
  Sending Send(std::uint64_t id, const std::vector<std::uint8_t>& bytes) {
    return std::async(std::launch::async,
                      [this, id, &bytes] { return sender_->Send(id, bytes, 0, Sha256Hex(bytes), 60s); });
  }
  static void ExpectDone(Sending sending) {
    const auto verdict = sending.get();
    ASSERT_TRUE(verdict) << verdict.error().message;
    EXPECT_EQ(verdict->kind, AckKind::kDone) << verdict->reason;
  }
  // Until the receiver counts as gone.
  void WaitUntilGone() {
    const auto announcer = Writer<BlobManifest>::Open(*participant_, "outage/1/episode");
    ASSERT_TRUE(announcer);
    for (const Stopwatch watch; announcer->matched_readers() > 0 && watch.Seconds() < kPatienceS;) WaitForStop(20ms);
    ASSERT_EQ(announcer->matched_readers(), 0);
  }

  std::optional<Participant> participant_;
  std::optional<BlobSender> sender_;
};

TEST_F(Outage, AReceiverThatHungLongerThanItsLeaseLosesNothing) {
  Child receiver({"receiver"});
  const auto small = MakeBytes(300'000, 1);
  ExpectDone(Send(1, small));
  const auto large = MakeBytes(20'000'000, 2);
  receiver.Signal(SIGSTOP);
  auto sending = Send(2, large);
  WaitUntilGone();
  receiver.Signal(SIGCONT);
  ExpectDone(std::move(sending));
  const std::vector<std::uint8_t> last(1, 7);
  ExpectDone(Send(3, last));
  EXPECT_EQ(receiver.Wait(), 0);
}

TEST_F(Outage, AReceiverThatWasKilledIsReplaced) {
  std::optional<Child> receiver;
  receiver.emplace(Child({"receiver"}));
  const auto small = MakeBytes(300'000, 1);
  ExpectDone(Send(1, small));
  const auto large = MakeBytes(30'000'000, 2);
  receiver->Signal(SIGSTOP);  // so that it is surely in the middle of the blob
  auto sending = Send(2, large);
  EXPECT_EQ(sending.wait_for(50ms), std::future_status::timeout);
  receiver->Signal(SIGKILL);
  receiver->Wait();
  Child successor({"receiver"});
  ExpectDone(std::move(sending));
  const std::vector<std::uint8_t> last(1, 7);
  ExpectDone(Send(3, last));
  EXPECT_EQ(successor.Wait(), 0);
}

}  // namespace bus_processes_test
}  // namespace etude::bus

int main(int argc, char** argv) {
  if (argc == 3 && std::strcmp(argv[1], "worker") == 0) return etude::bus::bus_processes_test::RunWorker(argv[2]);
  if (argc == 2 && std::strcmp(argv[1], "receiver") == 0) return etude::bus::bus_processes_test::RunReceiver();
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
