// SPDX-License-Identifier: Apache-2.0
#include "worker/plan/sampling.h"

#include <ompl/base/MotionValidator.h>
#include <ompl/base/ProblemDefinition.h>
#include <ompl/base/SpaceInformation.h>
#include <ompl/base/StateSampler.h>
#include <ompl/base/spaces/RealVectorStateSpace.h>
#include <ompl/datastructures/NearestNeighborsLinear.h>
#include <ompl/geometric/PathGeometric.h>
#include <ompl/geometric/planners/rrt/RRTConnect.h>
#include <ompl/util/Console.h>
#include <ompl/util/Exception.h>

#include <algorithm>
#include <utility>

namespace etude::plan::internal {
namespace {

namespace ob = ompl::base;

constexpr double kRange = 0.6;  ///< rad, longest edge of a tree; short ones are blocked less often

Eigen::VectorXd ToVector(const ob::State* state, int size) {
  return Eigen::Map<const Eigen::VectorXd>(state->as<ob::RealVectorStateSpace::StateType>()->values, size);
}

void FromVector(const Eigen::VectorXd& q, ob::State* state) {
  std::copy(q.begin(), q.end(), state->as<ob::RealVectorStateSpace::StateType>()->values);
}

// Draws from our stream instead of OMPL's, and counts.
class Sampler : public ob::StateSampler {
 public:
  Sampler(const ob::StateSpace* space, const SamplingProblem& problem, Rng& rng, int& samples)
      : ob::StateSampler(space), problem_(problem), rng_(rng), samples_(samples) {}

  void sampleUniform(ob::State* state) override { Draw(problem_.lower, problem_.upper, state); }

  void sampleUniformNear(ob::State* state, const ob::State* near, double distance) override {
    const Eigen::VectorXd q = ToVector(near, static_cast<int>(problem_.lower.size()));
    Draw((q.array() - distance).matrix().cwiseMax(problem_.lower),
         (q.array() + distance).matrix().cwiseMin(problem_.upper), state);
  }

  void sampleGaussian(ob::State* state, const ob::State* mean, double deviation) override {
    Eigen::VectorXd q = ToVector(mean, static_cast<int>(problem_.lower.size()));
    for (double& value : q) value += deviation * rng_.Normal();
    FromVector(q.cwiseMax(problem_.lower).cwiseMin(problem_.upper), state);
    ++samples_;
  }

 private:
  void Draw(const Eigen::VectorXd& lower, const Eigen::VectorXd& upper, ob::State* state) {
    Eigen::VectorXd q(lower.size());
    for (int i = 0; i < q.size(); ++i) q[i] = rng_.Uniform(lower[i], upper[i]);
    FromVector(q, state);
    ++samples_;
  }

  const SamplingProblem& problem_;
  Rng& rng_;
  int& samples_;
};

class SegmentValidator : public ob::MotionValidator {
 public:
  SegmentValidator(ob::SpaceInformation* space, const SamplingProblem& problem)
      : ob::MotionValidator(space), problem_(problem) {}

  bool checkMotion(const ob::State* from, const ob::State* to) const override {
    const int size = static_cast<int>(problem_.lower.size());
    return problem_.is_segment_free(ToVector(from, size), ToVector(to, size));
  }
  bool checkMotion(const ob::State* from, const ob::State* to,
                   std::pair<ob::State*, double>& last_valid) const override {
    last_valid.second = 0;
    return checkMotion(from, to);
  }

 private:
  const SamplingProblem& problem_;
};

// What a search has met so far.
struct Search {
  int& samples;
  bool goal_blocked = false;
};

ob::SpaceInformationPtr MakeSpace(const SamplingProblem& problem, Rng& rng, Search& search) {
  const int size = static_cast<int>(problem.lower.size());
  auto space = std::make_shared<ob::RealVectorStateSpace>(size);
  ob::RealVectorBounds bounds(size);
  for (int i = 0; i < size; ++i) {
    bounds.setLow(i, problem.lower[i]);
    bounds.setHigh(i, problem.upper[i]);
  }
  space->setBounds(bounds);
  auto information = std::make_shared<ob::SpaceInformation>(space);
  information->setStateValidityChecker([&problem, &search, size](const ob::State* state) {
    const Eigen::VectorXd q = ToVector(state, size);
    const bool is_free = problem.is_free(q);
    search.goal_blocked = search.goal_blocked || (!is_free && q == problem.q_goal);
    return is_free;
  });
  information->setMotionValidator(std::make_shared<SegmentValidator>(information.get(), problem));
  information->setup();

  // only now: setting up draws states to size the cells of projections that are not used
  space->setStateSamplerAllocator([&](const ob::StateSpace* of) -> ob::StateSamplerPtr {
    return std::make_shared<Sampler>(of, problem, rng, search.samples);
  });
  return information;
}

// RRT-Connect itself. @returns the path or nothing
std::vector<Eigen::VectorXd> Solve(const SamplingProblem& problem, Rng& rng, int& samples) {
  Search search{samples};
  const ob::SpaceInformationPtr space = MakeSpace(problem, rng, search);
  auto definition = std::make_shared<ob::ProblemDefinition>(space);
  ob::ScopedState<> start(space), goal(space);
  FromVector(problem.q_start, start.get());
  FromVector(problem.q_goal, goal.get());
  definition->setStartAndGoalStates(start, goal);

  // neighbours by a linear scan: the tree-based ones draw from OMPL's process-wide seed
  ompl::geometric::RRTConnect planner(space);
  planner.setRange(kRange);
  planner.setNearestNeighbors<ompl::NearestNeighborsLinear>();
  planner.setProblemDefinition(definition);
  planner.setup();
  // OMPL waits for another goal, without drawing a state, where the only one is blocked
  const ob::PlannerTerminationCondition is_over(
      ob::PlannerTerminationConditionFn([&] { return samples >= problem.max_samples || search.goal_blocked; }));
  if (planner.solve(is_over) != ob::PlannerStatus::EXACT_SOLUTION) return {};

  std::vector<Eigen::VectorXd> points;
  const auto* path = definition->getSolutionPath()->as<ompl::geometric::PathGeometric>();
  for (std::size_t i = 0; i < path->getStateCount(); ++i)
    points.push_back(ToVector(path->getState(i), static_cast<int>(problem.lower.size())));
  return points;
}

}  // namespace

SamplingResult SamplePath(const SamplingProblem& problem, Rng& rng) {
  // OMPL's own log is process-wide and says nothing that the outcome does not
  static const bool kSilent = (ompl::msg::noOutputHandler(), true);
  (void)kSilent;

  SamplingResult result;
  try {
    result.path = Solve(problem, rng, result.samples);
  } catch (const ompl::Exception&) {
    result.path.clear();  // no path found either
  }
  return result;
}

}  // namespace etude::plan::internal
