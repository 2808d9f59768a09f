// SPDX-License-Identifier: Apache-2.0
// Tests worker/task/criteria.cc
#include "worker/task/criteria.h"

#include "tests/worker/task/predicates/scene.h"
#include "tests/worker/task/relations.h"

namespace etude::task {
namespace criteria_test {

// The coke as the target, followed through what happens to it. Latched criteria count once and for all.
class CriteriaTest : public PredicateTest {
 protected:
  void Judge(const std::string& task) {
    const Criteria criteria = CriteriaOf(ParseTask(task).value());
    auto strict = MakePredicate(criteria.success, TheCast()), latched = MakePredicate(criteria.latched, TheCast());
    ASSERT_TRUE(strict.has_value() && latched.has_value());
    strict_ = std::move(*strict);
    latched_ = std::move(*latched);
    ever_ = holds_ = false;
  }
  void See(const Pose& X_WO) {
    coke().X_WO = X_WO;
    holds_ = strict_->Observe(now);
    ever_ |= latched_->Observe(now);
  }
  std::unique_ptr<Predicate> strict_, latched_;
  bool holds_ = false, ever_ = false;
};

TEST_F(CriteriaTest, PickLatchesAtThreeCentimetresAndIsDoneOnlyInTheHand) {
  Judge("pick");
  See(At(0, 0.4, 0.0699));
  EXPECT_FALSE(ever_);
  See(At(0, 0.4, 0.0701));
  EXPECT_TRUE(ever_);
  EXPECT_FALSE(holds_) << "thrown up";
  coke().grasped = coke().touched = true;
  See(At(0, 0.4, 0.0701));
  EXPECT_TRUE(holds_);
  See(At(0, 0.3, 0.04));
  EXPECT_FALSE(holds_);
  EXPECT_TRUE(ever_);
}

TEST_F(CriteriaTest, PushLatchesWhileItTipsAndIsDoneOnlyStanding) {
  Judge("push");
  See(At(0.3, 0.2, 0.04));
  EXPECT_FALSE(ever_) << "aside and towards the robot";
  See(At(0, 0.331, 0.04, {kQuarter, 0, 0}));
  EXPECT_TRUE(ever_);
  EXPECT_FALSE(holds_) << "tipped over";
  coke().speed = 0.1;
  See(At(0, 0.331, 0.04));
  EXPECT_FALSE(holds_) << "still sliding";
  coke().speed = 0.01;
  See(At(0, 0.331, 0.04));
  EXPECT_TRUE(holds_);
}

TEST_F(CriteriaTest, PutDownIsNotDoneWhileTheHandHoldsIt) {
  Judge("put_down");
  coke().touched = coke().grasped = true;
  See(At(0, 0.3, 0.15));
  See(At(0, 0.2, 0.15, {-kQuarter, 0, 0}));
  EXPECT_FALSE(ever_);
  See(At(0, 0.2, 0.03, {-kQuarter, 0, 0}));
  EXPECT_TRUE(ever_) << "the authors' criterion";
  EXPECT_FALSE(holds_) << "it hangs in the closed hand";
  coke().touched = coke().grasped = false;
  See(At(0, 0.2, 0.03, {-kQuarter, 0, 0}));
  EXPECT_TRUE(holds_);
}

TEST_F(CriteriaTest, PutDownLatchesTurnAndHeightInEitherOrderButOnlyAfterTheLift) {
  Judge("put_down");
  See(At(0, 0.3, 0.03, {-kQuarter, 0, 0}));  // fell over: turned and low, never lifted
  EXPECT_FALSE(ever_);
  See(At(0, 0.3, 0.15));
  See(At(0, 0.3, 0.04));  // down again, upright
  EXPECT_FALSE(ever_);
  See(At(0, 0.3, 0.15, {-kQuarter, 0, 0}));
  EXPECT_TRUE(ever_) << "low first, turned afterwards: they need not coincide";
}

TEST_F(CriteriaTest, PutDownRefusesTheWrongTurn) {
  for (const Eigen::Vector3d& wrong :
       {Eigen::Vector3d(0, kQuarter, 0), Eigen::Vector3d(-kQuarter, 0.4, 0.4), Eigen::Vector3d(0, -kQuarter, 0)}) {
    Judge("put_down");
    See(At(0, 0.3, 0.2));
    See(At(0, 0.3, 0.03, wrong));
    EXPECT_FALSE(ever_) << wrong.transpose();
  }
}

TEST_F(CriteriaTest, RotateNeedsTheTurnInTheHandAfterTheLift) {
  Judge("rotate");
  See(At(0, 0.3, 0.03, {kQuarter, 0, 0}));  // fell over, never lifted
  EXPECT_FALSE(holds_ || ever_);
  coke().grasped = coke().touched = true;
  See(At(0, 0.3, 0.11));
  See(At(0, 0.3, 0.15, {kQuarter - 0.52, 0, 0}));
  EXPECT_FALSE(holds_ || ever_) << "not far enough";
  See(At(0, 0.3, 0.12, {kQuarter - 0.48, 0, 0}));
  EXPECT_TRUE(holds_ && ever_);
  coke().grasped = coke().touched = false;
  See(At(0, 0.3, 0.12, {kQuarter, 0, 0}));
  EXPECT_FALSE(holds_) << "let go";
}

// What each relation looks like from the reference.
class Relation : public CriteriaTest, public testing::WithParamInterface<const char*> {
 protected:
  Pose Beside() const {
    return {now.at("milk").X_WO.p + 0.12 * DirectionOf(GetParam()), Eigen::Quaterniond::Identity()};
  }
  void Lift() {
    coke().touched = true;
    See(At(0, 0.3, 0.08));
    coke().touched = false;
  }
};

TEST_P(Relation, IsDoneWhenItStandsThereReleasedAfterItWasLifted) {
  Judge(GetParam());
  Lift();
  See(Beside());
  EXPECT_TRUE(holds_ && ever_);
  coke().touched = true;
  See(Beside());
  EXPECT_FALSE(holds_) << "held";
  coke().touched = false;
  coke().speed = 0.04;
  See(Beside());
  EXPECT_FALSE(holds_) << "moving";
  coke().speed = 0;
  Pose leaning = Beside();
  leaning.q = FromEuler({0.6, 0, 0});
  See(leaning);
  EXPECT_FALSE(holds_) << "leaning";
  See(At(-0.3, 0, 0.04));
  EXPECT_FALSE(holds_);
  EXPECT_TRUE(ever_);
}

TEST_P(Relation, IsNotLatchedByPushingItThere) {
  Judge(GetParam());
  See(Beside());
  EXPECT_FALSE(ever_);
}

INSTANTIATE_TEST_SUITE_P(Four, Relation, testing::Values("place_left", "place_right", "place_front", "place_behind"),
                         [](const auto& info) { return std::string(info.param); });

}  // namespace criteria_test
}  // namespace etude::task
