// SPDX-License-Identifier: Apache-2.0
// A worker whose work is to make synthetic episodes: for tests of the conversation, as a process that can be
// killed. fake_worker CAMPAIGN DOMAIN [MS_PER_ATTEMPT] [CONTENT]
#include <cstdlib>
#include <thread>

#include "services/campaign/worker_client.h"
#include "services/core/command.h"
#include "services/core/stop.h"
#include "tests/services/campaign/fake_work.h"

namespace etude {
namespace {

Status Work(int argc, char** argv) {
  campaign::WorkerOptions options;
  options.campaign = argc > 1 ? argv[1] : "";
  const auto domain = static_cast<std::uint32_t>(argc > 2 ? std::atoi(argv[2]) : 0);
  const std::chrono::milliseconds pace(argc > 3 ? std::atoi(argv[3]) : 0);
  if (argc > 4) options.content = static_cast<std::uint32_t>(std::atoi(argv[4]));
  if (const char* idle = std::getenv("FAKE_IDLE_TIMEOUT_MS"))
    options.idle_timeout = std::chrono::milliseconds(std::atoi(idle));
  options.heartbeat = std::chrono::milliseconds(100);
  options.ask_again = std::chrono::milliseconds(300);
  options.send_timeout = std::chrono::milliseconds(3000);
  ETUDE_ASSIGN_OR_RETURN(const auto participant, bus::Participant::Open({domain, ""}));
  ETUDE_ASSIGN_OR_RETURN(auto client, campaign::WorkerClient::Open(participant, options));
  return client.Run([&](const campaign::JoinedCampaign& joined) -> Result<campaign::WorkFunction> {
    return [spec = joined.spec, pace](const campaign::WorkItem& item) -> Result<campaign::WorkResult> {
      WaitForStop(pace);  // stands for the simulation
      return campaign::FakeAttempt(spec, item);
    };
  });
}

}  // namespace
}  // namespace etude

int main(int argc, char** argv) {
  return etude::RunMain("fake_worker", [&] { return etude::Work(argc, argv); });
}
