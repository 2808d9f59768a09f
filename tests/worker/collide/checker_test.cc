// SPDX-License-Identifier: Apache-2.0
// Tests worker/collide/checker.cc and worker/collide/self_pairs.cc
#include "worker/collide/checker.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "services/core/rng.h"
#include "tests/worker/collide/referee.h"
#include "tests/worker/sim/scene_fixture.h"
#include "worker/collide/self_pairs.h"

namespace etude::collide {
namespace checker_test {

const sim::ObjectInfo& Object(const std::string& name) {
  return *std::ranges::find_if(sim::FullScene()->objects(), [&](const auto& object) { return object.name == name; });
}

// Upright on the table.
Pose Standing(const std::string& name, double x, double y) {
  Pose X_WO;
  X_WO.p = {x, y, Object(name).rest_height + 0.002};
  return X_WO;
}

class CheckerTest : public testing::Test {
 protected:
  std::shared_ptr<const sim::Scene> scene_ = sim::FullScene();
  const Eigen::VectorXd& q_home_ = scene_->arm().q_home;
  sim::Kinematics kinematics_{scene_};
  Checker checker_{scene_};
};

TEST_F(CheckerTest, HomeIsFree) {
  const auto collision = checker_.Check(q_home_, 0.002);

  EXPECT_FALSE(collision) << collision->body_a << " " << collision->body_b;
  EXPECT_EQ(checker_.checks(), 1u);
}

TEST_F(CheckerTest, TestsDistantPairsOfTheArmAndLeavesOutNeighbours) {
  const auto pairs = checker_.SelfPairs();
  const std::vector<std::string>& bodies = scene_->arm().bodies;
  const auto structure = internal::FindStructure(scene_->arm(), kinematics_);

  EXPECT_GT(pairs.size(), 3u);
  for (const auto& [a, b] : pairs) {
    const auto index = [&](const std::string& name) { return std::ranges::find(bodies, name) - bodies.begin(); };
    EXPECT_GE(structure.joints_between(index(a), index(b)), 2) << a << " " << b;
  }
  // the first body is the base: it stands on the world, and all joints lie before the tool
  EXPECT_EQ(structure.joints_between(structure.tool_body, bodies.size()), q_home_.size());
}

TEST_F(CheckerTest, SeesAnObjectAtTheHand) {
  Pose X_WO = kinematics_.X_WE(q_home_);
  X_WO.q.setIdentity();
  checker_.SetGripper(1);  // open fingers have room for a can
  EXPECT_FALSE(checker_.Check(q_home_));

  checker_.SetObject("coke", X_WO);
  const auto collision = checker_.Check(q_home_);
  ASSERT_TRUE(collision);
  EXPECT_EQ(collision->body_b, "coke");
  EXPECT_NE(std::ranges::find(scene_->arm().bodies, collision->body_a), scene_->arm().bodies.end());
  EXPECT_EQ(collision->distance, 0);

  checker_.Allow({"coke"});
  EXPECT_FALSE(checker_.Check(q_home_));
  checker_.Allow({});
  EXPECT_TRUE(checker_.Check(q_home_));

  X_WO.p.y() += 0.5;
  checker_.SetObject("coke", X_WO);
  EXPECT_FALSE(checker_.Check(q_home_));
}

TEST_F(CheckerTest, SeesTheTableUnderTheHand) {
  Pose X_WE = kinematics_.X_WE(q_home_);
  X_WE.p.z() = -0.01;
  const auto q = kinematics_.Solve(X_WE, q_home_);
  ASSERT_TRUE(q);

  const auto collision = checker_.Check(*q);
  ASSERT_TRUE(collision);
  EXPECT_EQ(collision->body_b, "world");
}

TEST_F(CheckerTest, MarginAgreesWithNearest) {
  Pose X_WO = Standing("coke", 0, 0);
  const Pose X_WE = kinematics_.X_WE(q_home_);
  X_WO.p.x() = X_WE.p.x();
  X_WO.p.y() = X_WE.p.y() + 0.12;
  checker_.SetObject("coke", X_WO);
  checker_.Allow({"world"});

  const Collision nearest = checker_.Nearest(q_home_);
  EXPECT_EQ(nearest.body_b, "coke");
  ASSERT_GT(nearest.distance, 0.01);
  EXPECT_TRUE(checker_.Check(q_home_, nearest.distance + 1e-4));
  EXPECT_FALSE(checker_.Check(q_home_, nearest.distance / 1.75));
}

TEST_F(CheckerTest, HeldObjectMovesWithTheHandAndHitsOthers) {
  Pose X_EO;
  X_EO.q = kinematics_.X_WE(q_home_).q.conjugate();
  checker_.SetGripper(0.5);
  checker_.Attach("coke", X_EO);
  EXPECT_FALSE(checker_.Check(q_home_, 0.002)) << "gripper and table may touch what is held";

  // in front of the can, out of the empty hand's way
  Pose X_WO = kinematics_.X_WE(q_home_);
  X_WO.q.setIdentity();
  X_WO.p.y() += Object("coke").half_extent.y() + Object("milk").half_extent.y() - 0.005;
  checker_.SetObject("milk", X_WO);
  const auto collision = checker_.Check(q_home_);
  ASSERT_TRUE(collision);
  EXPECT_EQ(collision->body_b, "milk");

  checker_.Attach("coke", std::nullopt);
  checker_.SetObject("coke", Standing("coke", 0.5, 0.5));
  const auto empty = checker_.Check(q_home_);
  EXPECT_TRUE(!empty || empty->body_a != "coke");
}

TEST_F(CheckerTest, SegmentAgreesWithDenseSampling) {
  Rng rng(3);
  checker_.SetObject("coke", Standing("coke", 0.1, 0.3));
  checker_.SetObject("bottle", Standing("bottle", -0.2, 0.3));
  int blocked = 0, disagree = 0;
  constexpr int kSegments = 150;
  for (int i = 0; i < kSegments; ++i) {
    Eigen::VectorXd a = q_home_, b = q_home_;
    for (double& value : a) value += rng.Uniform(-0.6, 0.6);
    for (double& value : b) value += rng.Uniform(-0.6, 0.6);
    bool dense = false;
    for (int k = 0; k <= 400 && !dense; ++k) dense = checker_.Collides(a + (b - a) * k / 400.0);

    const bool segment = checker_.CheckSegment(a, b, 0.01).has_value();
    if (segment) {
      EXPECT_TRUE(checker_.CheckSegment(b, a, 0.01));
    }
    blocked += dense ? 1 : 0;
    disagree += dense != segment ? 1 : 0;
  }
  EXPECT_GT(blocked, 20);
  EXPECT_LT(blocked, kSegments - 20);
  EXPECT_LE(disagree, 2);
}

TEST_F(CheckerTest, SegmentIncludesBothEnds) {
  Pose X_WE = kinematics_.X_WE(q_home_);
  X_WE.p.z() = -0.01;
  const auto q = kinematics_.Solve(X_WE, q_home_);
  ASSERT_TRUE(q);

  EXPECT_TRUE(checker_.CheckSegment(q_home_, *q, 100));
  EXPECT_TRUE(checker_.CheckSegment(*q, q_home_, 100));
  EXPECT_FALSE(checker_.CheckSegment(q_home_, q_home_));
}

TEST_F(CheckerTest, VerdictsDoNotDependOnWhatWasAskedBefore) {
  Rng rng(4);
  checker_.SetObject("coke", Standing("coke", 0.1, 0.3));
  std::vector<Eigen::VectorXd> configurations;
  std::vector<bool> verdicts;
  for (int i = 0; i < 200; ++i) {
    Eigen::VectorXd q = q_home_;
    for (double& value : q) value += rng.Uniform(-1, 1);
    configurations.push_back(q);
    verdicts.push_back(checker_.Check(q, 0.002).has_value());
  }

  Checker other(scene_);
  other.SetObject("coke", Standing("coke", 0.1, 0.3));
  for (int i = 199; i >= 0; --i) {
    other.Nearest(configurations[(i * 7) % 200]);
    EXPECT_EQ(other.Check(configurations[i], 0.002).has_value(), verdicts[i]);
    EXPECT_EQ(other.Collides(configurations[i], 0.002), verdicts[i]);
  }
}

TEST_F(CheckerTest, DistancesAreNearestsWithPointsOnBothSides) {
  Pose X_WO = Standing("coke", 0, 0);
  const Pose X_WE = kinematics_.X_WE(q_home_);
  X_WO.p.x() = X_WE.p.x() + 0.05;
  X_WO.p.y() = X_WE.p.y() + 0.12;
  checker_.SetObject("coke", X_WO);
  checker_.SetObject("milk", Standing("milk", X_WE.p.x() - 0.1, X_WE.p.y() + 0.05));

  Rng rng(6);
  for (int i = 0; i < 100; ++i) {
    Eigen::VectorXd q = q_home_;
    for (double& value : q) value += rng.Uniform(-0.2, 0.2);
    const Collision nearest = checker_.Nearest(q);
    const auto found = checker_.Distances(q, 0.3);
    ASSERT_FALSE(found.empty());
    const auto least = std::ranges::min_element(found, {}, &Proximity::distance);
    if (nearest.distance > 0) {
      EXPECT_NEAR(least->distance, nearest.distance, 2e-3);
    }
    if (nearest.distance == 0) {
      EXPECT_LT(least->distance, 1e-5);
    }
    std::set<std::pair<std::string, std::string>> names;
    for (const Proximity& p : found) {
      EXPECT_LT(p.distance, 0.3);
      EXPECT_TRUE(names.emplace(p.body_a, p.body_b).second) << "one entry for each pair of bodies";
      EXPECT_EQ(p.carrier, p.body_a);
      EXPECT_LT((p.p_WA - p.p_WB - p.distance * p.normal).norm(), 1e-9);
    }
    EXPECT_GE(checker_.Distances(q, 0.3, PairSet::kSelfToo).size(), found.size());
  }
}

TEST_F(CheckerTest, DistanceGrowsAlongItsNormal) {
  checker_.SetObject("coke", Standing("coke", -0.05, 0.3));
  Rng rng(7);
  int compared = 0;
  for (int i = 0; i < 200; ++i) {
    Eigen::VectorXd q = q_home_;
    for (double& value : q) value += rng.Uniform(-0.3, 0.3);
    for (const Proximity& p : checker_.Distances(q, 0.1)) {
      if (p.distance < 1e-3) continue;
      const Eigen::MatrixXd J = kinematics_.PointJacobians(q, {{p.carrier, p.p_WA}}).front();
      const Eigen::VectorXd slope = J.transpose() * p.normal;
      const double h = 1e-4 / std::max(1e-3, slope.norm());
      const Eigen::VectorXd away = q + h * slope;
      for (const Proximity& after : checker_.Distances(away, 0.2)) {
        if (after.body_a != p.body_a || after.body_b != p.body_b) continue;
        ++compared;
        EXPECT_NEAR(after.distance - p.distance, h * slope.squaredNorm(), 0.1 * h * slope.squaredNorm() + 1.5e-5)
            << p.body_a << " " << p.body_b;
      }
    }
  }
  EXPECT_GT(compared, 100);
}

TEST_F(CheckerTest, DistancesOfWhatIsHeldBelongToTheToolsBody) {
  Pose X_EO;
  X_EO.q = kinematics_.X_WE(q_home_).q.conjugate();
  checker_.SetGripper(0.5);
  checker_.Attach("coke", X_EO);
  Pose X_WO = kinematics_.X_WE(q_home_);
  X_WO.q.setIdentity();
  X_WO.p.y() += 0.12;
  checker_.SetObject("milk", X_WO);
  const auto found = checker_.Distances(q_home_, 0.2);
  const auto held = std::ranges::find(found, "coke", &Proximity::body_a);
  ASSERT_NE(held, found.end());
  EXPECT_EQ(held->body_b, "milk");
  const auto structure = internal::FindStructure(scene_->arm(), kinematics_);
  EXPECT_EQ(held->carrier, scene_->arm().bodies[structure.tool_body]);
}

TEST_F(CheckerTest, ClearedItKnowsNoObjectNothingAllowedAndNothingHeld) {
  Pose X_WO = kinematics_.X_WE(q_home_);
  X_WO.q.setIdentity();
  checker_.SetGripper(1);
  checker_.SetObject("coke", X_WO);
  checker_.SetObject("milk", X_WO);
  checker_.Allow({"coke"});
  checker_.Attach("bottle", Pose{});
  ASSERT_TRUE(checker_.Check(q_home_));

  checker_.ClearObjects();
  EXPECT_FALSE(checker_.Check(q_home_));
  EXPECT_EQ(checker_.gripper(), 1) << "the fingers are no object";
  checker_.SetObject("coke", X_WO);
  const auto collision = checker_.Check(q_home_);
  ASSERT_TRUE(collision) << "it is not allowed any more";
  EXPECT_NE(collision->body_a, "bottle");
  checker_.Attach("pepsi", Pose{});  // nothing is held: another may be
}

TEST_F(CheckerTest, WhatIsHeldMayNotTouchTheArm) {
  const auto structure = internal::FindStructure(scene_->arm(), kinematics_);
  // in the hand's frame, where the upper arm is
  const auto& bodies = scene_->arm().bodies;
  const auto upper = std::ranges::find_if(bodies, [&](const std::string& body) {
    return structure.joints_between(&body - &bodies[0], static_cast<int>(bodies.size())) == 2;
  });
  ASSERT_NE(upper, bodies.end());
  const Pose X_WB = kinematics_.BodyPoses(q_home_, 0, {*upper}).front();
  Pose X_WO = X_WB;
  for (const auto& piece : scene_->geometry())
    if (piece.body == *upper) X_WO = X_WB * piece.X_BG;
  X_WO.q.setIdentity();
  checker_.Allow({"coke"});  // as every stage that holds does
  checker_.Attach("coke", kinematics_.X_WE(q_home_).inverse() * X_WO);
  const auto collision = checker_.Check(q_home_);
  ASSERT_TRUE(collision);
  EXPECT_EQ(collision->body_b, "coke");
  const auto touched = std::ranges::find(bodies, collision->body_a);
  ASSERT_NE(touched, bodies.end());
  EXPECT_FALSE(structure.with_tool[static_cast<std::size_t>(touched - bodies.begin())]) << *touched;
}

TEST_F(CheckerTest, WhatIsLetGoIsWhereItWasSetLast) {
  Pose X_WO = kinematics_.X_WE(q_home_);
  X_WO.q.setIdentity();
  checker_.SetGripper(1);
  Pose far = X_WO;
  far.p.y() += 0.6;
  checker_.SetObject("coke", far);
  checker_.Attach("coke", Pose{{0, 0, 0}, kinematics_.X_WE(q_home_).q.conjugate()});
  EXPECT_FALSE(checker_.Check(q_home_)) << "the hand may touch what it holds";
  checker_.SetObject("coke", X_WO);
  EXPECT_FALSE(checker_.Check(q_home_)) << "still held";
  checker_.Attach("coke", std::nullopt);
  const auto collision = checker_.Check(q_home_);
  ASSERT_TRUE(collision) << "it stands around the closed fingers now";
  EXPECT_EQ(collision->body_b, "coke");

  // one that was never set is nowhere when it is let go, and letting go of what is not held is nothing
  checker_.ClearObjects();
  checker_.Attach("coke", Pose{});
  checker_.Attach("milk", std::nullopt);
  checker_.Attach("coke", std::nullopt);
  EXPECT_FALSE(checker_.Check(q_home_));
}

TEST_F(CheckerTest, ALargerMarginNeverFreesWhatASmallerOneBlocks) {
  Rng rng(8);
  checker_.SetObject("coke", Standing("coke", 0.05, 0.3));
  checker_.SetObject("milk", Standing("milk", -0.15, 0.25));
  int between = 0;
  for (int i = 0; i < 200; ++i) {
    Eigen::VectorXd q = q_home_;
    for (double& value : q) value += rng.Uniform(-0.3, 0.3);
    bool blocked = false, first = true;
    bool began = false;
    for (const double margin : {0.0, 0.001, 0.002, 0.005, 0.01, 0.02, 0.04}) {
      const bool now = checker_.Check(q, margin).has_value();
      EXPECT_TRUE(now || !blocked) << i << " at " << margin;
      if (first) began = now;
      first = false;
      blocked = blocked || now;
    }
    between += blocked && !began ? 1 : 0;
  }
  EXPECT_GT(between, 10) << "some are blocked by the margin alone";
}

TEST_F(CheckerTest, LookingFurtherFindsTheSameAndMore) {
  Rng rng(9);
  checker_.SetObject("coke", Standing("coke", 0.05, 0.3));
  checker_.SetObject("bottle", Standing("bottle", -0.2, 0.3));
  for (int i = 0; i < 60; ++i) {
    Eigen::VectorXd q = q_home_;
    for (double& value : q) value += rng.Uniform(-0.3, 0.3);
    const auto far = checker_.Distances(q, 0.3, PairSet::kSelfToo);
    const auto near = checker_.Distances(q, 0.1, PairSet::kSelfToo);
    std::size_t expected = 0;
    for (const Proximity& p : far) {
      EXPECT_NEAR(p.normal.norm(), 1, 1e-9);
      if (p.distance >= 0.1) continue;
      ++expected;
      const auto same = std::ranges::find_if(
          near, [&](const Proximity& other) { return other.body_a == p.body_a && other.body_b == p.body_b; });
      ASSERT_NE(same, near.end()) << p.body_a << " " << p.body_b;
      EXPECT_EQ(same->distance, p.distance);
    }
    EXPECT_EQ(near.size(), expected);
  }
}

TEST_F(CheckerTest, OverlapsOfTheArmAreThoseOfThePosesThatItIsGiven) {
  const auto pairs = checker_.SelfPairs();
  std::vector<Pose> poses = kinematics_.ArmPoses(q_home_, 0);
  EXPECT_TRUE(checker_.SelfOverlaps(poses, 0.001).empty());

  // a body is put into another that it is tested against
  const auto& bodies = scene_->arm().bodies;
  const auto& [a, b] = pairs.front();
  const auto index = [&](const std::string& name) {
    return static_cast<std::size_t>(std::ranges::find(bodies, name) - bodies.begin());
  };
  const auto middle = [&](const std::string& body) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    int n = 0;
    for (const auto& piece : scene_->geometry())
      if (piece.body == body) sum += poses[index(body)] * piece.X_BG.p, ++n;
    return Eigen::Vector3d(sum / n);
  };
  const Eigen::Vector3d shift = middle(a) - middle(b);
  poses[index(b)].p += shift;
  const auto overlaps = checker_.SelfOverlaps(poses, 0.001);
  const auto found = std::ranges::find_if(overlaps, [&](const Checker::Overlap& overlap) {
    return (overlap.body_a == a && overlap.body_b == b) || (overlap.body_a == b && overlap.body_b == a);
  });
  ASSERT_NE(found, overlaps.end()) << a << " in " << b;
  EXPECT_GT(found->depth, 0.001);
  EXPECT_TRUE(checker_.SelfOverlaps(poses, 10).empty()) << "none is ten metres deep";
  for (const auto& overlap : overlaps)
    EXPECT_EQ(std::ranges::count_if(overlaps,
                                    [&](const Checker::Overlap& other) {
                                      return other.body_a == overlap.body_a && other.body_b == overlap.body_b;
                                    }),
              1);
}

TEST_F(CheckerTest, ConfigurationsThatAreCheckedAreCounted) {
  checker_.Check(q_home_);
  (void)checker_.Nearest(q_home_);
  (void)checker_.Distances(q_home_, 0.1);
  EXPECT_EQ(checker_.checks(), 3u);
  Eigen::VectorXd there = q_home_;
  there[0] += 0.1;
  EXPECT_FALSE(checker_.CheckSegment(q_home_, there, 0.03));
  EXPECT_EQ(checker_.checks(), 3u + 5u) << "both ends and three places between";
}

TEST_F(CheckerTest, NamesOfNothingAreMistakesOfTheProgram) {
  EXPECT_DEATH(checker_.SetObject("unicorn", Pose{}), "unicorn");
  EXPECT_DEATH(checker_.Allow({"coke", "unicorn"}), "unicorn");
  EXPECT_DEATH(checker_.Attach("unicorn", Pose{}), "unicorn");
  checker_.Attach("coke", Pose{});
  checker_.Attach("coke", Pose{{0.01, 0, 0}, Eigen::Quaterniond::Identity()});  // it slipped
  EXPECT_DEATH(checker_.Attach("milk", Pose{}), "already holds 'coke'");
  EXPECT_DEATH((void)checker_.CheckSegment(q_home_, q_home_, 0), "resolution");
}

class AgainstMujoco : public CheckerTest {
 protected:
  // Pairs (arm body, other) in contact that the checker is to see.
  std::set<std::pair<std::string, std::string>> MujocoPairs(const Eigen::VectorXd& q) {
    referee_.Place(q, 0);
    std::set<std::pair<std::string, std::string>> pairs;
    const auto self = checker_.SelfPairs();
    const auto is_arm = [&](const std::string& body) {
      return std::ranges::find(scene_->arm().bodies, body) != scene_->arm().bodies.end();
    };
    for (const auto& pair : referee_.Contacts()) {
      if (!is_arm(pair.first)) continue;
      const bool of_self = is_arm(pair.second);
      const bool tested = of_self ? std::ranges::find(self, pair) != self.end()
                                  : pair.first != scene_->arm().bodies.front() /* the base stands on the world */;
      if (tested) pairs.insert(pair);
    }
    return pairs;
  }
  Referee referee_{*scene_};
};

TEST_F(AgainstMujoco, VerdictsAgreeOnRandomConfigurations) {
  double x = -0.4;
  for (const sim::ObjectInfo& object : scene_->objects()) {
    const Pose X_WO = Standing(object.name, x, 0.25);
    referee_.PlaceObject(object.name, X_WO);
    checker_.SetObject(object.name, X_WO);
    x += 0.15;
  }

  Rng rng(5);
  int mujoco_hits = 0, self_hits = 0, missed = 0, extra = 0;
  constexpr int kConfigurations = 3000;
  for (int i = 0; i < kConfigurations; ++i) {
    Eigen::VectorXd q = q_home_;
    const double spread = i % 2 == 0 ? 0.5 : 2.5;
    for (double& value : q) value += rng.Uniform(-spread, spread);
    q = q.cwiseMax(scene_->arm().q_min).cwiseMin(scene_->arm().q_max);

    const auto in_contact = MujocoPairs(q);
    mujoco_hits += in_contact.empty() ? 0 : 1;
    self_hits += !in_contact.empty() && std::ranges::all_of(in_contact, [&](const auto& pair) {
      return std::ranges::find(scene_->arm().bodies, pair.second) != scene_->arm().bodies.end();
    });
    // conservative: what MuJoCo sees, the checker sees with a tenth of a millimetre to spare
    if (!in_contact.empty() && !checker_.Check(q, 1e-4)) {
      ++missed;
      ADD_FAILURE() << "missed " << in_contact.begin()->first << " " << in_contact.begin()->second;
    }
    if (in_contact.empty() && checker_.Check(q)) ++extra;
  }
  EXPECT_GT(mujoco_hits, kConfigurations / 20);
  EXPECT_LT(mujoco_hits, kConfigurations * 19 / 20);
  EXPECT_GT(self_hits, kConfigurations / 50) << "in touch with itself alone";
  EXPECT_EQ(missed, 0);
  EXPECT_LE(extra, kConfigurations / 100);
}

}  // namespace checker_test
}  // namespace etude::collide
