// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/service.cc
#include "services/cli/service.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <thread>

#include "services/core/clock.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/write_program.h"

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

// Says of every start whether it was told to go on; from its second start on there is something to go on with.
constexpr const char* kDiesTwice = R"sh(#!/bin/sh
echo "began $2" >> "$1/starts"
[ "$2" = --resume ] && exit 0
[ "$(wc -l < "$1/starts")" -eq 2 ] && : > "$1/state"
exit 1
)sh";

TEST(Service, ARestartWithoutAStateBeginsAnew) {
  TemporaryFolder folder;
  const Path program = WriteProgram(folder / "dies_twice.sh", kDiesTwice);
  auto service = Service::Start({.program = program.string(),  // need not lie beside this program
                                 .arguments = {folder.path().string()},
                                 .restart_arguments = {"--resume"},
                                 .restart_needs = folder / "state",
                                 .environment = {},
                                 .log = folder / "service.log"});
  ASSERT_TRUE(service) << service.error().message;
  Status status;
  while (status && !service->done()) {
    status = service->Supervise();
    std::this_thread::sleep_for(1ms);
  }
  ASSERT_TRUE(status) << status.error().message;
  EXPECT_EQ(ReadTextFile(folder / "starts").value_or(""), "began \nbegan \nbegan --resume\n");
}

constexpr const char* kEndsWell = R"sh(#!/bin/sh
echo began >> "$1/starts"
)sh";

TEST(Service, AServerThatWasToldToEndIsStartedAgain) {
  TemporaryFolder folder;
  const Path program = WriteProgram(folder / "ends_well.sh", kEndsWell);
  auto service = Service::Start({.program = program.string(),
                                 .arguments = {folder.path().string()},
                                 .environment = {},
                                 .log = folder / "service.log",
                                 .max_restarts = 0,  // it does not count among failures
                                 .lasting = true});
  ASSERT_TRUE(service) << service.error().message;
  const auto starts = [&] { return ReadTextFile(folder / "starts").value_or(""); };
  const auto deadline = MonotonicClock::now() + 30s;
  Status status;
  while (status && starts().size() < std::string_view("began\nbegan\n").size() && MonotonicClock::now() < deadline) {
    status = service->Supervise();
    std::this_thread::sleep_for(1ms);
  }
  EXPECT_TRUE(status) << status.error().message;
  EXPECT_EQ(starts(), "began\nbegan\n");
  EXPECT_FALSE(service->done());
}

}  // namespace service_test
}  // namespace etude::cli
