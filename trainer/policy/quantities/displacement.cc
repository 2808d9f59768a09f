// SPDX-License-Identifier: Apache-2.0
// The way from the end-effector to something, m.
#include "trainer/policy/quantities/point.h"

namespace etude::policy {
namespace {

using torch::Tensor;

class Displacement final : public Point {
 public:
  Displacement() : Point("displacement", "m", "its position less the end-effector's", 3) {}
  /// difference: of the positions of two modules (`from: [A, B]`, B - A), plus what the network adds.
  std::vector<std::string> own_readouts() const override { return {"difference"}; }
  bool IsOf(const data::Entity& entity) const override {
    return entity.kind != data::Entity::Kind::kEe && entity.is_thing();
  }

  void FillLabel(const data::LabelContext& context, const data::EntityState& state, std::span<float> values,
                 std::span<std::uint8_t> valid) const override {
    if (!state.finite()) return;
    const auto hand = data::HandState(context.episode, context.step).p;
    for (std::size_t i = 0; i < 3; ++i) values[i] = state.p[i] - hand[i];
    valid[0] = 1;
  }

  bool starts_at_zero(const Head& head) const override { return head.readout == "difference"; }
  void Decode(const Head& head, const Decoding& decoding, const Tensor& raw, ModuleOutput& output) const override {
    const Tensor own = decoding.normalization.displacement_std * raw;
    output.decoded["displacement"] = head.readout == "difference" ? own + *decoding.from : own;
  }

  std::vector<std::string> statistics(const Head&) const override { return {"displacement"}; }
  int feature_width(const Head&, bool fourier) const override { return fourier ? kFourierWidth : 3; }
  Tensor Feature(const ModuleOutput& output, const Normalization& n, bool fourier, bool detach) const override {
    const Tensor& displacement = output.decoded.at("displacement");
    const Tensor x = detach ? displacement.detach() : displacement;
    return fourier ? FourierFeatures(x) : x / n.displacement_std;
  }

 protected:
  const SmoothL1Config& CostOf(const LossesConfig& losses) const override { return losses.displacement; }
};

}  // namespace

const Quantity& DisplacementQuantity() {
  static const Displacement quantity;
  return quantity;
}

}  // namespace etude::policy
