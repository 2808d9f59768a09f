// SPDX-License-Identifier: Apache-2.0
// Where in the camera's picture something is, px: its exact perspective projection.
#include "trainer/policy/quantities/point.h"

namespace etude::policy {
namespace {

using torch::Tensor;

class Pixel final : public Point {
 public:
  Pixel() : Point("pixel", "px", "u to the right and v down in the camera's picture", 2) {}
  /// soft_argmax: the expectation of its own attention over the picture, plus what the network adds.
  std::vector<std::string> own_readouts() const override { return {"soft_argmax"}; }
  // a set for attention; heads say one pixel
  bool IsOf(const data::Entity& entity) const override { return entity.is_thing() || entity.is_set(); }

  void FillLabel(const data::LabelContext& context, const data::EntityState& state, std::span<float> values,
                 std::span<std::uint8_t> valid) const override {
    const auto& view = context.view;
    const float u = state.pixel[0], v = state.pixel[1];
    const auto low_u = static_cast<float>(view.u), low_v = static_cast<float>(view.v);
    // written so that NaN is outside
    const bool seen = u >= low_u && v >= low_v && u < low_u + static_cast<float>(view.width) &&
                      v < low_v + static_cast<float>(view.height);
    if (!seen || !state.finite()) return;
    values[0] = u;
    values[1] = v;
    valid[0] = 1;
  }

  bool starts_at_zero(const Head& head) const override { return head.readout == "soft_argmax"; }
  void Decode(const Head& head, const Decoding& decoding, const Tensor& raw, ModuleOutput& output) const override {
    output.decoded["pixel"] =
        head.readout == "soft_argmax" ? output.soft_argmax + 2.0 * decoding.stride * raw : kPixelScale * (1 + raw);
  }

  int feature_width(const Head&, bool fourier) const override { return fourier ? 0 : 2; }
  Tensor Feature(const ModuleOutput& output, const Normalization&, bool, bool detach) const override {
    const Tensor& pixel = output.decoded.at("pixel");
    return (detach ? pixel.detach() : pixel) / kPixelScale - 1;
  }

 protected:
  const SmoothL1Config& CostOf(const LossesConfig& losses) const override { return losses.pixel; }
  double cost_unit() const override { return kPixelScale; }
  Tensor Counts(const Tensor& label, const PictureView& view) const override { return InView(label, view); }
  double metric_scale() const override { return 1; }
};

}  // namespace

const Quantity& PixelQuantity() {
  static const Pixel quantity;
  return quantity;
}

}  // namespace etude::policy
