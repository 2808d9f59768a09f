// SPDX-License-Identifier: Apache-2.0
#include "services/spec/episode_plan.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>
#include <set>

#include "services/core/check.h"
#include "services/core/rng.h"
#include "services/spec/object_names.h"
#include "services/spec/task_roles.h"

namespace etude {
namespace {

constexpr std::uint64_t kObstacleBlock = 20;     // episodes after which the share of obstacles in the way is exact
constexpr std::uint64_t kLongestPattern = 1000;  // of weighted tasks

// Episodes after which the tasks' turns begin anew: once every task's share is a whole number.
std::uint64_t TaskRound(const CampaignSpec& spec) {
  if (spec.task_weights.empty()) return spec.tasks.size();
  const double total = std::accumulate(spec.task_weights.begin(), spec.task_weights.end(), 0.0);
  constexpr double kWhole = 1e-6;
  for (std::uint64_t round = 1; round < kLongestPattern; ++round)
    if (std::ranges::all_of(spec.task_weights, [&](double weight) {
          const double count = weight / total * static_cast<double>(round);
          return std::abs(count - std::round(count)) < kWhole;
        }))
      return round;
  return kLongestPattern;
}

std::string DrawTask(const CampaignSpec& spec, std::uint64_t index) {
  ETUDE_CHECK(!spec.tasks.empty());
  if (spec.task_weights.empty()) return spec.tasks[index % spec.tasks.size()];

  // Largest deficit first (as in smooth weighted round-robin): after any prefix, every task's count is
  // within one of its share. The pattern repeats after TaskRound, but
  // for ties that rounding decides; kLongestPattern is a bound.
  double total = 0;
  for (double weight : spec.task_weights) total += weight;
  std::vector<double> credit(spec.tasks.size(), 0.0);
  std::size_t chosen = 0;
  for (std::uint64_t i = 0; i <= index % kLongestPattern; ++i) {
    for (std::size_t k = 0; k < credit.size(); ++k) credit[k] += spec.task_weights[k] / total;
    chosen = static_cast<std::size_t>(std::max_element(credit.begin(), credit.end()) - credit.begin());
    credit[chosen] -= 1.0;
  }
  return spec.tasks[chosen];
}

// Whether the weights decide on this episode. Validation and test stay as they are: what they measure must not move
// with what is asked for.
bool FollowsWeights(const CampaignSpec& spec, std::uint64_t index, const SamplingWeights& weights) {
  if (weights.empty() || SplitOf(spec, index) != "train") return false;
  std::vector<std::uint64_t> order(kSamplingBlock);
  std::iota(order.begin(), order.end(), std::uint64_t{0});
  Rng rng(MixSeed({spec.seed, index / kSamplingBlock}, "adaptive sampling"));
  rng.Shuffle(order);
  constexpr double kSlack = 1e-9;  // 0.15 * 20 may be a little less than 3
  return order[index % kSamplingBlock] <
         static_cast<std::uint64_t>(spec.adaptive_sampling.share * kSamplingBlock + kSlack);
}

double WeightOf(const std::map<std::string, double>& weights, const std::string& name) {
  const auto it = weights.find(name);
  ETUDE_CHECK(it != weights.end(), "no sampling weight of '{}'", name);
  return it->second;
}

// The task of an episode that follows weights: they multiply the campaign's own.
std::string DrawWeightedTask(const CampaignSpec& spec, std::uint64_t index, const SamplingWeights& weights) {
  std::vector<double> each;
  for (std::size_t k = 0; k < spec.tasks.size(); ++k)
    each.push_back(WeightOf(weights.tasks, spec.tasks[k]) * (spec.task_weights.empty() ? 1.0 : spec.task_weights[k]));
  Rng rng(MixSeed({spec.seed, index}, "weighted task"));
  return spec.tasks[DrawWeighted(each, rng)];
}

// The objects on the table, in the order of the spec.
std::vector<std::string> DrawObjects(const CampaignSpec& spec, const TaskSpec& task, std::uint64_t index) {
  if (spec.objects_per_scene == 0) return spec.objects;
  Rng rng(MixSeed({spec.seed, index / kEpisodesPerScene}, "objects"));
  std::vector<std::size_t> order(spec.objects.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  rng.Shuffle(order);
  // a sentence names a class: one instance of each at most
  std::set<std::string> classes;
  std::erase_if(order, [&](std::size_t i) { return !classes.insert(ObjectNoun(spec.objects[i])).second; });
  order.resize(std::min(order.size(), static_cast<std::size_t>(spec.objects_per_scene)));
  std::sort(order.begin(), order.end());
  std::vector<std::string> objects;
  for (const std::size_t i : order) objects.push_back(spec.objects[i]);
  return WithReference(task, std::move(objects), spec.objects);
}

// The sentence that episode `index` is about; nullptr where none is written down.
const SentenceSpec* SentenceOf(const CampaignSpec& spec, std::uint64_t index) {
  const auto& sentences = spec.rollout.sentences;
  if (spec.mode != "rollout" || sentences.empty()) return nullptr;
  return &sentences[index % sentences.size()];
}

// Where `chosen` goes: in place of another instance of its class, else of the last object that nobody speaks of.
std::vector<std::string>::iterator PlaceFor(const std::string& chosen, const SentenceSpec& sentence,
                                            std::vector<std::string>& drawn) {
  const auto same_class = [&](const auto& object) { return ObjectNoun(object) == ObjectNoun(chosen); };
  if (const auto it = std::ranges::find_if(drawn, same_class); it != drawn.end()) return it;
  const auto unspoken = [&](const auto& object) {
    return !IsNamed(object, sentence.object) && !IsNamed(object, sentence.reference);
  };
  const auto last = std::find_if(drawn.rbegin(), drawn.rend(), unspoken);
  ETUDE_CHECK(last != drawn.rend(), "sentence='{}'", sentence.text);
  return std::prev(last.base());
}

// `drawn` with what the sentence names put in place of others, where it is not among them.
std::vector<std::string> WithNamed(std::vector<std::string> drawn, const SentenceSpec& sentence,
                                   const CampaignSpec& spec, std::uint64_t index) {
  Rng rng(MixSeed({spec.seed, index}, "named"));
  for (const std::string& name : {sentence.object, sentence.reference}) {
    const auto named = [&](const std::string& object) { return IsNamed(object, name); };
    if (name.empty() || std::ranges::any_of(drawn, named)) continue;
    std::vector<std::string> candidates;
    std::ranges::copy_if(spec.objects, std::back_inserter(candidates), named);
    ETUDE_CHECK(!candidates.empty(), "object={}", name);
    const std::string& chosen = candidates[rng.Below(candidates.size())];
    *PlaceFor(chosen, sentence, drawn) = chosen;
  }
  return drawn;
}

// The scene's name of what a sentence calls `name`.
std::string NamedIn(const std::vector<std::string>& objects, const std::string& name) {
  const auto it = std::ranges::find_if(objects, [&](const auto& object) { return IsNamed(object, name); });
  ETUDE_CHECK(it != objects.end(), "object={}", name);
  return SceneName(*it);
}

// One of `objects`, as the scene calls it.
std::string DrawObject(const std::vector<std::string>& objects, std::uint64_t seed) {
  ETUDE_CHECK(!objects.empty());
  Rng rng(seed);
  return SceneName(objects[rng.Below(objects.size())]);
}

// One of those that may be the target.
std::string DrawTarget(const CampaignSpec& spec, const std::vector<std::string>& candidates,
                       const SamplingWeights& weights, const EpisodePlan& plan) {
  if (!plan.follows_weights) return DrawObject(candidates, MixSeed({spec.seed, plan.index}, "target"));
  std::vector<double> each;
  for (const auto& object : candidates) each.push_back(WeightOf(weights.objects, ObjectNoun(object)));
  Rng rng(MixSeed({spec.seed, plan.index}, "weighted target"));
  return SceneName(candidates[DrawWeighted(each, rng)]);
}

ObstaclePlace DrawObstaclePlace(const CampaignSpec& spec, std::uint64_t index) {
  std::vector<int> order(kObstacleBlock);
  std::iota(order.begin(), order.end(), 0);
  Rng rng(MixSeed({spec.seed, index / kObstacleBlock}, "obstacle"));
  rng.Shuffle(order);
  const bool in_the_way = order[index % kObstacleBlock] + 0.5 < spec.obstacle.in_the_way * kObstacleBlock;
  return in_the_way ? ObstaclePlace::kInTheWay : ObstaclePlace::kAside;
}

}  // namespace

std::uint64_t EpisodeSeed(const CampaignSpec& spec, std::uint64_t index, std::uint32_t attempt) {
  return MixSeed({spec.seed, index, attempt}, "episode");
}

EpisodeSeeds SeedsOf(std::uint64_t seed) {
  return {.scene = MixSeed({seed}, "scene"),
          .light = MixSeed({seed}, "light"),
          .instruction = MixSeed({seed}, "language"),
          .disturbance = MixSeed({seed}, "push"),
          .planning = MixSeed({seed}, "planning"),
          .distractors = MixSeed({seed}, "distractor places"),
          .occlusion = MixSeed({seed}, "occlusion"),
          .pushes = MixSeed({seed}, "target pushes"),
          .places = MixSeed({seed}, "target places")};
}

namespace {

// The robots in turn. Where their rounds and those of the tasks (or sentences) end together, the next round begins with
// another robot: else each of them would never meet some.
const std::string& RobotOf(const CampaignSpec& spec, std::uint64_t index) {
  const std::uint64_t things = SentenceOf(spec, index) ? spec.rollout.sentences.size() : TaskRound(spec);
  const std::uint64_t robots = spec.robots.size(), round = robots * kEpisodesPerScene;
  const bool together = std::gcd(things, round) > kEpisodesPerScene;
  const std::uint64_t rounds = together ? index / std::lcm(things, round) : 0;
  return spec.robots[(index / kEpisodesPerScene + rounds) % robots];
}

// What follows from task, target and reference, and from the index alone.
void FillScene(const CampaignSpec& spec, const std::vector<std::string>& objects, EpisodePlan& plan) {
  plan.scene = SceneSpec(spec);
  plan.scene.robot = RobotOf(spec, plan.index);
  plan.scene.objects = objects;
  if (plan.has_obstacle()) plan.scene.objects.push_back(kObstacleObject);
  plan.distractors = DrawDistractors(spec, plan.index);
  plan.scene.objects.insert(plan.scene.objects.end(), plan.distractors.begin(), plan.distractors.end());
  plan.world = DrawWorld(spec, plan.index, SceneNames(plan.scene.objects));
  plan.obstacle = DrawObstaclePlace(spec, plan.index);
  plan.clearance = spec.obstacle.clearance;
  plan.first_draw = spec.scenes == "first_draw";
  plan.avoid = AvoidedObjects(plan.task, plan.target, plan.reference, plan.scene.objects);
}

}  // namespace

EpisodePlan PlanEpisode(const CampaignSpec& spec, std::uint64_t index, std::uint32_t attempt,
                        const SamplingWeights& weights) {
  EpisodePlan plan{.index = index, .attempt = attempt, .seed = EpisodeSeed(spec, index, attempt)};
  plan.seeds = SeedsOf(plan.seed);
  plan.weights_sha256 = WeightsSha256(weights);
  plan.follows_weights = FollowsWeights(spec, index, weights);
  if (plan.follows_weights) plan.place_weights = weights.places;

  const SentenceSpec* const sentence = SentenceOf(spec, index);
  const std::string task_text = sentence               ? sentence->task
                                : plan.follows_weights ? DrawWeightedTask(spec, index, weights)
                                                       : DrawTask(spec, index);
  const auto task = ParseTask(task_text);
  ETUDE_CHECK(task, "task={}", task_text);
  plan.task = *task;
  std::vector<std::string> objects = DrawObjects(spec, *task->spec, index);
  if (sentence) {
    objects = WithNamed(std::move(objects), *sentence, spec, index);
    plan.sentence = sentence->text;
    plan.target = NamedIn(objects, sentence->object);
    if (plan.task.relation()) plan.reference = NamedIn(objects, sentence->reference);
  } else {
    plan.target = DrawTarget(spec, PossibleTargets(*task->spec, objects), weights, plan);
    if (plan.task.relation())
      plan.reference =
          DrawObject(PossibleReferences(*task->spec, plan.target, objects), MixSeed({spec.seed, index}, "reference"));
  }
  FillScene(spec, objects, plan);
  return plan;
}

OrderedJson SamplingDetails(const EpisodePlan& plan) {
  return {{"weights_sha256", plan.weights_sha256}, {"follows", plan.follows_weights}};
}

std::string WeightsOf(const OrderedJson& details) {
  const auto place = OrderedJson::json_pointer("/sampling/weights_sha256");
  return details.is_object() && details.contains(place) && details[place].is_string()
             ? details[place].get<std::string>()
             : "";
}

}  // namespace etude
