// SPDX-License-Identifier: Apache-2.0
// Tests worker/host/messages.cc: nothing changes on the way, and what is wrong is refused.
#include "worker/host/messages.h"

#include <gtest/gtest.h>

#include <limits>

namespace etude::host {
namespace messages_test {

// As it arrives: text, parsed again.
OrderedJson Travelled(const OrderedJson& head) { return OrderedJson::parse(head.dump()); }

TEST(Messages, CampaignsAndWorkArriveAsTheyWere) {
  campaign::JoinedCampaign joined{"ab12", {}, "run@cd"};
  joined.spec.name = "mixed";
  joined.spec.seed = 0xffffffffffffffff;
  joined.fingerprint = {{"libm", "cd34"}};
  const auto arrived = CampaignOf(Travelled(CampaignHead(joined)));
  ASSERT_TRUE(arrived) << arrived.error().message;
  EXPECT_EQ(arrived->id, "ab12");
  EXPECT_EQ(arrived->policy, "run@cd");
  EXPECT_EQ(arrived->fingerprint, joined.fingerprint);
  EXPECT_EQ(SpecHash(arrived->spec), SpecHash(joined.spec));

  const auto item = WorkOf(Travelled(WorkHead({.index = 1ull << 60, .attempt = 7})), joined.spec);
  ASSERT_TRUE(item) << item.error().message;
  EXPECT_EQ(item->index, 1ull << 60);
  EXPECT_EQ(item->attempt, 7u);
  EXPECT_TRUE(item->weights.empty());
}

TEST(Messages, QuestionsAndAnswersArriveToTheLastBit) {
  Frame frame{FrameKind::kQuestion, {}, std::vector<std::uint8_t>(4 * 2 * 3, 9)};
  policy::Question question{.instruction = "pick the coke can", .joints = {0.1f, -2.7182817f}, .width = 4, .height = 2};
  question.robot = "ur5";
  question.camera = Camera{.name = "front", .width = 4, .height = 2, .fovy = 1.0 / 3};
  question.camera->X_WC = {{0.1, 0.2, 1e-17}, Eigen::Quaterniond(0.5, 0.5, -0.5, 0.5)};
  frame.head = Travelled(QuestionHead(question));
  const auto arrived = QuestionOf(frame);
  ASSERT_TRUE(arrived) << arrived.error().message;
  EXPECT_EQ(arrived->joints, question.joints);
  EXPECT_EQ(arrived->instruction, question.instruction);
  EXPECT_EQ(arrived->rgb.size(), 24u);
  EXPECT_EQ(arrived->camera->fovy, 1.0 / 3);
  EXPECT_EQ(arrived->camera->X_WC.p.z(), 1e-17);
  EXPECT_EQ(arrived->camera->X_WC.q.y(), -0.5);

  policy::Answer answer;
  answer.waypoints = {{{{0.1, 1.0 / 3, 2}, Eigen::Quaterniond(1, 0, 0, 0)}, 0.7}};
  answer.modules = {{"TAR3D", {1, 2}}};
  answer.checkpoint_step = 300;
  const auto answered = AnswerOf(Travelled(AnswerHead(answer)));
  ASSERT_TRUE(answered) << answered.error().message;
  EXPECT_EQ(answered->waypoints.at(0).X_WE.p.y(), 1.0 / 3);
  EXPECT_EQ(answered->waypoints.at(0).gripper, 0.7);
  EXPECT_EQ(answered->modules, answer.modules);
}

TEST(Messages, ResultsAndErrorsArrive) {
  campaign::WorkResult result{.episode = {}, .outcome = "dropped", .details_json = R"({"reason": "x"})", .steps = 9};
  result.times.plan_s = 0.25;
  Frame frame{FrameKind::kResult, Travelled(ResultHead(result)), {5, 6}};
  const auto arrived = ResultOf(frame);
  ASSERT_TRUE(arrived);
  EXPECT_EQ(arrived->outcome, "dropped");
  EXPECT_EQ(arrived->details_json, result.details_json);
  EXPECT_EQ(arrived->steps, 9u);
  EXPECT_EQ(arrived->times.plan_s, 0.25);
  EXPECT_EQ(arrived->episode.size(), 2u);
  const Error error = ErrorOf(Travelled(ErrorHead({Code::kUnavailable, "no GL"})));
  EXPECT_EQ(error.code, Code::kUnavailable);
  EXPECT_EQ(error.message, "no GL");
}

TEST(Messages, WhatIsWrongIsRefused) {
  EXPECT_FALSE(ResultOf({FrameKind::kResult, {{"outcome", 3}}, {}}));
  EXPECT_FALSE(CampaignOf({{"id", "a"}}));
  EXPECT_FALSE(WorkOf({{"index", -1}, {"attempt", "x"}, {"weights", ""}}, {}));
  EXPECT_FALSE(AnswerOf({{"waypoints", 3}}));
  EXPECT_EQ(ErrorOf({{"code", 3}}).code, Code::kCorrupt);
  const policy::Question question{.instruction = "", .joints = {}, .width = 1 << 20, .height = 1 << 20};
  EXPECT_FALSE(QuestionOf({FrameKind::kQuestion, QuestionHead(question), {}})) << "no such picture is there";
}

// the bytes of a rollout said another reason than without slots
TEST(Messages, ARotationThatIsNoneArrivesAsOne) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  policy::Answer answer;
  answer.waypoints = {{{{0.1, 0.2, 0.3}, Eigen::Quaterniond(nan, nan, nan, nan)}, 0}};
  const auto arrived = AnswerOf(Travelled(AnswerHead(answer)));
  ASSERT_TRUE(arrived) << arrived.error().message;
  EXPECT_TRUE(arrived->waypoints.at(0).X_WE.q.coeffs().array().isNaN().all());
  EXPECT_EQ(arrived->waypoints.at(0).X_WE.p.z(), 0.3);
  EXPECT_FALSE(AnswerOf({{"waypoints", {{{"pose", {1, 2}}, {"gripper", 0}}}}}));
}

}  // namespace messages_test
}  // namespace etude::host
