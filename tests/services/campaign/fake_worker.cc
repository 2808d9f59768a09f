// SPDX-License-Identifier: Apache-2.0
// A worker whose work is to make synthetic episodes: for tests of the conversation, as a process that can be
// killed. fake_worker CAMPAIGN DOMAIN [MS_PER_ATTEMPT] [CONTENT]
//
//   FAKE_PREFETCH=1         asks for its next lease while it works
//   FAKE_IDLE_TIMEOUT_MS=N  goes home after so long without work
//   FAKE_SECURITY=DIR/NAME  its identity on a secured bus; its role is not looked at before
//   FAKE_ADDRESS=NAME       where it reads its leases, so that a test can, too
//   FAKE_SEES=N             looks for its campaign once it sees N of that name (or has waited 20 s)
//   FAKE_LEAK_MB=N          keeps so much more memory with every attempt
//   FAKE_ROOM_MB=N          may take so much more than it has once it has joined the bus (RLIMIT_AS)
#include <sys/resource.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <memory>
#include <thread>
#include <vector>

#include "services/bus/directory.h"
#include "services/campaign/worker_client.h"
#include "services/core/clock.h"
#include "services/core/command.h"
#include "services/core/identity.h"
#include "services/core/stop.h"
#include "tests/services/campaign/fake_work.h"

namespace etude {
namespace {

constexpr std::size_t kMb = 1u << 20;

std::string Variable(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

// From here on what this process asks for beyond `room_mb` more is refused.
void LimitMemory(std::size_t room_mb) {
  std::size_t pages = 0;
  std::ifstream("/proc/self/statm") >> pages;  // of the address space
  const rlim_t most = pages * static_cast<std::size_t>(::sysconf(_SC_PAGESIZE)) + room_mb * kMb;
  const rlimit limit{most, most};
  ::setrlimit(RLIMIT_AS, &limit);
}

// Memory that is never given back: mapped, and not touched.
class Leak {
 public:
  explicit Leak(std::size_t mb) : mb_(mb) {}
  void Grow() {
    if (mb_ > 0) kept_.push_back(std::make_unique_for_overwrite<char[]>(mb_ * kMb));
  }

 private:
  std::size_t mb_;
  std::vector<std::unique_ptr<char[]>> kept_;
};

Status WaitUntilSeen(const bus::Participant& participant, const std::string& campaign, std::size_t count) {
  ETUDE_ASSIGN_OR_RETURN(const auto selector, ParseSelector(campaign, "fake_worker"));
  ETUDE_ASSIGN_OR_RETURN(auto directory, bus::Directory::Open(participant));
  const auto seen = [&] { return directory.Matching(bus::PresenceKind::kCampaign, selector).size(); };
  for (const Stopwatch watch; seen() < count && watch.Seconds() < 20;)
    if (WaitForStop(std::chrono::milliseconds(5))) break;
  return {};
}

Status Work(int argc, char** argv) {
  campaign::WorkerOptions options;
  options.campaign = argc > 1 ? argv[1] : "";
  const auto domain = static_cast<std::uint32_t>(argc > 2 ? std::atoi(argv[2]) : 0);
  const std::chrono::milliseconds pace(argc > 3 ? std::atoi(argv[3]) : 0);
  if (argc > 4) options.content = static_cast<std::uint32_t>(std::atoi(argv[4]));
  options.idle_timeout = std::chrono::milliseconds(std::atoi(Variable("FAKE_IDLE_TIMEOUT_MS").c_str()));
  if (const std::string stay = Variable("FAKE_STAY_MS"); !stay.empty())
    options.stay = std::chrono::milliseconds(std::atoi(stay.c_str()));
  options.prefetch = !Variable("FAKE_PREFETCH").empty();
  options.heartbeat = std::chrono::milliseconds(100);
  options.ask_again = std::chrono::milliseconds(300);
  options.send_timeout = std::chrono::milliseconds(3000);
  ETUDE_ASSIGN_OR_RETURN(const auto participant, bus::Participant::Open({.domain = domain,
                                                                         .security = Variable("FAKE_SECURITY"),
                                                                         .address = Variable("FAKE_ADDRESS")}));
  if (const std::string sees = Variable("FAKE_SEES"); !sees.empty())
    ETUDE_RETURN_IF_ERROR(
        WaitUntilSeen(participant, options.campaign, static_cast<std::size_t>(std::atoi(sees.c_str()))));
  if (const std::string room = Variable("FAKE_ROOM_MB"); !room.empty())
    LimitMemory(static_cast<std::size_t>(std::atoi(room.c_str())));
  Leak leak(static_cast<std::size_t>(std::atoi(Variable("FAKE_LEAK_MB").c_str())));
  ETUDE_ASSIGN_OR_RETURN(auto client, campaign::WorkerClient::Open(participant, options));
  return client.Run([&](const campaign::JoinedCampaign& joined) -> Result<campaign::WorkFunction> {
    return [spec = joined.spec, pace, &leak,
            prefetch = options.prefetch](const campaign::WorkItem& item) -> Result<campaign::WorkResult> {
      leak.Grow();
      if (prefetch) item.progress("fake", 0);
      WaitForStop(pace);  // stands for the simulation
      if (prefetch) item.progress("fake", 1);
      return campaign::FakeAttempt(spec, item);
    };
  });
}

}  // namespace
}  // namespace etude

int main(int argc, char** argv) {
  return etude::RunMain("fake_worker", [&] { return etude::Work(argc, argv); });
}
