// SPDX-License-Identifier: Apache-2.0
// What to collect or to evaluate. Episode i of a campaign is a pure function of (spec, i).
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "services/core/config.h"
#include "services/core/result.h"
#include "services/spec/adaptive_sampling.h"
#include "services/spec/suite_spec.h"
#include "services/spec/world_randomization.h"
#include "services/spec/world_spec.h"

namespace etude {

struct CameraSpec {
  int width = 224;                              ///< px
  int height = 224;                             ///< px
  double fovy_deg = 60;                         ///< vertical field of view
  std::vector<double> position{0.0, 1.5, 1.0};  ///< m, world
  std::vector<double> euler{-1.0, 0.0, 3.14};   ///< rad, rxyz

  bool operator==(const CameraSpec&) const = default;
  void Visit(auto& v) {
    v("width", width, "px", "width of the pictures");
    v("height", height, "px", "height of the pictures");
    v("fovy_deg", fovy_deg, "deg", "vertical field of view");
    v("position", position, "m", "where the camera is, world");
    v("euler", euler, "rad", "how it is turned, rxyz; it looks along its -z");
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
  WorldRandomizationSpec world;           ///< everything else that one sees

  void Visit(auto& v) {
    v("yaw", yaw, "rad", "every object is turned about the vertical by up to +- this");
    v("start_position", start_position, "m", "the hand's start is moved by up to +- this along each axis");
    v("start_orientation", start_orientation, "rad", "the hand's start is turned by up to +- this about each axis");
    v("disturbance", disturbance, "m", "size of a disturbance that the expert recovers from");
    v("disturbance_probability", disturbance_probability, "-", "of a disturbance in each motion stage");
    v("light", light, "-", "relative change of light and colour");
    v("world", world, "", "everything else that one sees");
  }
};

/// Only for tasks "...+obstacle", and `clearance` for "...+others" too.
struct ObstacleSpec {
  double in_the_way = 0.5;  ///< share of the scenes in which it blocks the straight way to the target
  double clearance = 0.05;  ///< m, that demonstrations wish to keep from what is to be avoided, where there is room

  void Visit(auto& v) {
    v("in_the_way", in_the_way, "-", "share of the scenes in which the obstacle blocks the straight way to the target");
    v("clearance", clearance, "m",
      "that demonstrations wish to keep from what is to be avoided, where there is room: what a policy errs by takes "
      "off it");
  }
};

/// Only for mode "rollout": a policy drives instead of the expert.
struct RolloutSpec {
  std::string run;  ///< policy to ask: name of the run whose checkpoints it serves
  /// Control steps between two questions to the policy, but where the hand goes nowhere (worker/task/standstill.h).
  /// Long enough for what an answer announces to come: a policy without memory that sees the same hand on the same
  /// table announces the same release again.
  int replan_steps = 30;
  int max_steps = 1500;  ///< control steps until the rollout counts as a failure
  bool record = true;    ///< keep the frames (for videos)
  /// From the picture to the moment its answer takes effect; the simulation goes on meanwhile, rounded up to control
  /// steps. -1: the 99th percentile that the policy server measured.
  double latency_ms = -1;
  /// How an answer is followed. tracked: by its waypoints, until the one asked replan_steps later | authors: as the
  /// paper's evaluation does, one pose of it held for 0.36 s, no time passing while the policy thinks, and as many
  /// decisions as theirs (replan_steps, max_steps and latency_ms do not count).
  std::string execution = "tracked";
  /// Share of the target's pixels that the policy does not see: grey blocks lie over them, 0..1.
  double occlude = 0;
  TargetPushSpec pushes;
  /// Spoken in turn, one a rollout, each in a scene of what it means; empty: every sentence is drawn from the task's
  /// templates. Tasks and targets then are the sentences', and task_weights do not count.
  std::vector<SentenceSpec> sentences;

  void Visit(auto& v) {
    v("run", run, "", "policy to ask: the run whose checkpoints it serves");
    v("replan_steps", replan_steps, "steps of 8 ms", "control steps between two questions to the policy");
    v("max_steps", max_steps, "steps of 8 ms", "control steps until the rollout counts as a failure");
    v("record", record, "", "keep the frames, for videos");
    v("latency_ms", latency_ms, "ms", "from a picture to its answer taking effect; -1 is the p99 of the server");
    v("execution", execution, "", "tracked: all waypoints of an answer | authors: one of them, held as in the paper");
    v("occlude", occlude, "-", "share of the target's pixels under grey blocks of 8 x 8 px, in every picture; 0: none");
    v("pushes", pushes, "", "the target slid away before it is touched");
    v("sentences", sentences, "", "spoken in turn, each in a scene of what it means; none: from the task's templates");
  }
};

/// Shares of train, valid and test. Whole numbers are counts: {1600, 400, 400} splits 2400 episodes exactly, and
/// every further block of six 4:1:1. With fractions each episode is drawn by itself: counts are near them.
struct SplitSpec {
  double train = 0.9;
  double valid = 0.1;
  double test = 0.0;

  void Visit(auto& v) {
    v("train", train, "-", "share of the training split; whole numbers are counts");
    v("valid", valid, "-", "share of the validation split");
    v("test", test, "-", "share of the test split");
  }
};

struct CampaignSpec {
  std::string name = "campaign";     ///< plain name, also the DDS partition
  std::string mode = "demonstrate";  ///< demonstrate | rollout
  /// Each a known robot or the path of a robot file (.yaml). Taken in turn, kEpisodesPerScene episodes each.
  std::vector<std::string> robots{"ur5"};
  std::vector<std::string> tasks{"pick", "push", "put_down"};  ///< see services/spec/task_name.h
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
  /// A worker that beats but says no progress of its attempt for so long loses its lease, s.
  double stall_timeout_s = 120;
  /// What hosts must agree in: bytes (all that an episode depends on) | physics (pictures may differ) | none.
  std::string determinism = "bytes";
  /// Share of the episodes that are made again by a worker of another host and compared byte for byte with what was
  /// committed: 0 to 1, mode demonstrate with determinism bytes only. Which ones follows from (seed, index).
  double recheck = 0;
  /// Who draws the pictures. software: the same bytes on every host, whatever GPU it has | gpu: each host's GPU, and a
  /// host without one is an error; pictures are then those of its model and driver.
  std::string renderer = "software";
  int device = -1;  ///< with renderer gpu: the number that a host's EGL gives to one of its GPUs; -1: any
  /// feasible: a start is drawn anew until the expert's feasibility check passes | first_draw: the first one is taken,
  /// and one that the expert cannot do is an attempt "scene_invalid".
  std::string scenes = "feasible";
  CameraSpec camera;
  RandomizationSpec randomization;
  ObstacleSpec obstacle;
  RolloutSpec rollout;
  SplitSpec split;
  WorldSpec world;
  AdaptiveSamplingSpec adaptive_sampling;  ///< mode demonstrate only

  void Visit(auto& v) {
    v("name", name, "", "plain name (a-z, 0-9, _ and -), also on the bus");
    v("mode", mode, "", "demonstrate: the expert drives | rollout: a policy drives");
    v("robots", robots, "", "known robots or robot files (.yaml), taken in turn");
    v("tasks", tasks, "", "tasks, taken in turn by their weights");
    v("task_weights", task_weights, "-", "relative frequency of each task; none: all the same");
    v("objects", objects, "", "objects that may stand on the table");
    v("objects_per_scene", objects_per_scene, "-", "how many of them stand there; 0: all");
    v("episodes", episodes, "-", "how many episodes to commit");
    v("seed", seed, "-", "what everything random is drawn from");
    v("image_stride", image_stride, "steps of 8 ms", "control steps between two pictures; 1 as the paper has it");
    v("max_attempts", max_attempts, "-", "attempts at an episode until it is given up and counted");
    v("stall_timeout_s", stall_timeout_s, "s", "a worker whose attempt does not move for so long loses its lease");
    v("determinism", determinism, "", "what hosts must agree in: bytes | physics: pictures may differ | none");
    v("recheck", recheck, "-", "share of the episodes that another host makes again, to compare bytes; 0: none");
    v("renderer", renderer, "", "software: the same pictures on every host | gpu: a GPU of each host draws");
    v("device", device, "-", "with renderer gpu: which of a host's GPUs, by the number that EGL gives it; -1: any");
    v("scenes", scenes, "", "feasible: drawn anew until the expert can do the task | first_draw: taken as they come");
    v("camera", camera, "", "the camera that takes the pictures");
    v("randomization", randomization, "", "what is drawn for each episode");
    v("obstacle", obstacle, "", "of tasks with +obstacle");
    v("rollout", rollout, "", "how a policy drives, in mode rollout");
    v("split", split, "", "which episodes are for training, validation and test");
    v("world", world, "", "table, lights, friction and delays");
    v("adaptive_sampling", adaptive_sampling, "", "episodes that a training asks for");
  }

  /// Ranges and names; all problems at once, with the nearest known name. A robot may be a file, an object generated.
  Status Validate() const;
};

/// What one compiled scene is made of.
struct SceneSpec {
  std::string robot = "ur5";
  std::vector<std::string> objects = CampaignSpec{}.objects;
  CameraSpec camera;
  WorldSpec world;
  std::vector<std::string> tables;  ///< compiled in beside world.table, so that an episode may have one of them
  bool backdrop = false;            ///< whether an episode may have another colour behind the table

  bool operator==(const SceneSpec&) const = default;
  SceneSpec() = default;
  /// The first robot with all objects.
  explicit SceneSpec(const CampaignSpec& spec);
};

/// SHA-256 of what an episode's bytes depend on: kContentVersion and the resolved spec without name, episodes, split,
/// max_attempts, stall_timeout_s, determinism, recheck and device (hosts number their GPUs as they like), so that a
/// campaign may be extended and still match what it has collected. Keys that came later (renderer, randomization.world,
/// rollout's occlude, pushes and sentences, adaptive_sampling) count only where they are set, so that older campaigns
/// go on. With adaptive sampling the split counts: only episodes for training follow its weights. Of rollouts
/// kRolloutVersion counts, too.
std::string SpecHash(const CampaignSpec& spec);

/// Episodes after which whole numbers in `split` are met exactly, and again after each such block: their sum over
/// their greatest common divisor. 0 when they are fractions (or the block would be longer than 10^4), so that
/// SplitOf draws.
std::uint64_t SplitBlock(const SplitSpec& split);

/// train | valid | test of episode `index`, a function of (seed, index): stable while a campaign grows.
std::string SplitOf(const CampaignSpec& spec, std::uint64_t index);

}  // namespace etude
