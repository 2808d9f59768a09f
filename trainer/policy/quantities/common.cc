// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/quantities/common.h"

#include <algorithm>
#include <cmath>

#include "services/episode/pose.h"

namespace etude::policy {

using torch::Tensor;

Tensor SmoothL1(const Tensor& value, const Tensor& label, const SmoothL1Config& loss) {
  return torch::smooth_l1_loss(value, label, torch::Reduction::None, loss.beta);
}

Tensor Distance(const Tensor& a, const Tensor& b, int columns) {
  return (a.narrow(-1, 0, columns) - b.narrow(-1, 0, columns)).norm(2, -1);
}

Tensor InView(const Tensor& pixel, const PictureView& view) {
  Tensor origin = view.crop_origin;
  while (origin.dim() < pixel.dim()) origin = origin.unsqueeze(1);
  const Tensor at = pixel - origin;
  const Tensor u = at.select(-1, 0), v = at.select(-1, 1);
  return (u >= 0) & (v >= 0) & (u < view.width) & (v < view.height);
}

Tensor FourierFeatures(const Tensor& metres) {
  constexpr int kWavelengths = kFourierWidth / 6;
  constexpr double kLongest = 0.64;  // m
  std::vector<Tensor> parts;
  for (int k = 0; k < kWavelengths; ++k) {
    const Tensor phase = metres * (2 * M_PI * (1 << k) / kLongest);
    parts.push_back(torch::sin(phase));
    parts.push_back(torch::cos(phase));
  }
  return torch::cat(parts, -1);
}

OrderedJson Rounded(const Tensor& tensor) {
  const Tensor flat = tensor.select(0, 0).select(0, 0).to(torch::kCPU, torch::kFloat32).contiguous().view({-1});
  auto list = OrderedJson::array();
  for (std::int64_t i = 0; i < flat.numel(); ++i) {
    const float value = flat.data_ptr<float>()[i];
    list.push_back(std::isfinite(value) ? OrderedJson(std::round(value * 1e5) / 1e5) : OrderedJson(nullptr));
  }
  return list;
}

void PutPose(const data::EntityState& state, std::span<float> values) {
  const Eigen::Quaterniond q(state.q[0], state.q[1], state.q[2], state.q[3]);
  const Rotation6D rotation = ToRotation6D(q.normalized());
  std::copy_n(state.p.begin(), 3, values.begin());
  std::copy(rotation.begin(), rotation.end(), values.begin() + 3);
}

}  // namespace etude::policy
