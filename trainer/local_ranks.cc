// SPDX-License-Identifier: Apache-2.0
#include "trainer/local_ranks.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <utility>

#include "services/core/clock.h"

namespace etude {

using namespace std::chrono_literals;

Result<LocalRanks> LocalRanks::Start(const std::vector<std::string>& argv, int ranks, const std::string& meet,
                                     const Path& out) {
  LocalRanks started;
  for (int number = 1; number < ranks; ++number) {
    campaign::ProcessOptions options{.argv = argv, .log = out / fmt::format("rank-{}.log", number)};
    for (const std::string& word : {std::string("--rank"), std::to_string(number), std::string("--meet"), meet})
      options.argv.push_back(word);
    ETUDE_ASSIGN_OR_RETURN(auto process, campaign::Process::Start(options));
    started.ranks_.push_back({number, options.log, std::move(process)});
  }
  return started;
}

// None of them ends before rank 0 says that the run is over, and after that nobody asks.
Status LocalRanks::Check() {
  std::vector<std::string> ended;
  for (auto& rank : ranks_)
    if (const auto code = rank.process.Poll())
      ended.push_back(fmt::format("rank {} of {} ended with {}, its words are in '{}'", rank.number, ranks_.size() + 1,
                                  campaign::HowItEnded(*code), rank.log.string()));
  if (ended.empty()) return {};
  return Fail(Code::kUnavailable, fmt::format("{}", fmt::join(ended, "; ")));
}

// its connections close a moment before the process can be waited for
Error LocalRanks::Explain(const Error& lost) {
  Status there = Check();
  for (const Stopwatch watch; there && !ranks_.empty() && watch.Seconds() < 2; there = Check())
    (void)ranks_.front().process.Wait(50ms);
  if (there || lost.message.find(there.error().message) != std::string::npos) return lost;
  return {lost.code, fmt::format("{}: {}", lost.message, there.error().message)};
}

}  // namespace etude
