// SPDX-License-Identifier: Apache-2.0
#include "services/cli/service.h"

#include <fmt/format.h>

#include <algorithm>

#include "services/cli/worker_pool.h"
#include "services/core/command.h"
#include "services/core/log.h"

namespace etude::cli {

using namespace std::chrono_literals;

Result<Service> Service::Start(const ServiceOptions& options) {
  Service service(options);
  ETUDE_RETURN_IF_ERROR(service.Launch());
  return service;
}

Status Service::Launch() {
  ETUDE_ASSIGN_OR_RETURN(const Path program, campaign::FindSibling(options_.program));
  campaign::ProcessOptions process;
  process.argv = {program.string()};
  process.argv.insert(process.argv.end(), options_.arguments.begin(), options_.arguments.end());
  // one that died before it kept anything begins anew
  std::error_code ignored;
  const bool goes_on = options_.restart_needs.empty() || std::filesystem::exists(options_.restart_needs, ignored);
  if (restarts_ > 0 && goes_on)
    process.argv.insert(process.argv.end(), options_.restart_arguments.begin(), options_.restart_arguments.end());
  process.environment = options_.environment;
  process.log = options_.log;
  ETUDE_ASSIGN_OR_RETURN(auto started, campaign::Process::Start(process));
  process_.emplace(std::move(started));
  since_launch_.Restart();
  return {};
}

Status Service::Supervise() {
  if (done_) return {};
  if (!process_) return MonotonicClock::now() < start_again_ ? Status() : Launch();
  const auto exit_code = process_->Poll();
  if (!exit_code) return {};
  process_.reset();
  if (*exit_code == kExitOk && options_.lasting) {
    Log().warn("{} was told to end, it is started again", options_.program);
    // no failure: it does not count among them, but one that ends again and again is given more and more time
    constexpr double kBriefly = 20;  // s
    brief_lives_ = since_launch_.Seconds() < kBriefly ? std::min(brief_lives_ + 1, 60) : 0;
    start_again_ = MonotonicClock::now() + 1s * std::max(1, brief_lives_);
    return {};
  }
  if (*exit_code == kExitOk) {
    done_ = true;
    return {};
  }
  constexpr double kHealthy = 600;  // s
  deaths_ = since_launch_.Seconds() > kHealthy ? 1 : deaths_ + 1;
  ++restarts_;
  if (*exit_code == kExitUsage || *exit_code == kExitMachine || deaths_ > options_.max_restarts)
    return Fail(
        *exit_code == kExitMachine ? Code::kUnavailable : Code::kInternal,
        fmt::format("{} ended with exit code {}{}", options_.program, *exit_code,
                    options_.log.empty() ? "; its words stand above"
                                         : fmt::format(". From {}:{}", options_.log.string(), LogTail(options_.log))));
  Log().warn("{} ended with exit code {}, it is started again", options_.program, *exit_code);
  start_again_ = MonotonicClock::now() + 1s * deaths_;
  return {};
}

void Service::Stop(std::chrono::milliseconds patience) {
  if (process_) process_->Stop(patience);
  process_.reset();
  done_ = true;
}

}  // namespace etude::cli
