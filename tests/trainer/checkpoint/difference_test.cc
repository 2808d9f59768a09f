// SPDX-License-Identifier: Apache-2.0
// Tests trainer/checkpoint/difference.cc
#include "trainer/checkpoint/difference.h"

#include <gmock/gmock.h>

#include "tests/trainer/checkpoint/example_checkpoint.h"
#include "tests/trainer/policy/fixtures.h"

namespace etude::checkpoint {
namespace difference_test {

using State = PartDifference::State;
using ::testing::HasSubstr;

std::map<std::string, PartDifference> ByPart(const Checkpoint& a, const Checkpoint& b) {
  std::map<std::string, PartDifference> found;
  for (auto& item : Compare(a, b)) found[item.part] = item;
  return found;
}

TEST(Difference, NamesThePartsThatChangedAndByHowMuch) {
  const Checkpoint first = ExampleCheckpoint(policy::TinyConfig());
  Checkpoint second = ExampleCheckpoint(policy::TinyConfig());
  for (auto& [name, tensor] : second.tensors)
    if (name.starts_with("modules.TAR2D.")) tensor = tensor * 1.1;

  const auto parts = ByPart(first, second);

  ASSERT_EQ(parts.size(), 11u);
  for (const auto& [part, item] : parts)
    EXPECT_EQ(item.state, part == "TAR2D" ? State::kChanged : State::kSame) << part;
  EXPECT_NEAR(parts.at("TAR2D").relative, 0.1, 1e-6);
}

TEST(Difference, OtherTypesOfNumbersAreAChange) {
  const Checkpoint first = ExampleCheckpoint(policy::TinyConfig());
  Checkpoint second = ExampleCheckpoint(policy::TinyConfig());
  for (auto& [name, tensor] : second.tensors)
    if (name.starts_with("modules.TAR2D.")) tensor = tensor.to(torch::kFloat64);
  const auto parts = ByPart(first, second);
  EXPECT_EQ(parts.at("TAR2D").state, State::kChanged);
  EXPECT_EQ(parts.at("TAR2D").relative, 0);
}

TEST(Difference, TellsOtherShapesAndOtherParts) {
  policy::PolicyConfig config = policy::TinyConfig();
  const Checkpoint first = ExampleCheckpoint(config);
  policy::FindModule(config, "EE3D")->decoder.hidden = {4};
  config.modules.erase(config.modules.begin() + 5);  // DISP
  auto* control = policy::FindModule(config, "CTRL");
  control->attend = {"EE3D"};
  control->decoder.inputs = {"register"};
  const Checkpoint second = ExampleCheckpoint(config);

  const auto parts = ByPart(first, second);

  EXPECT_EQ(parts.at("DISP").state, State::kOnlyInFirst);
  EXPECT_EQ(ByPart(second, first).at("DISP").state, State::kOnlyInSecond);
  EXPECT_EQ(parts.at("EE3D").state, State::kReshaped);
  EXPECT_THAT(parts.at("EE3D").tensors, testing::Contains(HasSubstr("decoder.bias (8) -> (4)")));
  EXPECT_THAT(ToText(Compare(first, second)), HasSubstr("only in the first"));
}

}  // namespace difference_test
}  // namespace etude::checkpoint
