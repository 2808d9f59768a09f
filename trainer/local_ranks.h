// SPDX-License-Identifier: Apache-2.0
// The other ranks of a run that is all on this machine: processes that rank 0 starts and watches.
#pragma once

#include <string>
#include <vector>

#include "services/campaign/process.h"
#include "services/core/result.h"

namespace etude {

/// Ends them when it is destroyed. Not thread-safe.
class LocalRanks {
 public:
  /// @param argv  rank 0's; the others' have --rank and --meet behind it @param out  where rank-N.log has their words
  /// @error of a process that cannot be started; those before it are ended
  static Result<LocalRanks> Start(const std::vector<std::string>& argv, int ranks, const std::string& meet,
                                  const Path& out);

  /// @error kUnavailable: which ones have ended, how, and where their words are
  Status Check();
  /// What rank 0 ended with when it had lost one of them, and what became of that one.
  Error Explain(const Error& lost);

 private:
  struct LocalRank {
    int number;
    Path log;
    campaign::Process process;
  };
  std::vector<LocalRank> ranks_;  ///< none: they are on other machines, or it trains alone
};

}  // namespace etude
