// SPDX-License-Identifier: Apache-2.0
// Every robot's collision geometry: free at home, and the same to FCL as it is to MuJoCo.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <numbers>

#include "services/core/file.h"
#include "services/core/rng.h"
#include "tests/worker/collide/referee.h"
#include "worker/collide/checker.h"
#include "worker/collide/pieces.h"
#include "worker/collide/separation.h"

namespace etude::collide {
namespace robots_test {

std::shared_ptr<const sim::Scene> SceneOf(const std::string& robot) {
  SceneSpec spec;
  spec.robot = robot;
  auto built = sim::Scene::Build(spec);
  EXPECT_TRUE(built) << built.error().message;
  return *built;
}

Eigen::VectorXd RandomJoints(const sim::ArmInfo& arm, Rng& rng) {
  Eigen::VectorXd q(arm.q_home.size());
  for (int i = 0; i < q.size(); ++i)
    q[i] = arm.q_home[i] + rng.Uniform(std::max(arm.q_min[i] - arm.q_home[i], -std::numbers::pi),
                                       std::min(arm.q_max[i] - arm.q_home[i], std::numbers::pi));
  return q;
}

class Robot : public testing::TestWithParam<std::string> {};

TEST_P(Robot, IsFreeAtHomeOpenAndClosed) {
  const auto scene = SceneOf(GetParam());
  Checker checker(scene);
  for (const double gripper : {0.0, 1.0}) {
    checker.SetGripper(gripper);
    const auto collision = checker.Check(scene->arm().q_home, 0.01);
    EXPECT_FALSE(collision) << collision->body_a << " " << collision->body_b;
  }
  // the pairs that matter are looked at: hand and fingers against base, first link and upper arm
  const auto pairs = checker.SelfPairs();
  const auto& bodies = scene->arm().bodies;
  for (const std::size_t near : {0u, 1u, 2u})
    for (const auto& finger : scene->arm().finger_groups.front())
      EXPECT_NE(std::ranges::find(pairs, std::pair{bodies[near], finger}), pairs.end())
          << bodies[near] << " " << finger;
}

// A pair at FCL's distance d must be in contact for MuJoCo once both are grown by a millimetre more in all, and not
// when grown by a millimetre less: the distances then agree within 1 mm.
TEST_P(Robot, DistancesAgreeWithMuJoCo) {
  const auto scene = SceneOf(GetParam());
  Referee referee(*scene);
  const mjModel* mj = referee.model();
  std::vector<int> geoms;  // in the order of Scene::geometry()
  for (int geom = 0; geom < mj->ngeom; ++geom)
    if (scene->model().mj->geom_contype[geom] || scene->model().mj->geom_conaffinity[geom]) geoms.push_back(geom);
  const auto& pieces = scene->geometry();
  ASSERT_EQ(geoms.size(), pieces.size());
  const auto& bodies = scene->arm().bodies;
  const auto of_arm = [&](std::size_t i) { return std::ranges::find(bodies, pieces[i].body) != bodies.end(); };

  Rng rng(11);
  std::map<std::string, int> kinds;
  int compared = 0;
  for (int k = 0; k < 20000 && compared < 1000; ++k) {
    const auto a = rng.Below(pieces.size()), b = rng.Below(pieces.size());
    if (!of_arm(a) || mj->body_weldid[mj->geom_bodyid[geoms[a]]] == mj->body_weldid[mj->geom_bodyid[geoms[b]]])
      continue;
    const Eigen::VectorXd q = RandomJoints(scene->arm(), rng);
    referee.Place(q, rng.Uniform());
    const auto place = [&](std::size_t i) {
      const Pose X_WB = scene->model().BodyPose(referee.data(), scene->model().BodyId(pieces[i].body));
      return internal::ToIsometry(X_WB * pieces[i].X_BG);
    };
    const double distance = Distance(Shape(pieces[a], 0), place(a), Shape(pieces[b], 0), place(b));
    if (distance < 2e-3 || distance > 0.2) continue;
    // below the table there is a slab's underside for FCL and no end of it for MuJoCo
    if (pieces[b].body == "world" && place(a).translation().z() < 0) continue;
    ++compared;
    ++kinds[pieces[a].body];
    EXPECT_TRUE(referee.Within(geoms[a], geoms[b], distance + 1e-3))
        << pieces[a].name << " " << pieces[b].name << " at " << distance;
    // for two boxes MuJoCo looks along their axes only, which is less than their distance when corners are nearest
    using enum sim::Geometry::Shape;
    if (pieces[a].shape == kBox && pieces[b].shape == kBox) continue;
    EXPECT_FALSE(referee.Within(geoms[a], geoms[b], distance - 1e-3))
        << pieces[a].name << " " << pieces[b].name << " at " << distance;
  }
  EXPECT_EQ(compared, 1000);
  EXPECT_GT(kinds.size(), bodies.size() / 2);
}

INSTANTIATE_TEST_SUITE_P(Every, Robot, testing::Values("ur5", "panda", "jaco2", "deploy/robots/sketch.yaml"),
                         [](const auto& info) { return Path(info.param).stem().string(); });

}  // namespace robots_test
}  // namespace etude::collide
