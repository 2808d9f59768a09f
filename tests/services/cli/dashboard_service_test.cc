// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/dashboard_service.cc with the real gateway.
#include "services/cli/dashboard_service.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <thread>

#include "services/core/clock.h"
#include "tests/support/matchers.h"
#include "tests/support/programs_folder.h"
#include "tests/support/temporary_folder.h"

namespace etude::cli {
namespace dashboard_service_test {

using namespace std::chrono_literals;

constexpr std::uint32_t kDomain = 61;

std::string Gateway() { return std::filesystem::absolute(ProgramsFolder() / "etude-gateway").string(); }

// Supervises until it has an address, fails, or 30 s have passed.
Status Settle(DashboardService& service) {
  Status status;
  for (const auto end = MonotonicClock::now() + 30s;
       status && service.address().empty() && MonotonicClock::now() < end;) {
    status = service.Supervise();
    std::this_thread::sleep_for(5ms);
  }
  return status;
}

TEST(DashboardService, SaysItsAddressAndATakenPortIsAnError) {
  TemporaryFolder folder;
  auto first = DashboardService::Start({folder.path(), 0, {kDomain, "", "text"}, Gateway()});
  ASSERT_THAT(first, IsOk());
  ASSERT_THAT(Settle(*first), IsOk());
  ASSERT_THAT(first->address(), testing::StartsWith("http://127.0.0.1:"));
  const auto port = static_cast<std::uint16_t>(std::stoi(first->address().substr(first->address().rfind(':') + 1)));

  TemporaryFolder other;
  auto second = DashboardService::Start({other.path(), port, {kDomain, "", "text"}, Gateway()});
  ASSERT_THAT(second, IsOk());
  const Status taken = Settle(*second);
  EXPECT_THAT(taken, MessageHas(std::to_string(port)));
  EXPECT_THAT(taken, MessageHas("--dashboard-port"));  // what `etude up` calls it
  EXPECT_EQ(second->address(), "");
  first->Stop(5s);
}

}  // namespace dashboard_service_test
}  // namespace etude::cli
