// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/judge_state.cc
#include "services/cli/judge_state.h"

#include <gtest/gtest.h>

namespace etude::cli {
namespace judge_state_test {

OrderedJson Details() {
  return OrderedJson::parse(R"({
      "decisions": [{"step": 0, "touched": false}, {"step": 30, "touched": false}, {"step": 60, "touched": true}],
      "latched_step": 100, "done_step": 150,
      "violations": [{"kind": "contact", "what": "forearm-milk", "step": 125, "steps": 3, "worst": 0}]})");
}

TEST(JudgeState, TellsWhatHadHappenedByThen) {
  EXPECT_EQ(JudgeState(Details(), 0), "judge: nothing yet");
  EXPECT_EQ(JudgeState(Details(), 59), "judge: nothing yet");
  EXPECT_EQ(JudgeState(Details(), 60), "judge: target touched");
  EXPECT_EQ(JudgeState(Details(), 100), "judge: target touched, latched at 0.80 s");
  EXPECT_EQ(JudgeState(Details(), 125), "judge: target touched, latched at 0.80 s, contact forearm-milk at 1.00 s");
  EXPECT_EQ(JudgeState(Details(), 900),
            "judge: target touched, latched at 0.80 s, done at 1.20 s, contact forearm-milk at 1.00 s");
}

TEST(JudgeState, WhatNeverHappenedIsNotTold) {
  OrderedJson details = Details();
  details["latched_step"] = details["done_step"] = -1;
  details["violations"] = OrderedJson::array();
  EXPECT_EQ(JudgeState(details, 900), "judge: target touched");
}

TEST(JudgeState, TellsTheFirstTwoViolations) {
  OrderedJson details = OrderedJson::object();
  for (const int step : {10, 20, 30})
    details["violations"].push_back({{"kind", "torque"}, {"what", "wrist_1"}, {"step", step}});
  EXPECT_EQ(JudgeState(details, 100), "judge: torque wrist_1 at 0.08 s, torque wrist_1 at 0.16 s");
}

TEST(JudgeState, LeavesOutWhatItCannotRead) {
  EXPECT_EQ(JudgeState(OrderedJson(), 10), "judge: nothing yet");
  EXPECT_EQ(JudgeState(OrderedJson::parse(R"([1, 2])"), 10), "judge: nothing yet");
  EXPECT_EQ(JudgeState(OrderedJson::parse(R"({"decisions": 3, "latched_step": "soon", "done_step": 2.5,
      "violations": [7, {"step": 1}, {"step": 2, "kind": 5, "what": "elbow"}]})"),
                       10),
            "judge: ? ? at 0.01 s, ? elbow at 0.02 s");
}

}  // namespace judge_state_test
}  // namespace etude::cli
