// SPDX-License-Identifier: Apache-2.0
// The arithmetic of one AdamW update on plain arrays.
#pragma once

#include <cstddef>

namespace etude::learn {

struct AdamwStep {
  float lr = 0, beta1 = 0, beta2 = 0, epsilon = 0, decay = 0;
  float correction1 = 1, correction2 = 1;  ///< 1 - beta^t
  float scale = 1;                         ///< of the gradient (clipping, averaging)
};

/// Sum of squares, the same for the same input on the same machine.
double SumOfSquares(const float* values, std::size_t n);
/// Updates n parameters and their moments.
void UpdateAdamw(const AdamwStep& step, std::size_t n, const float* gradient, float* first, float* second,
                 float* parameter);
/// into += from
void AddInto(std::size_t n, const float* from, float* into);
/// average = decay * average + (1 - decay) * value
void Average(std::size_t n, float decay, const float* value, float* average);

}  // namespace etude::learn
