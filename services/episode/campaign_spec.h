// SPDX-License-Identifier: Apache-2.0
// What to collect or to evaluate. Episode i of a campaign is a pure function of (spec, i).
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "services/core/config.h"
#include "services/core/result.h"
#include "services/episode/world_spec.h"

namespace etude {

struct CameraSpec {
  int width = 224;                              ///< px
  int height = 224;                             ///< px
  double fovy_deg = 60;                         ///< vertical field of view
  std::vector<double> position{0.0, 1.5, 1.0};  ///< m, world
  std::vector<double> euler{-1.0, 0.0, 3.14};   ///< rad, rxyz

  bool operator==(const CameraSpec&) const = default;
  template <class V>
  void Visit(V& v) {
    v("width", width);
    v("height", height);
    v("fovy_deg", fovy_deg);
    v("position", position);
    v("euler", euler);
  }
};

/// All draws are uniform and come from the episode's seed. 0 switches one off.
struct RandomizationSpec {
  double yaw = 0.3;                       ///< +- rad, every object about the vertical
  double start_position = 0.08;           ///< +- m per axis, of the hand's start
  double start_orientation = 0.15;        ///< +- rad per axis, of the hand's start
  double disturbance = 0.03;              ///< m, size of a push off the path that the expert recovers from
  double disturbance_probability = 0.35;  ///< per motion stage
  double light = 0.0;                     ///< relative change of light and colour

  template <class V>
  void Visit(V& v) {
    v("yaw", yaw);
    v("start_position", start_position);
    v("start_orientation", start_orientation);
    v("disturbance", disturbance);
    v("disturbance_probability", disturbance_probability);
    v("light", light);
  }
};

/// Only for tasks "...+obstacle".
struct ObstacleSpec {
  double in_the_way = 0.5;  ///< share of the scenes in which it blocks the straight way to the target

  template <class V>
  void Visit(V& v) {
    v("in_the_way", in_the_way);
  }
};

/// Only for mode "rollout": a policy drives instead of the expert.
struct RolloutSpec {
  std::string run;        ///< policy to ask: name of the run whose checkpoints it serves
  int replan_steps = 15;  ///< control steps between two questions to the policy
  int max_steps = 1500;   ///< control steps until the rollout counts as a failure
  bool record = true;     ///< keep the frames (for videos)

  template <class V>
  void Visit(V& v) {
    v("run", run);
    v("replan_steps", replan_steps);
    v("max_steps", max_steps);
    v("record", record);
  }
};

/// Shares of train, valid and test. Whole numbers are counts: {1600, 400, 400} splits 2400 episodes exactly, and
/// every further block of six 4:1:1. With fractions each episode is drawn by itself: counts are near them.
struct SplitSpec {
  double train = 0.9;
  double valid = 0.1;
  double test = 0.0;

  template <class V>
  void Visit(V& v) {
    v("train", train);
    v("valid", valid);
    v("test", test);
  }
};

struct CampaignSpec {
  std::string name = "campaign";     ///< plain name, also the DDS partition
  std::string mode = "demonstrate";  ///< demonstrate | rollout
  /// Each a known robot or the path of a robot file (.yaml). Taken in turn, kEpisodesPerScene episodes each.
  std::vector<std::string> robots{"ur5"};
  std::vector<std::string> tasks{"pick", "push", "put_down"};  ///< see services/episode/task_name.h
  /// Relative frequency of each task, same length as tasks; empty = equal. Episode i's task is taken
  /// round-robin by these weights, so that counts are exact (32/24/24 for weights 4/3/3 of 80).
  std::vector<double> task_weights;
  std::vector<std::string> objects{"cube", "coke", "pepsi", "milk", "bread", "bottle"};
  /// How many of `objects` stand on the table; 0 all of them. Others are drawn every kEpisodesPerScene episodes.
  int objects_per_scene = 0;
  std::uint64_t episodes = 100;
  std::uint64_t seed = 1;
  int image_stride = 5;   ///< control steps per frame; 1 reproduces the paper
  int max_attempts = 10;  ///< per index; then the index is given up and counted
  CameraSpec camera;
  RandomizationSpec randomization;
  ObstacleSpec obstacle;
  RolloutSpec rollout;
  SplitSpec split;
  WorldSpec world;

  template <class V>
  void Visit(V& v) {
    v("name", name);
    v("mode", mode);
    v("robots", robots);
    v("tasks", tasks);
    v("task_weights", task_weights);
    v("objects", objects);
    v("objects_per_scene", objects_per_scene);
    v("episodes", episodes);
    v("seed", seed);
    v("image_stride", image_stride);
    v("max_attempts", max_attempts);
    v("camera", camera);
    v("randomization", randomization);
    v("obstacle", obstacle);
    v("rollout", rollout);
    v("split", split);
    v("world", world);
  }

  /// Ranges and names; all problems at once. Robots, tasks and objects are checked against `known`.
  Status Validate() const;
};

/// Consecutive episodes that share one robot and one choice of objects: building a scene costs as much as an
/// episode.
inline constexpr std::uint64_t kEpisodesPerScene = 10;

/// What one compiled scene is made of.
struct SceneSpec {
  std::string robot = "ur5";
  std::vector<std::string> objects = CampaignSpec{}.objects;
  CameraSpec camera;
  WorldSpec world;

  bool operator==(const SceneSpec&) const = default;
  SceneSpec() = default;
  /// The first robot with all objects.
  explicit SceneSpec(const CampaignSpec& spec);
};

/// The scene of episode `index`, its obstacle last; the same for all attempts.
SceneSpec SceneOf(const CampaignSpec& spec, std::uint64_t index);

/// SHA-256 of what an episode's bytes depend on: the resolved spec without name, episodes, split and
/// max_attempts, so that a campaign may be extended and still match what it has collected.
std::string SpecHash(const CampaignSpec& spec);

std::uint64_t EpisodeSeed(const CampaignSpec& spec, std::uint64_t index, std::uint32_t attempt);

/// Which object episode `index` is about, and for a relation which other one it refers to (else ""): the same
/// for all attempts, so that a hard object is not swapped for an easy one by a retry.
std::string TargetOf(const CampaignSpec& spec, std::uint64_t index);
std::string ReferenceOf(const CampaignSpec& spec, std::uint64_t index);

/// The task of episode `index` (round-robin by weight, the same for all attempts).
std::string TaskOf(const CampaignSpec& spec, std::uint64_t index);

/// Episodes after which whole numbers in `split` are met exactly, and again after each such block: their sum over
/// their greatest common divisor. 0 when they are fractions (or the block would be longer than 10^4), so that
/// SplitOf draws.
std::uint64_t SplitBlock(const SplitSpec& split);

/// train | valid | test of episode `index`, a function of (seed, index): stable while a campaign grows.
std::string SplitOf(const CampaignSpec& spec, std::uint64_t index);

}  // namespace etude
