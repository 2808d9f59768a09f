// SPDX-License-Identifier: Apache-2.0
// Compiled with -O3 (see CMakeLists.txt): these loops are memory-bound once they are vectorised.
#include "trainer/learn/adamw_kernel.h"

#include <algorithm>
#include <cmath>

namespace etude::learn {

double SumOfSquares(const float* values, std::size_t n) {
  // eight lanes of float over short blocks: fast, and exact enough for a norm
  constexpr std::size_t kBlock = 1024;
  double total = 0;
  for (std::size_t start = 0; start < n; start += kBlock) {
    const std::size_t end = std::min(n, start + kBlock);
    float lanes[8] = {};
    std::size_t i = start;
    for (; i + 8 <= end; i += 8)
      for (std::size_t j = 0; j < 8; ++j) lanes[j] += values[i + j] * values[i + j];
    for (; i < end; ++i) lanes[0] += values[i] * values[i];
    for (float lane : lanes) total += lane;
  }
  return total;
}

void UpdateAdamw(const AdamwStep& step, std::size_t n, const float* __restrict gradient, float* __restrict first,
                 float* __restrict second, float* __restrict parameter) {
  const float keep = 1 - step.lr * step.decay;
  const float rate = step.lr / step.correction1;
  const float inverse2 = 1 / step.correction2;
  for (std::size_t i = 0; i < n; ++i) {
    const float g = gradient[i] * step.scale;
    first[i] = step.beta1 * first[i] + (1 - step.beta1) * g;
    second[i] = step.beta2 * second[i] + (1 - step.beta2) * g * g;
    parameter[i] = keep * parameter[i] - rate * first[i] / (std::sqrt(second[i] * inverse2) + step.epsilon);
  }
}

void AddInto(std::size_t n, const float* __restrict from, float* __restrict into) {
  for (std::size_t i = 0; i < n; ++i) into[i] += from[i];
}

void Average(std::size_t n, float decay, const float* __restrict value, float* __restrict average) {
  for (std::size_t i = 0; i < n; ++i) average[i] = decay * average[i] + (1 - decay) * value[i];
}

}  // namespace etude::learn
