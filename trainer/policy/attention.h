// SPDX-License-Identifier: Apache-2.0
// Multi-head attention of few queries over many image tokens and a handful of other keys.
//
// The key and value maps are linear, so they are applied to the queries and to the attended sums
// instead of to every image token: logits = (W_k' q) x, output = W_v (sum a x). With 7 queries and
// 720 tokens that is half of the arithmetic and none of the (B, P, d) intermediates. Shapes: B
// images, S queries, P image tokens, n other keys, h heads, d width.
#pragma once

#include "trainer/policy/torch.h"

namespace etude::policy {

struct Keys {
  torch::Tensor image_key, image_value;  ///< (B, P, d) both, or both undefined
  torch::Tensor image_pixels;            ///< (P, 2) px, with image_key
  torch::Tensor image_unattended;        ///< (P) bool: keys that have no share; undefined: all may
  torch::Tensor other_key, other_value;  ///< (B, S or 1, n, d) both, or both undefined
};

struct Attended {
  torch::Tensor output;  ///< (B, S, d)
  torch::Tensor map;     ///< (B, S, P + n), mean over heads; each row sums to 1
  torch::Tensor heads;   ///< (B, S, h, P + n) the same of each head
  torch::Tensor pixels;  ///< (B, S, h, 2) px, expectation over each head's image tokens
};

class Attention : public torch::nn::Module {
 public:
  Attention(int width, int heads);
  /// @param query  (B, S, d)
  Attended Forward(const torch::Tensor& query, const Keys& keys);

 private:
  torch::Tensor ImageLogits(const torch::Tensor& q, const torch::Tensor& keys);
  torch::Tensor OtherLogits(const torch::Tensor& q, const torch::Tensor& keys);
  torch::Tensor ImageValues(const torch::Tensor& weights, const torch::Tensor& values);
  torch::Tensor OtherValues(const torch::Tensor& weights, const torch::Tensor& values);

  int heads_, head_width_;
  torch::nn::Linear query_{nullptr}, output_{nullptr};
  torch::Tensor key_weight_, value_weight_, value_bias_;  ///< (d, d), (d, d), (d)
};

}  // namespace etude::policy
