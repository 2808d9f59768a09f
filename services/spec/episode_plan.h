// SPDX-License-Identifier: Apache-2.0
// What episode `index` of a campaign is about, at one attempt: everything that is drawn before a world exists.
// Drawn once and passed on as a value, so that no two places can disagree.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "services/spec/campaign_spec.h"
#include "services/spec/episode_world.h"
#include "services/spec/sampling_weights.h"
#include "services/spec/task_name.h"

namespace etude {

/// Consecutive episodes that share one robot and one choice of objects: building a scene costs as much as an
/// episode.
inline constexpr std::uint64_t kEpisodesPerScene = 10;
/// Consecutive episodes of which AdaptiveSamplingSpec::share is the largest part that follows sampling weights.
inline constexpr std::uint64_t kSamplingBlock = 20;

/// Where the obstacle of a task "...+obstacle" stands.
enum class ObstaclePlace {
  kInTheWay,  ///< the straight way of the hand to its first goal would touch it
  kAside,     ///< that way passes it with room to spare
};

/// The streams of random numbers of one attempt. What draws from one does not move the others.
struct EpisodeSeeds {
  std::uint64_t scene = 0;        ///< places of the objects, start of the arm
  std::uint64_t light = 0;        ///< light and colours
  std::uint64_t instruction = 0;  ///< the sentence: drawn by who owns the grammar
  std::uint64_t disturbance = 0;  ///< pushes off the path
  std::uint64_t planning = 0;     ///< sampling planners: a stream for each motion
  std::uint64_t distractors = 0;  ///< places of the distractors
  std::uint64_t occlusion = 0;    ///< in which order the target is covered
  std::uint64_t pushes = 0;       ///< pushes of the target
  std::uint64_t places = 0;       ///< which places of the target are taken, where weights decide
};
/// The streams that follow from an attempt's seed.
EpisodeSeeds SeedsOf(std::uint64_t seed);

/// Scene, world, task and objects are the same for all attempts, so that a hard object is not swapped for an easy one
/// by a retry; the seeds are not.
struct EpisodePlan {
  std::uint64_t index = 0;
  std::uint32_t attempt = 0;
  std::uint64_t seed = 0;  ///< EpisodeSeed
  SceneSpec scene;         ///< robot and objects, then the obstacle, then the distractors
  TaskName task;
  std::string target;                              ///< the scene's name of the object that the task is about
  std::string reference;                           ///< relations: the object to put the target beside; else ""
  std::string sentence;                            ///< what is said, where the spec says it; "": drawn
  std::vector<std::string> avoid;                  ///< objects that the robot must not touch
  ObstaclePlace obstacle = ObstaclePlace::kAside;  ///< counts only for tasks with an obstacle
  double clearance = ObstacleSpec().clearance;     ///< m, wished from `avoid` where there is room
  std::vector<std::string> distractors;            ///< objects that only stand there: not to be touched either
  EpisodeWorld world;                              ///< how this episode looks
  bool first_draw = false;  ///< the first start that is drawn counts, whether the task can be done from it or not
  EpisodeSeeds seeds;
  std::string weights_sha256;         ///< of the sampling weights that hold for this index; "": none do
  bool follows_weights = false;       ///< whether they decided on task, target and place
  std::vector<double> place_weights;  ///< of the target's place at the start (AcceptPlace), where they did; else none

  bool has_obstacle() const { return task.avoid == "obstacle"; }
};

/// A pure function of its arguments. Tasks come round-robin by weight, a rollout's sentences in turn; the obstacle
/// stands in the way in `obstacle.in_the_way` of every 20 episodes, in a drawn order. Where sampling weights hold, at
/// most `adaptive_sampling.share` of every kSamplingBlock episodes follow them, in a drawn order too and only those for
/// training; all others are what they are without weights.
/// @param weights  that hold for `index`: the journal's (SamplingJournal::At); none before its first entry
/// @pre the spec is valid; the weights are none or pass CheckWeights
EpisodePlan PlanEpisode(const CampaignSpec& spec, std::uint64_t index, std::uint32_t attempt,
                        const SamplingWeights& weights = {});

/// For Episode::details["sampling"] where weights hold: {"weights_sha256", "follows"}.
OrderedJson SamplingDetails(const EpisodePlan& plan);
/// The weights that an episode says it was made with: their SHA-256 as in SamplingDetails; "" where it says none.
std::string WeightsOf(const OrderedJson& details);

/// PlanEpisode(...).seed, for those who need nothing else.
std::uint64_t EpisodeSeed(const CampaignSpec& spec, std::uint64_t index, std::uint32_t attempt);

}  // namespace etude
