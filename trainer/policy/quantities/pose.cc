// SPDX-License-Identifier: Apache-2.0
// Position (m) and rotation of something, in world at the picture's control step: 3 + 6 numbers.
#include "trainer/policy/quantities/common.h"
#include "trainer/policy/quantities/rotation.h"

namespace etude::policy {
namespace {

using torch::Tensor;

class Pose final : public Quantity {
 public:
  Pose() : Quantity("pose", "m", "x, y, z in world, then the rotation in 6D") {}
  bool Implies(std::string_view other) const override { return other == "pose" || other == "position"; }

  std::vector<std::int64_t> label_shape() const override { return {9}; }
  void FillLabel(const data::LabelContext&, const data::EntityState& state, std::span<float> values,
                 std::span<std::uint8_t> valid) const override {
    if (!state.finite()) return;
    PutPose(state, values);
    valid[0] = 1;
  }

  int width(const Head&) const override { return 9; }
  void Decode(const Head&, const Decoding& decoding, const Tensor& raw, ModuleOutput& output) const override {
    const Normalization& n = decoding.normalization;
    output.decoded["pose"] =
        torch::cat({n.position_mean + n.position_std * raw.narrow(-1, 0, 3), raw.narrow(-1, 3, 6)}, -1);
  }

  std::vector<std::string> statistics(const Head&) const override { return {"position"}; }

  Tensor Loss(const Head& head, const LossesConfig& losses, const ModuleOutput& output, const Target& target,
              const PictureView&) const override {
    const Tensor& said = output.decoded.at("pose");
    const Tensor label = target.Clean();
    const Tensor place = SmoothL1(said.narrow(-1, 0, 3), label.narrow(-1, 0, 3), losses.position).mean(-1);
    const Tensor wanted = ToForm(label.narrow(-1, 3, 6), head.rotation);
    const Tensor turn = SmoothL1(said.narrow(-1, 3, 6), wanted, losses.rotation).mean(-1);
    return Masked{losses.position.weight * place + losses.rotation.weight * turn, target.valid}.Mean();
  }

  std::vector<Metric> Measure(const Head& head, const ModuleOutput& output, const Target& target) const override {
    const Tensor& said = output.decoded.at("pose");
    const Tensor degrees = AngleDegrees(said.narrow(-1, 3, 6), head.rotation, target.value.narrow(-1, 3, 6));
    return {{"cm", Distance(said, target.value, 3), target.valid, 100, Metric::Role::kError},
            {"deg", degrees, target.valid}};
  }

  void Say(const Head& head, const ModuleOutput& output, OrderedJson& words) const override {
    const Tensor& said = output.decoded.at("pose");
    words["value"] = Rounded(WithRotation(said, 3, To6D(said.narrow(-1, 3, 6), head.rotation)));
  }
};

}  // namespace

const Quantity& PoseQuantity() {
  static const Pose quantity;
  return quantity;
}

}  // namespace etude::policy
