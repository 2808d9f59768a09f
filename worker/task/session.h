// SPDX-License-Identifier: Apache-2.0
// One running attempt: steps the world, records every control step, watches the criterion.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "services/episode/episode.h"
#include "services/episode/task_name.h"
#include "worker/sim/renderer.h"
#include "worker/task/attempt.h"
#include "worker/task/criteria.h"
#include "worker/task/shapes.h"

namespace etude::task {

using Vector6 = Eigen::Matrix<double, 6, 1>;

/// What one control step does.
struct Command {
  Waypoint target;
  Vector6 V_WE = Vector6::Zero();  ///< feed-forward, m/s and rad/s
  int phase = 0;                   ///< index into Episode::stage_names
  bool supervise = true;           ///< false while a disturbance drives
};

/// Borrowed parts of an AttemptRunner.
struct SessionParts {
  sim::World* world = nullptr;
  sim::Renderer* renderer = nullptr;
  const Shapes* shapes = nullptr;
};

struct SessionConfig {
  TaskName task;
  std::string target, reference;   ///< reference: relations only, else ""
  std::vector<std::string> avoid;  ///< objects that the robot must not touch
  int image_stride = 5;
  bool record_frames = true;
  int max_steps = 1500;
};

/// Where the time of an attempt went, s. Never part of an episode.
struct Times {
  double plan = 0, step = 0, render = 0, deflate = 0;
};

/// Adds the time from its construction to its end to `sum`.
class Stopwatch {
 public:
  explicit Stopwatch(double& sum);
  ~Stopwatch();
  Stopwatch(const Stopwatch&) = delete;
  Stopwatch& operator=(const Stopwatch&) = delete;

 private:
  double& sum_;
  std::int64_t start_ns_;
};

class Session {
 public:
  /// The world is in its start state and settled.
  Session(const SessionParts& parts, const SessionConfig& config);

  /// Records the state, then applies `command` for one control step.
  /// @returns false when the attempt is over for a reason of its own: see failure().
  bool Step(const Command& command);
  /// Picture of the state now, rendered at most once a step. Valid until the next Step.
  std::span<const std::uint8_t> Picture();

  int steps() const { return episode_.steps(); }
  bool success() const { return criterion_.success(); }
  const SuccessCriterion& criterion() const { return criterion_; }
  std::vector<std::string> disturbed() const { return watch_.disturbed(); }
  /// kUnstable, kCollision or kTimeout once Step returned false, and what happened.
  AttemptOutcome failure() const { return failure_; }
  const std::string& failure_reason() const { return failure_reason_; }

  sim::World& world() { return *parts_.world; }
  const Shapes& shapes() const { return *parts_.shapes; }
  const SessionConfig& config() const { return config_; }
  Times& times() { return times_; }
  /// The record so far; identity and meaning are the caller's to fill in.
  Episode& episode() { return episode_; }

 private:
  void PrepareTracks();
  void RecordState();
  void RecordCommand(const Command& command);
  void RecordFrame();
  void ObserveCriterion();
  /// What touches something to be avoided, or "".
  std::string Collision() const;

  SessionParts parts_;
  SessionConfig config_;
  SuccessCriterion criterion_;
  DisturbanceWatch watch_;
  Episode episode_;
  Times times_;
  AttemptOutcome failure_ = AttemptOutcome::kSuccess;
  std::string failure_reason_;
  std::vector<std::uint8_t> picture_;
  int pictured_step_ = -1;
};

}  // namespace etude::task
