// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/attention.h"

#include <cmath>

namespace etude::policy {
namespace {

torch::Tensor XavierUniform(int width) {
  torch::Tensor weight = torch::empty({width, width});
  torch::nn::init::xavier_uniform_(weight);
  return weight;
}

}  // namespace

// A bias of the keys would add the same number to all logits of a query: there is none.
Attention::Attention(int width, int heads)
    : heads_(heads),
      head_width_(width / heads),
      query_(register_module("query", torch::nn::Linear(width, width))),
      output_(register_module("output", torch::nn::Linear(width, width))),
      key_weight_(register_parameter("key_weight", XavierUniform(width))),
      value_weight_(register_parameter("value_weight", XavierUniform(width))),
      value_bias_(register_parameter("value_bias", torch::zeros({width}))) {}

Attended Attention::Forward(const torch::Tensor& query, const Keys& keys) {
  const auto batch = query.size(0), count = query.size(1);
  const bool image = keys.image_key.defined(), other = keys.other_key.defined();
  const torch::Tensor q =
      query_->forward(query).view({batch, count, heads_, head_width_}) / std::sqrt(static_cast<double>(head_width_));

  // (B, h, S, P + n)
  std::vector<torch::Tensor> logits;
  constexpr double kNever = -1e9;  // no infinity: who attends to nothing at all would be no number
  if (image) logits.push_back(ImageLogits(q, keys.image_key));
  if (image && keys.image_unattended.defined())
    logits.back() = logits.back().masked_fill(keys.image_unattended, kNever);
  if (other) logits.push_back(OtherLogits(q, keys.other_key));
  const torch::Tensor all = logits.size() == 1 ? logits[0] : torch::cat(logits, -1);
  const torch::Tensor weights = torch::softmax(all.to(query.scalar_type()), -1);

  Attended result;
  result.map = weights.mean(1);
  result.heads = weights.transpose(1, 2);
  const auto tokens = image ? keys.image_key.size(1) : 0;
  torch::Tensor values;
  if (image) {
    const torch::Tensor on_image = other ? weights.narrow(-1, 0, tokens) : weights;
    values = ImageValues(on_image, keys.image_value);
    // expectation over the picture alone, even when some of the mass lies elsewhere
    const torch::Tensor rows = on_image.reshape({batch * heads_ * count, tokens});
    const torch::Tensor mass = rows.sum(-1, /*keepdim=*/true).clamp_min(1e-6);
    result.pixels = (torch::mm(rows, keys.image_pixels) / mass).view({batch, heads_, count, 2}).transpose(1, 2);
  }
  if (other) {
    const torch::Tensor added =
        OtherValues(image ? weights.narrow(-1, tokens, keys.other_key.size(2)) : weights, keys.other_value);
    values = values.defined() ? values + added : added;
  }
  result.output = output_->forward(values.reshape({batch, count, heads_ * head_width_}) + value_bias_);
  return result;
}

// q (B, S, h, dh), keys (B, P, d) -> (B, h, S, P)
torch::Tensor Attention::ImageLogits(const torch::Tensor& q, const torch::Tensor& keys) {
  const auto batch = q.size(0), count = q.size(1), width = keys.size(2);
  const torch::Tensor per_head = q.permute({2, 0, 1, 3}).reshape({heads_, batch * count, head_width_});
  const torch::Tensor folded = torch::bmm(per_head, key_weight_.view({heads_, head_width_, width}))
                                   .view({heads_, batch, count, width})
                                   .transpose(0, 1)
                                   .reshape({batch, heads_ * count, width});
  return torch::bmm(folded.to(keys.scalar_type()), keys.transpose(1, 2)).view({batch, heads_, count, keys.size(1)});
}

// q (B, S, h, dh), keys (B, S | 1, n, d) -> (B, h, S, n)
torch::Tensor Attention::OtherLogits(const torch::Tensor& q, const torch::Tensor& keys) {
  const torch::Tensor k = torch::nn::functional::linear(keys, key_weight_)
                              .view({keys.size(0), keys.size(1), keys.size(2), heads_, head_width_});
  return (k * q.unsqueeze(2)).sum(-1).permute({0, 3, 1, 2});
}

// weights (B, h, S, P), values (B, P, d) -> (B, S, h, dh)
torch::Tensor Attention::ImageValues(const torch::Tensor& weights, const torch::Tensor& values) {
  const auto batch = weights.size(0), count = weights.size(2), width = values.size(2);
  const torch::Tensor sums = torch::bmm(weights.reshape({batch, heads_ * count, -1}).to(values.scalar_type()), values)
                                 .to(value_weight_.scalar_type())
                                 .view({batch, heads_, count, width})
                                 .transpose(0, 1)
                                 .reshape({heads_, batch * count, width});
  return torch::bmm(sums, value_weight_.view({heads_, head_width_, width}).transpose(1, 2))
      .view({heads_, batch, count, head_width_})
      .permute({1, 2, 0, 3});
}

// weights (B, h, S, n), values (B, S | 1, n, d) -> (B, S, h, dh)
torch::Tensor Attention::OtherValues(const torch::Tensor& weights, const torch::Tensor& values) {
  const torch::Tensor v = torch::nn::functional::linear(values, value_weight_)
                              .view({values.size(0), values.size(1), values.size(2), heads_, head_width_});
  return (v * weights.permute({0, 2, 3, 1}).unsqueeze(-1)).sum(2);
}

}  // namespace etude::policy
