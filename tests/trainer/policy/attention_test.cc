// SPDX-License-Identifier: Apache-2.0
// Tests trainer/policy/attention.cc
#include "trainer/policy/attention.h"

#include <gtest/gtest.h>

#include <cmath>

#include "trainer/policy/image_encoder.h"

namespace etude::policy {
namespace attention_test {

using torch::Tensor;

constexpr int kBatch = 2, kQueries = 3, kTokens = 12, kOthers = 2, kWidth = 8, kHeads = 2;

Keys MakeKeys(int sentences) {
  Keys keys;
  keys.image_key = torch::randn({kBatch, kTokens, kWidth}, torch::kFloat64);
  keys.image_value = torch::randn({kBatch, kTokens, kWidth}, torch::kFloat64);
  keys.image_pixels = torch::rand({kTokens, 2}, torch::kFloat64) * 100;
  keys.other_key = torch::randn({kBatch, sentences, kOthers, kWidth}, torch::kFloat64);
  keys.other_value = torch::randn({kBatch, sentences, kOthers, kWidth}, torch::kFloat64);
  return keys;
}

struct AttentionCase {
  std::shared_ptr<Attention> attention;
  Tensor query;
  std::map<std::string, Tensor> weights;
};

AttentionCase MakeAttentionCase() {
  torch::manual_seed(3);
  AttentionCase c;
  c.attention = std::make_shared<Attention>(kWidth, kHeads);
  c.attention->to(torch::kFloat64);
  c.query = torch::randn({kBatch, kQueries, kWidth}, torch::kFloat64);
  for (const auto& item : c.attention->named_parameters()) {
    if (item.key().ends_with("bias")) torch::NoGradGuard(), item.value().data().normal_();
    c.weights[item.key()] = item.value().detach();
  }
  return c;
}

/// Attention of one query as a textbook writes it: loops over heads and keys.
struct Expected {
  Tensor output, map, pixels;
};
Expected Textbook(const AttentionCase& c, const Keys& keys, int b, int s) {
  const int head_width = kWidth / kHeads;
  const auto os = std::min<std::int64_t>(s, keys.other_key.size(1) - 1);
  const Tensor all_keys = torch::cat({keys.image_key[b], keys.other_key[b][os]});
  const Tensor all_values = torch::cat({keys.image_value[b], keys.other_value[b][os]});
  const Tensor q = torch::mv(c.weights.at("query.weight"), c.query[b][s]) + c.weights.at("query.bias");
  const Tensor k = torch::mm(all_keys, c.weights.at("key_weight").t());
  const Tensor v = torch::mm(all_values, c.weights.at("value_weight").t()) + c.weights.at("value_bias");
  Expected expected;
  std::vector<Tensor> heads, pixels;
  expected.map = torch::zeros({kTokens + kOthers}, torch::kFloat64);
  for (int h = 0; h < kHeads; ++h) {
    const Tensor qh = q.narrow(0, h * head_width, head_width);
    const Tensor logits = torch::mv(k.narrow(1, h * head_width, head_width), qh) / std::sqrt(head_width);
    const Tensor weights = torch::exp(logits) / torch::exp(logits).sum();
    heads.push_back(torch::mv(v.narrow(1, h * head_width, head_width).t(), weights));
    expected.map += weights / kHeads;
    const Tensor seen = weights.narrow(0, 0, kTokens);
    pixels.push_back(torch::mv(keys.image_pixels.t(), seen) / seen.sum());
  }
  expected.output = torch::mv(c.weights.at("output.weight"), torch::cat(heads)) + c.weights.at("output.bias");
  expected.pixels = torch::stack(pixels);
  return expected;
}

TEST(Attention, EqualsTheTextbook) {
  for (const int sentences : {1, kQueries}) {
    const AttentionCase c = MakeAttentionCase();
    const Keys keys = MakeKeys(sentences);
    const Attended attended = c.attention->Forward(c.query, keys);
    for (int b = 0; b < kBatch; ++b) {
      for (int s = 0; s < kQueries; ++s) {
        const Expected expected = Textbook(c, keys, b, s);
        EXPECT_TRUE(torch::allclose(attended.output[b][s], expected.output, 1e-9, 1e-10));
        EXPECT_TRUE(torch::allclose(attended.map[b][s], expected.map, 1e-9, 1e-10));
        EXPECT_TRUE(torch::allclose(attended.pixels[b][s], expected.pixels, 1e-9, 1e-8));
      }
    }
  }
}

TEST(Attention, EachRowOfTheMapSumsToOneWhateverTheKeys) {
  const AttentionCase c = MakeAttentionCase();
  Keys only_image = MakeKeys(1), only_others = MakeKeys(1), both = MakeKeys(1);
  only_image.other_key = only_image.other_value = Tensor();
  only_others.image_key = only_others.image_value = only_others.image_pixels = Tensor();
  for (const Keys& keys : {only_image, only_others, both}) {
    const Attended attended = c.attention->Forward(c.query, keys);
    EXPECT_TRUE(torch::allclose(attended.map.sum(-1), torch::ones({kBatch, kQueries}, torch::kFloat64)));
    EXPECT_EQ(attended.pixels.defined(), keys.image_key.defined());
  }
}

TEST(Attention, SoftArgmaxOfUniformAttentionIsTheCentreOfTheGrid) {
  ImageConfig image;
  image.crop = {0, 0, 24, 16};
  image.layers = {{.kind = "conv", .stride = 2}, {.kind = "conv", .stride = 2}, {.kind = "residual"}};
  const TokenGrid grid(image);
  ASSERT_EQ(grid.rows, 4);
  ASSERT_EQ(grid.columns, 6);
  ASSERT_EQ(grid.stride, 4);
  const AttentionCase c = MakeAttentionCase();
  Keys keys;
  keys.image_key = torch::zeros({kBatch, 24, kWidth}, torch::kFloat64);
  keys.image_value = torch::randn({kBatch, 24, kWidth}, torch::kFloat64);
  keys.image_pixels = grid.Centres(torch::TensorOptions(torch::kFloat64));

  const Attended attended = c.attention->Forward(c.query, keys);

  const Tensor centre = torch::tensor({12.0, 8.0}, torch::kFloat64);
  EXPECT_TRUE(torch::allclose(attended.pixels, centre.expand({kBatch, kQueries, kHeads, 2})));
  EXPECT_TRUE(torch::allclose(keys.image_pixels[7], torch::tensor({6.0, 6.0}, torch::kFloat64)));
}

}  // namespace attention_test
}  // namespace etude::policy
