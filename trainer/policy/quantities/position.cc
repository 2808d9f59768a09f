// SPDX-License-Identifier: Apache-2.0
// Where something is, m, in world at the picture's control step.
#include <algorithm>

#include "trainer/policy/quantities/point.h"

namespace etude::policy {
namespace {

using torch::Tensor;

class Position final : public Point {
 public:
  Position() : Point("position", "m", "x, y, z in world", 3) {}

  void FillLabel(const data::LabelContext&, const data::EntityState& state, std::span<float> values,
                 std::span<std::uint8_t> valid) const override {
    if (!state.finite()) return;
    std::copy_n(state.p.begin(), 3, values.begin());
    valid[0] = 1;
  }

  void Decode(const Head&, const Decoding& decoding, const Tensor& raw, ModuleOutput& output) const override {
    const Normalization& n = decoding.normalization;
    output.decoded["position"] = n.position_mean + n.position_std * raw;
  }

  int feature_width(const Head&, bool fourier) const override { return fourier ? kFourierWidth : 3; }
  Tensor Feature(const ModuleOutput& output, const Normalization& n, bool fourier, bool detach) const override {
    const Tensor position = PositionOf(output);
    const Tensor x = detach ? position.detach() : position;
    return fourier ? FourierFeatures(x) : (x - n.position_mean) / n.position_std;
  }

 protected:
  const SmoothL1Config& CostOf(const LossesConfig& losses) const override { return losses.position; }
};

}  // namespace

const Quantity& PositionQuantity() {
  static const Position quantity;
  return quantity;
}

}  // namespace etude::policy
