// SPDX-License-Identifier: Apache-2.0
// What a run tells while it trains: means over windows of steps, progress once a second, a line now and then.
#pragma once

#include <map>
#include <string>

#include "services/core/progress.h"
#include "trainer/learn/run.h"

namespace etude::learn {

/// Not thread-safe.
class Reporter {
 public:
  Reporter(TrainingRun& run, const Hooks& hooks) : run_(run), hooks_(hooks) {}

  void Add(const BatchLoss& loss, double wait_s, const Optimizer::Outcome& outcome);
  /// Writes the window's means to metrics.jsonl and begins a new one. @error of the disk.
  Status Flush();
  /// Begins a new window without writing: rates are of training, not of validation.
  void Restart() { window_ = {}; }
  /// Calls the progress hook, and tells people: a line that is rewritten on a terminal, else a line of the log every
  /// ten seconds; in the log at the end, too.
  void Report(bool finished);
  bool due() const;

 private:
  struct Window {
    double loss = 0, wait_s = 0, gradient_norm = 0;
    std::map<std::string, double> terms;
    int steps = 0;
    Stopwatch watch;
  };
  void TakeRates();
  std::string Line() const;

  TrainingRun& run_;
  const Hooks& hooks_;
  Window window_;
  Progress last_;
  Stopwatch since_progress_, since_line_;
  ProgressDisplay display_;
};

}  // namespace etude::learn
