// SPDX-License-Identifier: Apache-2.0
// Where in the camera's picture something is, px: its exact perspective projection.
#include "trainer/policy/quantities/common.h"

namespace etude::policy {
namespace {

using torch::Tensor;

class Pixel final : public Quantity {
 public:
  std::string_view name() const override { return "pixel"; }
  std::string_view unit() const override { return "px"; }
  std::string_view meaning() const override { return "u to the right and v down in the camera's picture"; }
  /// soft_argmax: the expectation of its own attention over the picture, plus what the network adds.
  std::vector<std::string> own_readouts() const override { return {"soft_argmax"}; }
  // a set for attention; heads say one pixel
  bool IsOf(const data::Entity& entity) const override { return entity.is_thing() || entity.is_set(); }

  std::vector<std::int64_t> label_shape() const override { return {2}; }
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

  int width(const Head&) const override { return 2; }
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

  Tensor Loss(const Head&, const LossesConfig& losses, const ModuleOutput& output, const Target& target,
              const PictureView& view) const override {
    const Tensor pixel = target.Clean();
    const Tensor loss = SmoothL1(output.decoded.at("pixel") / kPixelScale, pixel / kPixelScale, losses.pixel).mean(-1);
    return Masked{losses.pixel.weight * loss, target.valid & InView(pixel, view)}.Mean();
  }

  std::vector<Metric> Measure(const Head&, const ModuleOutput& output, const Target& target) const override {
    return {{"px", Distance(output.decoded.at("pixel"), target.value, 2), target.valid, 1, Metric::Role::kError}};
  }

  void Say(const Head&, const ModuleOutput& output, OrderedJson& words) const override {
    words["value"] = Rounded(output.decoded.at("pixel"));
  }
};

}  // namespace

const Quantity& PixelQuantity() {
  static const Pixel quantity;
  return quantity;
}

}  // namespace etude::policy
