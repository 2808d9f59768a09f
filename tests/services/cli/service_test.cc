// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/service.cc
#include "services/cli/service.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <thread>

#include "tests/support/temporary_folder.h"

namespace etude::cli {
namespace service_test {

using namespace std::chrono_literals;

TEST(Service, ReportsAWrongCommandLineWithTheLogsLastLines) {
  TemporaryFolder folder;
  // without a campaign the fake worker refuses its usage
  auto service = Service::Start({.program = "fake_worker", .arguments = {}, .log = folder / "service.log"});
  ASSERT_TRUE(service) << service.error().message;
  Status status;
  while (status && !service->done()) {
    status = service->Supervise();
    std::this_thread::sleep_for(1ms);
  }
  ASSERT_FALSE(status);
  EXPECT_THAT(status.error().message, testing::HasSubstr("exit code 2"));
  EXPECT_THAT(status.error().message, testing::HasSubstr("--campaign"));
}

TEST(Service, AProgramThatIsNotBuiltIsTheMachinesFault) {
  const auto service = Service::Start({.program = "etude-none"});
  ASSERT_FALSE(service);
  EXPECT_EQ(service.error().code, Code::kUnavailable);
}

}  // namespace service_test
}  // namespace etude::cli
