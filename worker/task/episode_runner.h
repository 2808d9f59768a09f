// SPDX-License-Identifier: Apache-2.0
// One running attempt: steps the world, records every control step, lets the judge see it.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "services/codec/frames.h"
#include "services/episode/episode.h"
#include "services/spec/episode_plan.h"
#include "worker/sim/renderer.h"
#include "worker/task/geometry/scene_geometry.h"
#include "worker/task/judge.h"
#include "worker/task/verdict.h"

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
struct EpisodeParts {
  sim::World* world = nullptr;
  sim::Renderer* renderer = nullptr;
  const SceneGeometry* shapes = nullptr;
  collide::Checker* checker = nullptr;
};

/// What is recorded, and for how long at most.
struct RecordConfig {
  int image_stride = 5;  ///< control steps per frame
  bool record_frames = true;
  int max_steps = 1500;                                      ///< control steps
  std::function<void(const sim::World&)> observe = nullptr;  ///< called with every state that is recorded
  /// Called before every control step: how far it is.
  std::function<void(std::string_view stage, int step)> progress = nullptr;
  /// Asked before every control step, where it may move things too; false ends the attempt there, as kStopped.
  std::function<bool()> go_on = nullptr;
  /// Changes every picture after it is rendered, as it is recorded and as a policy gets it: RGB, top row first.
  std::function<void(std::span<std::uint8_t>)> retouch = nullptr;
};

/// Where the time of an attempt went, s. Never part of an episode.
struct Times {
  double plan = 0, step = 0, render = 0, deflate = 0;
};

class EpisodeRunner {
 public:
  /// @pre the world is in the start state of `plan` and settled
  /// @error kInvalidArgument: the task's criteria do not fit the scene
  static Result<EpisodeRunner> Open(const EpisodeParts& parts, const EpisodePlan& plan, const RecordConfig& config);

  /// Records the state, then applies `command` for one control step.
  /// @returns false when the attempt is over for a reason of its own: see failure().
  bool Step(const Command& command);
  /// The next Step slides this object, see World::Guide; the judge takes where it comes to as where it stood.
  void PushObject(const std::string& object, const Pose& X_WO, const Eigen::Vector3d& v_WO);
  /// Picture of the state now, rendered at most once a step. Valid until the next Step.
  std::span<const std::uint8_t> Picture();

  int steps() const { return episode_.steps(); }
  const Judge& judge() const { return judge_; }
  /// kUnstable, kTimeout or kStopped once Step returned false, and what happened.
  AttemptOutcome failure() const { return failure_; }
  const std::string& failure_reason() const { return failure_reason_; }

  sim::World& world() { return *parts_.world; }
  const SceneGeometry& shapes() const { return *parts_.shapes; }
  const EpisodePlan& plan() const { return plan_; }
  Times& times() { return times_; }
  /// The record so far, without its pictures; identity and meaning are the caller's to fill in.
  Episode& episode() { return episode_; }
  /// The record, whole. Call once, last.
  Episode TakeEpisode();

 private:
  EpisodeRunner(const EpisodeParts& parts, const EpisodePlan& plan, const RecordConfig& config, Judge judge);
  void PrepareTracks();
  void RecordState();
  void RecordCommand(const Command& command);
  void RecordFrame();

  EpisodeParts parts_;
  EpisodePlan plan_;
  RecordConfig config_;
  Judge judge_;
  Episode episode_;
  codec::FrameDeflater frames_;
  Times times_;
  AttemptOutcome failure_ = AttemptOutcome::kSuccess;
  std::string failure_reason_;
  std::vector<std::uint8_t> picture_;
  int pictured_step_ = -1;
  std::string pushed_;  // object that the next Step slides; "": none
};

}  // namespace etude::task
