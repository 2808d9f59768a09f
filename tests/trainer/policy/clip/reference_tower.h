// SPDX-License-Identifier: Apache-2.0
// CLIP's text tower once more: in double, with loops, straight from the tensors of the file and from the paper's
// description (GPT-2's blocks: Radford et al. 2019, section 2.3). It shares no code with what it checks.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>
#include <vector>

#include "services/store/safetensors.h"
#include "trainer/policy/torch.h"

namespace etude::clip {

class ReferenceTower {
 public:
  using Vector = std::vector<double>;

  ReferenceTower(const store::Safetensors& model, std::size_t layers, std::size_t heads)
      : model_(model), layers_(layers), heads_(heads) {}

  /// @param ids  up to the end token, whose state is read out
  Vector Embed(const std::vector<std::int64_t>& ids) const {
    const Vector tokens = Numbers("text_model.embeddings.token_embedding.weight");
    const Vector positions = Numbers("text_model.embeddings.position_embedding.weight");
    const std::size_t width = Numbers("text_model.final_layer_norm.bias").size();
    std::vector<Vector> states(ids.size(), Vector(width));
    for (std::size_t t = 0; t < ids.size(); ++t)
      for (std::size_t i = 0; i < width; ++i)
        states[t][i] = tokens[static_cast<std::size_t>(ids[t]) * width + i] + positions[t * width + i];
    for (std::size_t layer = 0; layer < layers_; ++layer) Block(layer, states);
    const Vector last = Normalised("text_model.final_layer_norm", states.back());
    return Product(Numbers("text_projection.weight"), last);
  }

 private:
  static double FromHalf(std::uint16_t bits) {
    const double sign = (bits & 0x8000) != 0 ? -1 : 1;
    const int exponent = (bits >> 10) & 0x1F, fraction = bits & 0x3FF;
    return exponent == 0 ? sign * std::ldexp(fraction, -24) : sign * std::ldexp(1024 + fraction, exponent - 25);
  }

  Vector Numbers(const std::string& name) const {
    const store::Tensor& tensor = model_.tensors.at(name);
    Vector numbers(tensor.data.size() / store::SizeOf(tensor.dtype));
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      float single = 0;
      std::uint16_t half = 0;
      if (tensor.dtype == store::DType::kF32) {
        std::memcpy(&single, tensor.data.data() + 4 * i, 4);
        numbers[i] = single;
      } else if (tensor.dtype == store::DType::kF16) {
        std::memcpy(&half, tensor.data.data() + 2 * i, 2);
        numbers[i] = FromHalf(half);
      } else {
        throw std::invalid_argument(name);
      }
    }
    return numbers;
  }

  static Vector Product(const Vector& matrix, const Vector& x) {
    Vector y(matrix.size() / x.size(), 0.0);
    for (std::size_t o = 0; o < y.size(); ++o)
      for (std::size_t i = 0; i < x.size(); ++i) y[o] += matrix[o * x.size() + i] * x[i];
    return y;
  }

  Vector Linear(const std::string& name, const Vector& x) const {
    Vector y = Product(Numbers(name + ".weight"), x);
    const Vector bias = Numbers(name + ".bias");
    for (std::size_t o = 0; o < y.size(); ++o) y[o] += bias[o];
    return y;
  }

  Vector Normalised(const std::string& name, const Vector& x) const {
    const auto n = static_cast<double>(x.size());
    double mean = 0, variance = 0;
    for (const double value : x) mean += value / n;
    for (const double value : x) variance += (value - mean) * (value - mean) / n;
    const Vector weight = Numbers(name + ".weight"), bias = Numbers(name + ".bias");
    Vector y(x.size());
    for (std::size_t i = 0; i < x.size(); ++i) y[i] = (x[i] - mean) / std::sqrt(variance + 1e-5) * weight[i] + bias[i];
    return y;
  }

  // what token t reads from the tokens 0..t
  Vector Read(std::size_t t, const std::vector<Vector>& queries, const std::vector<Vector>& keys,
              const std::vector<Vector>& values) const {
    const std::size_t each = queries[t].size() / heads_;
    Vector read(queries[t].size(), 0.0);
    for (std::size_t head = 0; head < heads_; ++head) {
      Vector weights(t + 1, 0.0);
      double total = 0;
      for (std::size_t s = 0; s <= t; ++s) {
        for (std::size_t i = head * each; i < (head + 1) * each; ++i) weights[s] += queries[t][i] * keys[s][i];
        weights[s] = std::exp(weights[s] / std::sqrt(static_cast<double>(each)));
        total += weights[s];
      }
      for (std::size_t s = 0; s <= t; ++s)
        for (std::size_t i = head * each; i < (head + 1) * each; ++i) read[i] += weights[s] / total * values[s][i];
    }
    return read;
  }

  void Block(std::size_t layer, std::vector<Vector>& states) const {
    const std::string name = "text_model.encoder.layers." + std::to_string(layer) + ".";
    std::vector<Vector> queries, keys, values;
    for (const Vector& state : states) {
      const Vector x = Normalised(name + "layer_norm1", state);
      queries.push_back(Linear(name + "self_attn.q_proj", x));
      keys.push_back(Linear(name + "self_attn.k_proj", x));
      values.push_back(Linear(name + "self_attn.v_proj", x));
    }
    for (std::size_t t = 0; t < states.size(); ++t) {
      const Vector attended = Linear(name + "self_attn.out_proj", Read(t, queries, keys, values));
      for (std::size_t i = 0; i < attended.size(); ++i) states[t][i] += attended[i];
      Vector up = Linear(name + "mlp.fc1", Normalised(name + "layer_norm2", states[t]));
      for (double& value : up) value = value / (1 + std::exp(-1.702 * value));
      const Vector down = Linear(name + "mlp.fc2", up);
      for (std::size_t i = 0; i < down.size(); ++i) states[t][i] += down[i];
    }
  }

  const store::Safetensors& model_;
  const std::size_t layers_, heads_;
};

/// The largest difference of `mine` (n) from it.
inline double LargestDifference(const torch::Tensor& mine, const ReferenceTower::Vector& reference) {
  if (mine.numel() != static_cast<std::int64_t>(reference.size())) return INFINITY;
  double largest = 0;
  const torch::Tensor values = mine.to(torch::kFloat64).contiguous();
  for (std::size_t i = 0; i < reference.size(); ++i)
    largest = std::max(largest, std::abs(values.data_ptr<double>()[i] - reference[i]));
  return largest;
}

}  // namespace etude::clip
