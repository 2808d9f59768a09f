// SPDX-License-Identifier: Apache-2.0
// A scene that is kept while a person says one sentence after another to a policy, moves things and looks on. What
// drives is Rollout, unchanged: a sentence in a fresh scene is the rollout that an evaluation makes of it.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "services/policy/policy_types.h"
#include "worker/task/episode_environment.h"
#include "worker/task/play_scene.h"
#include "worker/task/verdict.h"

namespace etude::task {

/// m that an object may be nudged by at once.
inline constexpr double kMostNudge = 0.15;
/// Control steps that a nudge takes: 0.2 s.
inline constexpr int kNudgeSteps = 25;
/// Control steps that a sentence may be given, as a campaign's rollout may.
inline constexpr int kMostSentenceSteps = 100'000;

/// What a person says, and means: the judge takes it from here, never from the policy.
struct Sentence {
  std::string text;
  std::string task;  ///< "pick", "push+others"; "": not judged, it runs to its limit or until it is stopped
  std::string target, reference;  ///< objects of the scene
  int max_steps = 0;              ///< control steps; 0: the campaign's rollout.max_steps
  bool home = true;               ///< an arm that is elsewhere first lets go and comes back to where the scene began

  bool judged() const { return !task.empty(); }
};

/// One person's session. Not thread-safe; use from the thread that opened it (GL).
class PlaySession {
 public:
  /// Called before every control step, from where everything below may be called but Open, SetScene, Place, Reset and
  /// Say. False stops.
  using Hook = std::function<bool()>;

  /// In the scene of episode `index`. Pushes and occlusion of the spec's rollouts are left out: the person does that.
  /// @error kInvalidArgument; kUnavailable: no GL; kNotFound: the episode has no scene
  static Result<std::unique_ptr<PlaySession>> Open(const CampaignSpec& spec, std::uint64_t index,
                                                   const sim::RendererConfig& renderer = {});
  ~PlaySession();

  /// The scene of an episode, with the objects of `places` where a person put them. On error the scene is as it was.
  /// @error kInvalidArgument: see PlaceUpright, against all objects of the scene; an object where the arm is, or that
  /// does not come to rest; kNotFound: the episode has no scene
  Status SetScene(std::uint64_t index, const std::vector<ObjectPlace>& places);
  /// Puts these objects elsewhere and leaves all others as they are now: moved, lying or hidden. On error every object
  /// is where it was.
  /// @error kInvalidArgument: see PlaceUpright; into another object or where the arm is, or it does not come to rest;
  /// kUnavailable: it is held or hidden, or something drives or is being moved
  Status Place(const std::vector<ObjectPlace>& places);
  /// The scene from its beginning, with what SetScene and Place put elsewhere; as its episode has it where that leaves
  /// no room. @error kNotFound: the episode has no scene
  Status Reset();

  /// Slides an object over the table by (dx, dy) m, world: at once when nothing drives, else within kNudgeSteps.
  /// @error kInvalidArgument: no such object, too far, off the table, into another one; kUnavailable: it is held or
  /// hidden, or something is being moved
  Status Nudge(const std::string& object, double dx, double dy);
  /// Takes an object out of the picture. @error kInvalidArgument: no such object; kUnavailable: it is held or hidden,
  /// or something is being moved
  Status Hide(const std::string& object);
  /// Puts it back. @error kInvalidArgument: it is not hidden; kUnavailable: something stands there
  Status Show(const std::string& object);

  /// @error kInvalidArgument: a task or object that the scene has not, a hidden one; too many steps
  Status Check(const Sentence& sentence) const;
  /// The policy drives from the present state of the world, until the judge's strict condition has held, the limit, or
  /// the hook's false; without a task to its limit, which then is no failure. A policy that does not answer, or answers
  /// what cannot be followed, ends in kPolicyError, and the scene stays.
  /// @error as Check; nothing has moved then
  Result<Verdict> Say(const Sentence& sentence, const policy::AskFunction& ask, const Hook& hook);

  /// The camera's picture of now: RGB, top row first. Valid until the next call.
  std::span<const std::uint8_t> Picture();
  const Camera& camera() const { return environment_->renderer.camera(); }
  const sim::World& world() const { return environment_->world; }
  const EpisodePlan& plan() const { return plan_; }
  bool hidden(const std::string& object) const { return hidden_.contains(object); }

  /// Of the sentence that is obeyed now, or was last.
  int step() const;
  int max_steps() const { return max_steps_; }
  /// rest | homing | driving
  std::string_view doing() const { return doing_; }
  const policy::Answer& answer() const { return answer_; }  ///< the last one; no waypoints: none yet
  double policy_ms() const { return policy_ms_; }           ///< that it took
  /// {"judged", "done", "held", "dwell", "words", "touched", "success_latched", "violations", "disturbed"}; {} before
  /// the first sentence
  OrderedJson JudgeJson() const;
  /// {"robot", "index", "seed", "camera", "objects": [{"name", "x", "y", "z", "yaw", "half_extent", "hidden"}],
  /// "table_half_m"}: as things stand now, m and rad, world
  OrderedJson SceneJson() const;

 private:
  /// The object is moved by somebody who is not in the picture.
  struct Slide {
    std::string object;
    Pose from, to;
    int step = 0, steps = 1;
  };

  PlaySession(const CampaignSpec& spec, const sim::RendererConfig& renderer);
  Result<std::vector<PlacedObject>> Arranged(const EpisodeEnvironment& in,
                                             const std::vector<ObjectPlace>& places) const;
  Status Prepare(EpisodeEnvironment& in, const EpisodePlan& plan, const std::vector<ObjectPlace>& places) const;
  void Forget();
  Status Settle(EpisodeEnvironment& in, const std::vector<PlacedObject>& objects) const;
  Result<EpisodePlan> PlanOf(const Sentence& sentence) const;
  Result<const sim::ObjectInfo*> Free(const std::string& object) const;
  Status CheckFree(const sim::ObjectInfo& object, const ObjectPlace& at,
                   const std::vector<ObjectPlace>& moved = {}) const;
  Status CheckArm(const std::string& name, const Pose& X_WO) const;
  Result<std::vector<PlacedObject>> Replaced(const std::vector<ObjectPlace>& places) const;
  Status Move(Slide slide);
  void GoOnSliding();
  void Rest(int steps);
  bool Follow(const std::vector<Waypoint>& targets, const std::vector<Eigen::Matrix<double, 6, 1>>& V,
              const Hook& hook);
  bool Straight(const Eigen::Vector3d& by, bool closed, const Hook& hook);
  bool IsHome() const;
  bool StandsOnAnother(const std::string& object) const;
  bool GoHome(const Hook& hook);
  Result<Verdict> Drive(const Sentence& sentence, const EpisodePlan& plan, const policy::AskFunction& ask,
                        const Hook& hook);

  CampaignSpec spec_;
  sim::RendererConfig renderer_config_;
  std::unique_ptr<EpisodeEnvironment> environment_;
  EpisodePlan plan_;
  std::vector<ObjectPlace> places_;
  Eigen::VectorXd home_;                // the arm where the scene began
  std::map<std::string, Pose> hidden_;  // where they stood
  std::optional<Slide> slide_;
  bool closed_ = false;               // the fingers, as commanded last
  EpisodeRunner* running_ = nullptr;  // while a sentence drives
  static constexpr std::string_view kAtRest = "rest";
  static constexpr int kPlacedSettleSteps = 50;  // control steps after something was moved
  std::string_view doing_ = kAtRest;
  int steps_ = 0, max_steps_ = 0;
  OrderedJson judged_ = OrderedJson::object();
  policy::Answer answer_;
  double policy_ms_ = 0;
  std::vector<std::uint8_t> picture_;
};

}  // namespace etude::task
