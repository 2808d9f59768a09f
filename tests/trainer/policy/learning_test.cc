// SPDX-License-Identifier: Apache-2.0
// Tests that the whole of trainer/policy learns: coloured squares named by a sentence.
#include <torch/nn/utils/clip_grad.h>
#include <torch/optim/adamw.h>

#include "tests/trainer/policy/fixtures.h"

namespace etude::policy {
namespace learning_test {

using torch::Tensor;

constexpr int kPictureWidth = 48, kHeight = 32, kSize = 5, kColours = 3;

struct Batch {
  Inputs inputs;
  Labels labels;
};

PolicyConfig BlobConfig() {
  PolicyConfig config = TinyConfig();
  config.image.crop = {20, 30, kPictureWidth, kHeight};
  config.precision = "bf16";
  config.width = 32;
  config.heads = 4;
  config.language = {.buckets = 512, .width = 16, .hidden = 32};
  std::erase_if(config.modules,
                [](const ModuleConfig& module) { return module.name != "LANG" && module.name != "TAR2D"; });
  FindModule(config, "TAR2D")->attend_weight = 0.5;
  return config;
}

/// A red, a blue and a green square each in a third of the picture (in random order), asked for by name.
Batch MakeBatch(int batch) {
  Batch result;
  Tensor images = torch::randint(90, 110, {batch, 3, kHeight, kPictureWidth}, torch::kUInt8);
  Tensor pixel = torch::empty({batch, kColours, 2});
  for (int b = 0; b < batch; ++b) {
    const Tensor thirds = torch::randperm(kColours);
    for (int colour = 0; colour < kColours; ++colour) {
      const auto u = thirds[colour].item<std::int64_t>() * kPictureWidth / 3 +
                     torch::randint(0, kPictureWidth / 3 - kSize, {1}).item<std::int64_t>();
      const auto v = torch::randint(0, kHeight - kSize, {1}).item<std::int64_t>();
      for (int channel = 0; channel < 3; ++channel)
        images[b][channel].narrow(0, v, kSize).narrow(1, u, kSize).fill_(channel == colour ? 250 : 10);
      pixel[b][colour][0] = 20 + u + kSize / 2.0F;
      pixel[b][colour][1] = 30 + v + kSize / 2.0F;
    }
  }
  result.inputs.images = images.contiguous(torch::MemoryFormat::ChannelsLast);
  result.inputs.crop_origin = torch::tensor({20.0F, 30.0F}).expand({batch, 2}).contiguous();
  result.inputs.joints = torch::zeros({batch, 3});
  result.inputs.sentences = {"pick the red one", "pick the blue one", "push green"};
  // colours are in channel order: red, green, blue
  result.inputs.sentence_index = torch::tensor({0, 2, 1}, torch::kInt64).expand({batch, kColours}).contiguous();
  result.labels["target.class"] = torch::arange(kColours).expand({batch, kColours}).contiguous();
  result.labels["target.pixel"] = pixel;
  return result;
}

TEST(Learning, FindsTheSquareThatTheSentenceNames) {
  torch::manual_seed(4);
  const auto policy = MakePolicy(BlobConfig(), 4);
  torch::optim::AdamW optimizer(policy->parameters(), torch::optim::AdamWOptions(5e-3));
  double first = 0, last = 0;
  for (int step = 0; step < 150; ++step) {
    const Batch batch = MakeBatch(16);
    optimizer.zero_grad();
    const LossTerms loss = policy->Loss(batch.inputs, policy->Forward(batch.inputs), batch.labels);
    loss.total.backward();
    torch::nn::utils::clip_grad_norm_(policy->parameters(), 1.0);
    optimizer.step();
    last = loss.total.item<double>();
    if (step == 0) first = last;
  }

  policy->eval();
  torch::NoGradGuard no_grad;
  const Batch test = MakeBatch(64);
  const Outputs outputs = policy->Forward(test.inputs);
  const Tensor error = (outputs.at("TAR2D").decoded.at("pixel") - test.labels.at("target.pixel")).norm(2, -1);
  EXPECT_LT(error.mean().item<double>(), 1.0) << "px; loss went from " << first << " to " << last;
  const Tensor named = outputs.at("LANG").decoded.at("class").argmax(-1);
  EXPECT_TRUE(torch::equal(named, test.labels.at("target.class")));
}

}  // namespace learning_test
}  // namespace etude::policy
