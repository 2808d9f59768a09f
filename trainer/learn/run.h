// SPDX-License-Identifier: Apache-2.0
// One run while it lives: what build.cc makes (of the data: build_data.h; of what it begins with: begin.h), trainer.cc
// moves on and keep.cc writes down.
#pragma once

#include <limits>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "services/core/clock.h"
#include "trainer/checkpoint/metadata.h"
#include "trainer/curriculum/scheduler.h"
#include "trainer/data/loader.h"
#include "trainer/learn/evaluate.h"
#include "trainer/learn/limit.h"
#include "trainer/learn/metrics_log.h"
#include "trainer/learn/optimizer.h"
#include "trainer/learn/replicas.h"
#include "trainer/learn/run_state.h"
#include "trainer/learn/trainer.h"
#include "trainer/policy/clip/text_encoder.h"

namespace etude::learn {

/// Not thread-safe; the loader and the follower have threads of their own.
struct TrainingRun {
  TrainConfig config;
  RunOptions options;
  std::shared_ptr<data::Dataset> dataset;
  std::shared_ptr<const language::Grammar> grammar;
  std::string words;  ///< that sentences of its training have, as a checkpoint says them
  std::shared_ptr<const data::BatchMaker> maker;
  std::shared_ptr<clip::TextEncoder> text_encoder;  ///< of language clip:DIR only
  std::unique_ptr<Replicas> replicas;
  std::unique_ptr<Optimizer> optimizer;
  std::unique_ptr<curriculum::Scheduler> scheduler;
  std::unique_ptr<MetricsLog> log;

  checkpoint::Embodiment embodiment;                 ///< of the dataset
  std::shared_ptr<const data::Snapshot> validation;  ///< the same episodes from the first step to the last
  std::map<std::string, checkpoint::ModuleRecord> modules;
  RunLimit limit{0, 0};
  std::uint64_t step = 0;     ///< steps done
  double elapsed_before = 0;  ///< s, of earlier runs
  Stopwatch watch;
  double waited = 0;  ///< s since the watch began, in which a disk was full: no time of training
  int best_stage = 0;
  double best_score = std::numeric_limits<double>::infinity();
  std::uint64_t checkpoint_step = 0, evaluated_step = 0;
  Evaluation evaluation;

  double Elapsed() const { return elapsed_before + watch.Seconds() - waited; }
  double Progress() const { return limit.Progress(step, Elapsed()); }
};

/// A run from the start, or from `options.out`'s state. Waits for data when it is followed.
/// @error as Trainer::Create.
Result<std::unique_ptr<TrainingRun>> BuildRun(const TrainConfig& config, std::shared_ptr<data::Dataset> dataset,
                                              const RunOptions& options);

}  // namespace etude::learn
