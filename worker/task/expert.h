// SPDX-License-Identifier: Apache-2.0
// The expert: plans the stages of a task one after another and plays them.
#pragma once

#include <string>
#include <vector>

#include "worker/task/disturbance.h"
#include "worker/task/episode_runner.h"
#include "worker/task/primitives/stage.h"
#include "worker/task/stage_planner.h"
#include "worker/task/trace.h"

namespace etude::task {

/// Plays one attempt. Its plans and pushes are functions of the plan's seeds and the world's state.
class Expert {
 public:
  Expert(EpisodeRunner* runner, StagePlanner* planner, collide::Checker* checker,
         const RandomizationSpec& randomization);

  /// Appends each motion that is begun from now on, for replays. `motions` outlives this.
  void KeepMotions(std::vector<PlayedMotion>* motions) { motions_ = motions; }
  /// Runs all stages; says where and why it stopped.
  Verdict Run();
  /// How each stage that was played was planned, and the pushes: for Episode::details. No timings.
  OrderedJson Statistics() const;

 private:
  struct MotionSegment {  // a run of stages that is played without stopping
    plan::Motion motion;
    std::vector<int> stage;                // per step
    std::vector<Eigen::Vector3d> goal;     // of each stage, by index - first
    int first = 0, last = 0;               // stages
    std::vector<Eigen::Vector3d> avoided;  // where what has to be avoided was when it was planned
    std::vector<OrderedJson> planned;      // how, by index - first
  };
  struct Interruption {
    int at = -1;  // step of the segment; -1: none
    plan::Motion motion;
  };

  std::uint64_t NextPlanSeed();
  OrderedJson PlannedJson(int stage, const PlannedStage& planned) const;
  /// Counts how the stages of `segment` up to `last` were planned: they are begun now.
  void KeepPlanned(const MotionSegment& segment, int last);
  void KeepMotion(const plan::Motion& motion, int first, int last, bool disturbance);
  void UpdateChecker(const Stage& stage);
  StageContext Now() const;
  Verdict PlanSegment(int first, MotionSegment& segment);
  /// One try. @param by_field  whether stages with a clearance go down the potential field
  Verdict TrySegment(int first, bool by_field, MotionSegment& segment);
  Verdict PlaySegment(const MotionSegment& segment, int& next_stage);
  /// Whether fingers that have to close would touch something on their way if the arm set off at once.
  bool FingersInTheWay(const MotionSegment& segment);
  /// Waits for them where that is so.
  Verdict CloseFirst(const MotionSegment& segment);
  Interruption DrawInterruption(const MotionSegment& segment);
  /// A push off `path` from step `at` on, as slow as the joints need it; nothing when there is none.
  std::optional<plan::Motion> FeasiblePush(const plan::Motion& path, int at, const Stage& stage);
  Verdict PlayWait(int stage);
  Verdict PlayStep(int stage, const Pose& X_WE, const Vector6& V_WE, bool supervise);
  Verdict AfterWait(int stage);
  Verdict Settle(int stage, const Pose& goal);
  Verdict Check(int stage) const;
  /// Holds the last command until the judge has seen the strict condition for its dwell.
  Verdict Dwell();
  Verdict Stopped(int stage) const;
  Surroundings Around(const StageContext& now) const;
  std::vector<Eigen::Vector3d> AvoidedPlaces() const;
  /// Plans the rest of `stage` anew when something that has to be avoided moved into the way. `rest` gets it.
  Verdict AvoidWhatMoved(const MotionSegment& segment, int step, std::optional<MotionSegment>& rest);

  EpisodeRunner* runner_;
  StagePlanner* planner_;
  collide::Checker* checker_;
  RandomizationSpec randomization_;
  Rng push_rng_;
  std::vector<Stage> stages_;
  std::vector<bool> push_drawn_;  // by stage: whether its one chance of a push is used up
  Pose reference_;                // last commanded pose
  std::vector<PlayedMotion>* motions_ = nullptr;
  std::optional<Pose> X_EO_;  // while held
  int plans_ = 0, pushes_ = 0, replans_ = 0, abandoned_ = 0;
  OrderedJson planned_ = OrderedJson::array();
};

}  // namespace etude::task
