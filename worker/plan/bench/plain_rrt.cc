// SPDX-License-Identifier: Apache-2.0
#include "worker/plan/bench/plain_rrt.h"

#include <ompl/base/ProblemDefinition.h>
#include <ompl/base/SpaceInformation.h>
#include <ompl/base/spaces/RealVectorStateSpace.h>
#include <ompl/geometric/PathGeometric.h>
#include <ompl/geometric/PathSimplifier.h>
#include <ompl/geometric/planners/rrt/RRTConnect.h>
#include <ompl/util/Console.h>
#include <ompl/util/Exception.h>
#include <ompl/util/RandomNumbers.h>

#include <algorithm>
#include <numbers>
#include <optional>

#include "services/core/clock.h"
#include "services/core/rng.h"
#include "worker/plan/retime.h"

namespace etude::plan {

namespace ob = ompl::base;
namespace og = ompl::geometric;

namespace {

constexpr int kGoalTries = 8;
constexpr double kSpacing = 0.08;  ///< rad, of the curve through the corners of the path

Eigen::VectorXd ToVector(const ob::State* state, Eigen::Index size) {
  return Eigen::Map<const Eigen::VectorXd>(state->as<ob::RealVectorStateSpace::StateType>()->values, size);
}

ob::SpaceInformationPtr MakeSpace(const sim::ArmInfo& arm, const Request& request, collide::Checker& checker) {
  const Eigen::Index size = arm.q_min.size();
  auto space = std::make_shared<ob::RealVectorStateSpace>(static_cast<unsigned>(size));
  ob::RealVectorBounds bounds(static_cast<unsigned>(size));
  for (Eigen::Index i = 0; i < size; ++i) {
    bounds.setLow(static_cast<unsigned>(i), arm.q_min[i]);
    bounds.setHigh(static_cast<unsigned>(i), arm.q_max[i]);
  }
  space->setBounds(bounds);
  auto information = std::make_shared<ob::SpaceInformation>(space);
  information->setStateValidityChecker([&checker, &request, size](const ob::State* state) {
    return !checker.Collides(ToVector(state, size), request.margin);
  });
  // OMPL's unit: a part of the space's extent
  information->setStateValidityCheckingResolution(PlannerConfig{}.resolution / space->getMaximumExtent());
  information->setup();
  return information;
}

}  // namespace

struct PlainRrt::Impl {
  explicit Impl(std::shared_ptr<const sim::Scene> scene_in, std::uint64_t seed)
      : scene(std::move(scene_in)), kinematics(scene), rng(MixSeed({seed}, "plain rrt")) {}

  std::optional<Eigen::VectorXd> FindGoal(const Request& request, collide::Checker& checker);
  std::vector<Eigen::VectorXd> FindPath(const Request& request, const Eigen::VectorXd& q_goal,
                                        collide::Checker& checker, double deadline_s, Outcome& outcome);

  std::shared_ptr<const sim::Scene> scene;
  sim::Kinematics kinematics;
  Rng rng;
};

std::optional<Eigen::VectorXd> PlainRrt::Impl::FindGoal(const Request& request, collide::Checker& checker) {
  Eigen::VectorXd seed = request.q_start;
  for (int i = 0; i <= kGoalTries; ++i) {
    const auto q = kinematics.Solve(request.X_WE_goal, seed);
    if (q && !checker.Collides(*q, request.margin)) return q;
    seed = request.q_start;
    for (double& value : seed) value += rng.Uniform(-std::numbers::pi / 2, std::numbers::pi / 2);
    seed = seed.cwiseMax(scene->arm().q_min).cwiseMin(scene->arm().q_max);
  }
  return std::nullopt;
}

std::vector<Eigen::VectorXd> PlainRrt::Impl::FindPath(const Request& request, const Eigen::VectorXd& q_goal,
                                                      collide::Checker& checker, double deadline_s, Outcome& outcome) {
  const ob::SpaceInformationPtr space = MakeSpace(scene->arm(), request, checker);
  auto definition = std::make_shared<ob::ProblemDefinition>(space);
  ob::ScopedState<> start(space), goal(space);
  std::ranges::copy(request.q_start, start->as<ob::RealVectorStateSpace::StateType>()->values);
  std::ranges::copy(q_goal, goal->as<ob::RealVectorStateSpace::StateType>()->values);
  definition->setStartAndGoalStates(start, goal);

  const Stopwatch watch;
  const ob::PlannerTerminationCondition late(
      ob::PlannerTerminationConditionFn([&] { return watch.Seconds() > deadline_s; }));
  og::RRTConnect planner(space);
  planner.setProblemDefinition(definition);
  planner.setup();
  if (planner.solve(late) != ob::PlannerStatus::EXACT_SOLUTION) return {};

  auto* path = definition->getSolutionPath()->as<og::PathGeometric>();
  const Stopwatch simplify;
  og::PathSimplifier(space).simplify(*path, late);
  outcome.times.simplify = simplify.Seconds();
  std::vector<Eigen::VectorXd> points;
  for (std::size_t i = 0; i < path->getStateCount(); ++i)
    points.push_back(ToVector(path->getState(static_cast<unsigned>(i)), q_goal.size()));
  return points;
}

PlainRrt::PlainRrt(std::shared_ptr<const sim::Scene> scene, std::uint64_t seed)
    : impl_(std::make_unique<Impl>(std::move(scene), seed)) {
  static const bool kOnce = (ompl::msg::noOutputHandler(), ompl::RNG::setSeed(seed % 0xffffffffu + 1), true);
  (void)kOnce;
}
PlainRrt::PlainRrt(PlainRrt&&) noexcept = default;
PlainRrt::~PlainRrt() = default;

Outcome PlainRrt::Plan(const Request& request, collide::Checker& checker, double deadline_s) {
  Outcome outcome;
  const Stopwatch watch;
  const std::uint64_t checks_before = checker.checks();
  std::vector<Eigen::VectorXd> path;
  if (const auto q_goal = impl_->FindGoal(request, checker)) {
    try {
      path = impl_->FindPath(request, *q_goal, checker, deadline_s, outcome);
    } catch (const ompl::Exception&) {
      path.clear();
    }
  } else {
    outcome.kind = OutcomeKind::kGoalUnreachable;
  }
  outcome.times.plan = watch.Seconds() - outcome.times.simplify;
  if (path.size() >= 2) {
    const Stopwatch parameterise;
    auto motion = internal::Retime(internal::JointCurve(path, kSpacing), impl_->kinematics, request.limits,
                                   request.start_speed, request.X_WE_goal);
    outcome.kind = motion ? OutcomeKind::kSampled : OutcomeKind::kNotSmooth;
    if (motion) outcome.motion = std::move(*motion);
    outcome.times.parameterise = parameterise.Seconds();
  }
  outcome.checks = checker.checks() - checks_before;
  return outcome;
}

}  // namespace etude::plan
