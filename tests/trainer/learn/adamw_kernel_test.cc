// SPDX-License-Identifier: Apache-2.0
// Tests trainer/learn/adamw_kernel.cc
#include "trainer/learn/adamw_kernel.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "services/core/rng.h"

namespace etude::learn {
namespace adamw_kernel_test {

TEST(UpdateAdamw, AgreesWithTheFormulasInDoublePrecision) {
  Rng rng(1);
  constexpr std::size_t kN = 37;  // not a multiple of any vector width
  std::vector<float> parameter(kN), first(kN), second(kN), gradient(kN);
  std::vector<double> p(kN), m(kN), v(kN);
  for (std::size_t i = 0; i < kN; ++i) p[i] = parameter[i] = static_cast<float>(rng.Normal());

  for (int t = 1; t <= 20; ++t) {
    for (float& g : gradient) g = static_cast<float>(rng.Normal());
    AdamwStep step;
    step.lr = 0.01f;
    step.beta1 = 0.9f;
    step.beta2 = 0.98f;
    step.epsilon = 1e-8f;
    step.decay = 0.1f;
    step.correction1 = static_cast<float>(1 - std::pow(0.9, t));
    step.correction2 = static_cast<float>(1 - std::pow(0.98, t));
    step.scale = 0.5f;
    UpdateAdamw(step, kN, gradient.data(), first.data(), second.data(), parameter.data());
    for (std::size_t i = 0; i < kN; ++i) {
      const double g = 0.5 * gradient[i];
      m[i] = 0.9 * m[i] + 0.1 * g;
      v[i] = 0.98 * v[i] + 0.02 * g * g;
      p[i] -= 0.01 * 0.1 * p[i];
      p[i] -= 0.01 * (m[i] / (1 - std::pow(0.9, t))) / (std::sqrt(v[i] / (1 - std::pow(0.98, t))) + 1e-8);
    }
  }
  for (std::size_t i = 0; i < kN; ++i) EXPECT_NEAR(parameter[i], p[i], 1e-5) << i;
}

TEST(SumOfSquares, IsExactEnoughOverManyValues) {
  std::vector<float> values(100003, 0.1f);
  EXPECT_NEAR(SumOfSquares(values.data(), values.size()), 100003 * 0.01, 1e-2);
  values[50000] = std::nanf("");
  EXPECT_TRUE(std::isnan(SumOfSquares(values.data(), values.size())));
}

TEST(Average, MovesTowardsTheValue) {
  const std::vector<float> value(9, 1.0f);
  std::vector<float> average(9, 0.0f);
  Average(9, 0.75f, value.data(), average.data());
  for (float x : average) EXPECT_FLOAT_EQ(x, 0.25f);
}

}  // namespace adamw_kernel_test
}  // namespace etude::learn
