// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/worker_pool.cc with programs that die, in the worker's place.
#include "services/cli/worker_pool.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "services/core/stop.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/write_program.h"

namespace etude::cli {
namespace worker_pool_test {

using namespace std::chrono_literals;
using testing::HasSubstr;

class DyingWorkers : public testing::Test {
 protected:
  // Two that run this.
  Result<WorkerPool> StartTwo(const std::string& script, const std::function<std::uint64_t()>& done = nullptr) {
    return WorkerPool::Start({.workers = 2,
                              .campaign = "demo@aaaa",
                              .bus = {},
                              .logs = folder_ / "logs",
                              .on_end = [this](const std::string&, int) { ++ended_; },
                              .done = done,
                              .program = WriteProgram(folder_ / "worker", script)});
  }
  // Supervises until it is given up.
  Error RunUntilGivenUp(const std::string& script, const std::function<std::uint64_t()>& done) {
    auto pool = StartTwo(script, done);
    EXPECT_TRUE(pool);
    const Stopwatch watch;
    Status status;
    while (status && watch.Seconds() < 50) {
      status = pool->Supervise();
      WaitForStop(1ms);
    }
    EXPECT_FALSE(status) << "it would go on for ever";
    return status ? Error{} : status.error();
  }

  TemporaryFolder folder_;
  int ended_ = 0;
};

constexpr char kCrash[] = "#!/bin/sh\necho 'GL: out of luck' >&2\nkill -SEGV $$\n";

TEST_F(DyingWorkers, AreGivenUpWithTheSignalAndTheirLastWords) {
  const Error error = RunUntilGivenUp(kCrash, [] { return std::uint64_t{0}; });
  EXPECT_EQ(error.code, Code::kUnavailable) << "exit code 3";
  EXPECT_EQ(ended_, campaign::HopelessDeaths(2));
  EXPECT_THAT(error.message, HasSubstr(std::to_string(campaign::HopelessDeaths(2)) + " times"));
  EXPECT_THAT(error.message, HasSubstr("SIGSEGV"));
  EXPECT_THAT(error.message, HasSubstr("GL: out of luck"));
}

TEST_F(DyingWorkers, AreStartedAgainForAsLongAsEpisodesComeIn) {
  const Error error = RunUntilGivenUp(kCrash, [this] { return static_cast<std::uint64_t>(std::min(ended_, 4)); });
  EXPECT_EQ(ended_, 4 + campaign::HopelessDeaths(2) - 1) << "the fourth death is the first after the last commit";
  EXPECT_THAT(error.message, HasSubstr("SIGSEGV"));
}

// before, they counted as gone home: where all were, a campaign waited for ever
TEST_F(DyingWorkers, ThatWereToldToEndAreStartedAgain) {
  auto pool = StartTwo("#!/bin/sh\nexit 0\n");
  ASSERT_TRUE(pool) << pool.error().message;
  for (const Stopwatch watch; pool->restarts() < 2 && watch.Seconds() < 30; WaitForStop(1ms))
    ASSERT_TRUE(pool->Supervise()) << "no failure";
  EXPECT_GE(pool->restarts(), 2);
}

TEST_F(DyingWorkers, ThatDoNotMoveAreEndedAndStartedAgain) {
  const Path program = WriteProgram(folder_ / "worker", "#!/bin/sh\necho $4 >> $0.names\nexec sleep 600\n");
  std::string hung;
  auto pool = WorkerPool::Start({.workers = 1,
                                 .campaign = "demo@aaaa",
                                 .bus = {},
                                 .logs = folder_ / "logs",
                                 .on_end = [this](const std::string&, int) { ++ended_; },
                                 .done = [] { return std::uint64_t{0}; },
                                 .silent =
                                     [&] {
                                       std::vector<std::string> names{"another-host-w0"};
                                       if (ended_ == 0) names.push_back(hung);
                                       return names;
                                     },
                                 .program = program});
  ASSERT_TRUE(pool);
  const Stopwatch watch;
  while (pool->restarts() == 0 && watch.Seconds() < 30) {
    const std::string names = ReadTextFile(program.string() + ".names").value_or("");
    hung = names.substr(0, names.find('\n'));
    ASSERT_TRUE(pool->Supervise());
    WaitForStop(1ms);
  }
  EXPECT_EQ(ended_, 1);
  EXPECT_EQ(pool->restarts(), 1);
}

TEST(WorkerPool, StopLetsWorkersDrain) {
  TemporaryFolder folder;
  // the second SIGTERM, as with our workers, ends them without their last word
  const Path program = WriteProgram(folder / "worker",
                                    "#!/bin/sh\n"
                                    "trap 'trap \"exit 1\" TERM; sleep 1; echo drained; exit 0' TERM\n"
                                    "echo ready\nwhile :; do sleep 0.05; done\n");
  auto pool = WorkerPool::Start({.workers = 2,
                                 .campaign = "demo@aaaa",
                                 .bus = {},
                                 .logs = folder / "logs",
                                 .on_end = nullptr,
                                 .done = nullptr,
                                 .program = program});
  ASSERT_TRUE(pool) << pool.error().message;
  const auto said = [&](int k) {
    return ReadTextFile(folder / "logs" / ("worker-" + std::to_string(k) + ".log")).value_or("");
  };
  const Stopwatch watch;
  while ((said(0) != "ready\n" || said(1) != "ready\n") && watch.Seconds() < 30) WaitForStop(5ms);
  pool->Stop();
  // the shell may also tell of the pause that the signal cut off
  EXPECT_THAT(said(0), testing::EndsWith("drained\n"));
  EXPECT_THAT(said(1), testing::EndsWith("drained\n"));
}

TEST_F(DyingWorkers, AreToldAndNotStartedAgainWhereNothingIsLeftToDo) {
  auto pool = StartTwo("#!/bin/sh\nexit 1\n");
  ASSERT_TRUE(pool) << pool.error().message;
  for (const Stopwatch watch; ended_ < 2 && watch.Seconds() < 30; WaitForStop(1ms)) pool->NoteEnds();
  EXPECT_EQ(ended_, 2);
  EXPECT_EQ(pool->restarts(), 0);
}

TEST(HopelessDeaths, GrowWithTheWorkers) {
  EXPECT_EQ(campaign::HopelessDeaths(1), 6);
  EXPECT_EQ(campaign::HopelessDeaths(64), 192);
}

}  // namespace worker_pool_test
}  // namespace etude::cli
