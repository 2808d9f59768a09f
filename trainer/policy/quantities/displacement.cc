// SPDX-License-Identifier: Apache-2.0
// The way from the end-effector to something, m.
#include "trainer/policy/quantities/common.h"

namespace etude::policy {
namespace {

using torch::Tensor;

class Displacement final : public Quantity {
 public:
  std::string_view name() const override { return "displacement"; }
  std::string_view unit() const override { return "m"; }
  std::string_view meaning() const override { return "its position less the end-effector's"; }
  /// difference: of the positions of two modules (`from: [A, B]`, B - A), plus what the network adds.
  std::vector<std::string> own_readouts() const override { return {"difference"}; }
  bool IsOf(const data::Entity& entity) const override {
    return entity.kind != data::Entity::Kind::kEe && entity.is_thing();
  }

  std::vector<std::int64_t> label_shape() const override { return {3}; }
  void FillLabel(const data::LabelContext& context, const data::EntityState& state, std::span<float> values,
                 std::span<std::uint8_t> valid) const override {
    if (!state.finite()) return;
    const auto hand = data::HandState(context.episode, context.step).p;
    for (std::size_t i = 0; i < 3; ++i) values[i] = state.p[i] - hand[i];
    valid[0] = 1;
  }

  int width(const Head&) const override { return 3; }
  bool starts_at_zero(const Head& head) const override { return head.readout == "difference"; }
  void Decode(const Head& head, const Decoding& decoding, const Tensor& raw, ModuleOutput& output) const override {
    const Tensor own = decoding.normalization.displacement_std * raw;
    output.decoded["displacement"] = head.readout == "difference" ? own + *decoding.from : own;
  }

  int feature_width(const Head&, bool fourier) const override { return fourier ? kFourierWidth : 3; }
  Tensor Feature(const ModuleOutput& output, const Normalization& n, bool fourier, bool detach) const override {
    const Tensor& displacement = output.decoded.at("displacement");
    const Tensor x = detach ? displacement.detach() : displacement;
    return fourier ? FourierFeatures(x) : x / n.displacement_std;
  }

  Tensor Loss(const Head&, const LossesConfig& losses, const ModuleOutput& output, const Target& target,
              const PictureView&) const override {
    const Tensor loss = SmoothL1(output.decoded.at("displacement"), target.Clean(), losses.displacement).mean(-1);
    return Masked{losses.displacement.weight * loss, target.valid}.Mean();
  }

  std::vector<Metric> Measure(const Head&, const ModuleOutput& output, const Target& target) const override {
    const Tensor distance = Distance(output.decoded.at("displacement"), target.value, 3);
    return {{"cm", distance, target.valid, 100, Metric::Role::kError}};
  }

  void Say(const Head&, const ModuleOutput& output, OrderedJson& words) const override {
    words["value"] = Rounded(output.decoded.at("displacement"));
  }
};

}  // namespace

const Quantity& DisplacementQuantity() {
  static const Displacement quantity;
  return quantity;
}

}  // namespace etude::policy
