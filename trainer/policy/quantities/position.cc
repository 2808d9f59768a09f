// SPDX-License-Identifier: Apache-2.0
// Where something is, m, in world at the picture's control step.
#include <algorithm>

#include "trainer/policy/quantities/common.h"

namespace etude::policy {
namespace {

using torch::Tensor;

class Position final : public Quantity {
 public:
  std::string_view name() const override { return "position"; }
  std::string_view unit() const override { return "m"; }
  std::string_view meaning() const override { return "x, y, z in world"; }

  std::vector<std::int64_t> label_shape() const override { return {3}; }
  void FillLabel(const data::LabelContext&, const data::EntityState& state, std::span<float> values,
                 std::span<std::uint8_t> valid) const override {
    if (!state.finite()) return;
    std::copy_n(state.p.begin(), 3, values.begin());
    valid[0] = 1;
  }

  int width(const Head&) const override { return 3; }
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

  Tensor Loss(const Head&, const LossesConfig& losses, const ModuleOutput& output, const Target& target,
              const PictureView&) const override {
    const Tensor loss = SmoothL1(output.decoded.at("position"), target.Clean(), losses.position).mean(-1);
    return Masked{losses.position.weight * loss, target.valid}.Mean();
  }

  std::vector<Metric> Measure(const Head&, const ModuleOutput& output, const Target& target) const override {
    return {{"cm", Distance(output.decoded.at("position"), target.value, 3), target.valid, 100, Metric::Role::kError}};
  }

  void Say(const Head&, const ModuleOutput& output, OrderedJson& words) const override {
    words["value"] = Rounded(output.decoded.at("position"));
  }
};

}  // namespace

const Quantity& PositionQuantity() {
  static const Position quantity;
  return quantity;
}

}  // namespace etude::policy
