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
  /// ray: where the way that another module's pixel looks (`from: [MODULE]`) meets the height that the network says,
  /// plus what it adds: well posed whatever camera took the picture, since the camera is told.
  std::vector<std::string> own_readouts() const override { return {"ray"}; }

  void FillLabel(const data::LabelContext&, const data::EntityState& state, std::span<float> values,
                 std::span<std::uint8_t> valid) const override {
    if (!state.finite()) return;
    std::copy_n(state.p.begin(), 3, values.begin());
    valid[0] = 1;
  }

  // begins on the ray at the middle height
  bool starts_at_zero(const Head& head) const override { return head.readout == "ray"; }
  void Decode(const Head& head, const Decoding& decoding, const Tensor& raw, ModuleOutput& output) const override {
    const Normalization& n = decoding.normalization;
    output.decoded["position"] =
        head.readout == "ray" ? OnRay(*decoding.from, n, raw) : n.position_mean + n.position_std * raw;
  }

  std::vector<std::string> statistics(const Head&) const override { return {"position"}; }
  int feature_width(const Head&, bool fourier) const override { return fourier ? kFourierWidth : 3; }
  Tensor Feature(const ModuleOutput& output, const Normalization& n, bool fourier, bool detach) const override {
    const Tensor position = PositionOf(output);
    const Tensor x = detach ? position.detach() : position;
    return fourier ? FourierFeatures(x) : (x - n.position_mean) / n.position_std;
  }

 protected:
  const SmoothL1Config& CostOf(const LossesConfig& losses) const override { return losses.position; }

 private:
  // a camera stands above what it looks at; of a pixel that looks up or ahead the point stays finite
  static Tensor OnRay(const Tensor& ray, const Normalization& n, const Tensor& raw) {
    constexpr double kLeastFall = 0.05;  // m down a metre along the camera's axis
    constexpr double kAside = 0.02;      // m, unit of what the network adds
    const Tensor height = n.position_mean.narrow(0, 2, 1) + n.position_std.narrow(0, 2, 1) * raw.narrow(-1, 2, 1);
    const Tensor origin = ray.narrow(-1, 0, 3), way = ray.narrow(-1, 3, 3);
    const Tensor length = (height - origin.narrow(-1, 2, 1)) / way.narrow(-1, 2, 1).clamp_max(-kLeastFall);
    const Tensor aside = origin.narrow(-1, 0, 2) + length * way.narrow(-1, 0, 2) + kAside * raw.narrow(-1, 0, 2);
    return torch::cat({aside, height}, -1);
  }
};

}  // namespace

const Quantity& PositionQuantity() {
  static const Position quantity;
  return quantity;
}

}  // namespace etude::policy
