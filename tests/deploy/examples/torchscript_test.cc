// SPDX-License-Identifier: Apache-2.0
// Runs deploy/examples/torchscript.cc, which has libtorch and nothing of ours, over an export of the compact policy.
#include "trainer/checkpoint/torchscript.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/script.h>

#include <sstream>

#include "services/core/config.h"
#include "tests/support/etude_command.h"
#include "tests/support/matchers.h"
#include "tests/support/run_command.h"
#include "tests/support/temporary_folder.h"
#include "tests/trainer/checkpoint/example_checkpoint.h"
#include "trainer/policy/answer.h"
#include "trainer/policy/crop.h"
#include "trainer/policy/torch.h"

namespace etude {
namespace torchscript_test {

using testing::HasSubstr;

class TorchScriptExample : public testing::Test {
 protected:
  void SetUp() override {
    auto config = LoadConfig<policy::PolicyConfig>("trainer/experiments/policies/compact/base.yaml");
    ASSERT_THAT(config, IsOk());
    config->image.crop = {40, 72, 144, 80};  // as it is derived from the default camera
    config->precision = "float32";
    config->tasks = {"pick", "push", "put_down"};
    example_ = checkpoint::ExampleCheckpoint(*config);
    example_.metadata.embodiment.width = example_.metadata.embodiment.height = 224;
    const auto bytes = checkpoint::ToTorchScript(example_);
    ASSERT_THAT(bytes, IsOk());
    ASSERT_THAT(WriteFileAtomically(folder_ / "policy.pt", *bytes), IsOk());
  }

  ShellOutput Run(const std::string& arguments) {
    const std::string program = (ProgramsFolder() / "example-torchscript").string();
    return RunInShell(program + " " + (folder_ / "policy.pt").string() + " " + arguments + " 2>&1");
  }

  // what the program is given, as torch.save writes it
  void Save(const torch::Tensor& crop, const torch::Tensor& joints, const torch::Tensor& token_ids) {
    const auto bytes = torch::jit::pickle_save(c10::ivalue::Tuple::create({crop, joints, token_ids}));
    ASSERT_THAT(WriteFileAtomically(folder_ / "inputs.pt", std::string_view(bytes.data(), bytes.size())), IsOk());
  }

  TemporaryFolder folder_;
  checkpoint::Checkpoint example_;
};

std::vector<double> NumbersOf(const std::string& text) {
  std::istringstream stream(text);
  std::vector<double> numbers;
  for (double number = 0; stream >> number;) numbers.push_back(number);
  return numbers;
}

TEST_F(TorchScriptExample, SaysTheWaypointsOfThePolicy) {
  const auto policy = checkpoint::BuildPolicy(example_);
  ASSERT_THAT(policy, IsOk());
  const auto& config = (*policy)->config();
  const auto crop = policy::CropOf(config.image);
  const torch::NoGradGuard no_grad;
  torch::manual_seed(5);
  for (const char* sentence : {"push the coke", "please put the green bottle down next to the milk"}) {
    policy::Inputs inputs;
    inputs.images = torch::randint(256, {1, 3, crop.height, crop.width}, torch::kUInt8);
    inputs.crop_origin = torch::tensor({static_cast<float>(crop.u), static_cast<float>(crop.v)}).view({1, 2});
    inputs.joints = torch::rand({1, checkpoint::kExampleJoints});
    inputs.sentences = {sentence};
    inputs.sentence_index = torch::zeros({1, 1}, torch::kInt64);
    Save(inputs.images, inputs.joints, checkpoint::TokenIds(sentence, config.language.buckets));

    const auto said = Run((folder_ / "inputs.pt").string());

    ASSERT_EQ(said.code, 0) << said.text;
    const auto numbers = NumbersOf(said.text);
    const auto wanted = policy::WaypointTensor(config, (*policy)->Forward(inputs)).contiguous();
    ASSERT_EQ(numbers.size(), static_cast<std::size_t>(kWaypoints * kWaypointSize)) << said.text;
    const float* value = wanted.data_ptr<float>();
    for (std::size_t i = 0; i < numbers.size(); ++i)
      EXPECT_NEAR(numbers[i], value[i], i % kWaypointSize < 3 ? 1e-5 : 1e-4) << sentence << ": number " << i;
  }
}

TEST_F(TorchScriptExample, SaysWhatThePolicyTakesAndAnswersToZeros) {
  const auto about = Run("");
  ASSERT_EQ(about.code, 0) << about.text;
  const auto facts = OrderedJson::parse(about.text, nullptr, false);
  EXPECT_EQ(facts["crop"], OrderedJson::parse("[40, 72, 144, 80]")) << about.text;

  const auto zeros = Run(fmt::format("80 144 {}", checkpoint::kExampleJoints));
  EXPECT_EQ(zeros.code, 0);
  EXPECT_EQ(NumbersOf(zeros.text).size(), static_cast<std::size_t>(kWaypoints * kWaypointSize)) << zeros.text;
}

TEST_F(TorchScriptExample, RefusesInWords) {
  const auto absent = Run((folder_ / "absent.pt").string());
  EXPECT_EQ(absent.code, 3);
  EXPECT_THAT(absent.text, HasSubstr("cannot open"));
  EXPECT_EQ(Run("80 144").code, 2);
}

}  // namespace torchscript_test
}  // namespace etude
