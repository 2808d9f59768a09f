// SPDX-License-Identifier: Apache-2.0
// Tests trainer/learn/run_state.cc
#include "trainer/learn/run_state.h"

#include <gtest/gtest.h>

#include <cmath>

#include "services/store/safetensors.h"
#include "tests/support/temporary_folder.h"

namespace etude::learn {
namespace run_state_test {

RunState Example() {
  RunState state;
  state.policy["a"] = torch::randn({2, 3});
  state.optimizer["first"] = torch::randn({7});
  state.optimizer["steps"] = torch::tensor({1, 2}, torch::kInt64);
  state.rng = at::detail::getDefaultCPUGenerator().get_state();
  state.step = 12345;
  state.elapsed_s = 1.25;
  state.curriculum = {{"stage", 2}};
  state.limit = {{"steps", 7}};
  state.architecture = "abc";
  state.embodiment.robot = "ur5";
  state.modules["LANG"] = {12, 0.5};
  state.validation = {3, 17};
  state.replicas = 6;
  state.best_stage = 2;
  state.best_score = 0.1;
  state.checkpoint_step = 12000;
  state.metrics = {{"LANG.accuracy", 0.75}, {"TAR3D.cm", std::nan("")}};
  return state;
}

TEST(RunState, ReadsBackExactly) {
  const TemporaryFolder folder;
  const RunState state = Example();
  ASSERT_TRUE(SaveRunState(folder / "s", state));

  const auto again = LoadRunState(folder / "s");

  ASSERT_TRUE(again) << again.error().message;
  EXPECT_TRUE(torch::equal(again->policy.at("a"), state.policy.at("a")));
  EXPECT_TRUE(torch::equal(again->optimizer.at("steps"), state.optimizer.at("steps")));
  EXPECT_TRUE(torch::equal(again->rng, state.rng));
  EXPECT_EQ(again->step, 12345u);
  EXPECT_EQ(again->elapsed_s, 1.25);
  EXPECT_EQ(again->curriculum, state.curriculum);
  EXPECT_EQ(again->best_score, 0.1);
  EXPECT_EQ(again->limit, state.limit);
  EXPECT_EQ(again->embodiment.robot, "ur5");
  EXPECT_EQ(again->modules.at("LANG").error, 0.5);
  EXPECT_EQ(again->validation, state.validation);
  EXPECT_EQ(again->replicas, 6);
  ASSERT_EQ(again->metrics.size(), 2u);
  EXPECT_EQ(again->metrics.at("LANG.accuracy"), 0.75);
  EXPECT_TRUE(std::isnan(again->metrics.at("TAR3D.cm")));
}

TEST(RunState, ReadsStatesThatSayNothingOfReplicas) {
  const TemporaryFolder folder;
  ASSERT_TRUE(SaveRunState(folder / "s", Example()));
  auto file = store::ReadSafetensors(folder / "s");
  ASSERT_TRUE(file);
  auto run = OrderedJson::parse(file->metadata.at("run"));
  ASSERT_EQ(run.erase("replicas"), 1u);
  file->metadata["run"] = run.dump();
  ASSERT_TRUE(store::WriteSafetensors(folder / "s", *file));
  const auto state = LoadRunState(folder / "s");
  ASSERT_TRUE(state) << state.error().message;
  EXPECT_EQ(state->replicas, 0);
}

TEST(RunState, RefusesWhatIsNone) {
  const TemporaryFolder folder;
  EXPECT_EQ(LoadRunState(folder / "none").error().code, Code::kNotFound);
  ASSERT_TRUE(WriteFileAtomically(folder / "text", "hello"));
  EXPECT_EQ(LoadRunState(folder / "text").error().code, Code::kCorrupt);
  ASSERT_TRUE(SaveRunState(folder / "s", Example()));
  auto bytes = ReadBinaryFile(folder / "s");
  ASSERT_TRUE(bytes);
  bytes->resize(bytes->size() / 2);
  ASSERT_TRUE(WriteFileAtomically(folder / "cut", *bytes));
  EXPECT_EQ(LoadRunState(folder / "cut").error().code, Code::kCorrupt);
}

}  // namespace run_state_test
}  // namespace etude::learn
