// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/loss.h"

#include <algorithm>

#include "services/core/check.h"
#include "services/episode/action.h"
#include "trainer/policy/names.h"

namespace etude::policy {
namespace {

using torch::Tensor;

constexpr double kPatchSigma = 0.6;                            // patches
constexpr double kTiny = 1e-8;                                 // below it a logarithm's gradient is bounded
constexpr double kPixelWeight = 10, kPixelBeta = 0.01;         // of pixels / kPixelScale
constexpr double kPositionWeight = 20, kPositionBeta = 0.003;  // m
constexpr double kWaypointWeight = 2,
                 kWaypointBeta = 0.05;                // of metres / ModuleOutput::waypoint_scale
constexpr double kAngleWeight = 1, kAngleBeta = 0.1;  // of sines and cosines
constexpr double kGripperWeight = 0.5;

Tensor SmoothL1(const Tensor& value, const Tensor& label, double beta) {
  return torch::smooth_l1_loss(value, label, torch::Reduction::None, beta);
}

/// The label with its mask, or undefined.
struct Label {
  Tensor value, valid;
};
Label Find(const Labels& labels, const std::string& name) {
  const auto value = labels.find(name);
  if (value == labels.end()) return {};
  const auto valid = labels.find(name + ".valid");
  if (valid != labels.end()) return {value->second, valid->second};
  return {value->second,
          torch::ones({value->second.size(0), value->second.size(1)}, value->second.options().dtype(torch::kBool))};
}

/// What is not valid may be anything, NaN too: it becomes 0 before it meets a gradient.
Tensor Clean(const Label& label) {
  Tensor mask = label.valid;
  while (mask.dim() < label.value.dim()) mask = mask.unsqueeze(-1);
  return torch::where(mask, label.value, torch::zeros_like(label.value));
}

/// (B, S) whether each pixel lies in the crop.
Tensor InCrop(const Tensor& pixel, const Tensor& crop_origin, const TokenGrid& grid) {
  const Tensor at = pixel - crop_origin.unsqueeze(1);
  const Tensor u = at.select(-1, 0), v = at.select(-1, 1);
  return (u >= 0) & (v >= 0) & (u < grid.columns * grid.stride) & (v < grid.rows * grid.stride);
}

/// (B, S, P) 1 on the patch under each pixel (the nearest, outside).
Tensor NearestPatch(const Tensor& pixel, const Tensor& crop_origin, const TokenGrid& grid) {
  const Tensor at = torch::floor((pixel - crop_origin.unsqueeze(1)) / grid.stride).to(torch::kInt64);
  const Tensor column = at.select(-1, 0).clamp(0, grid.columns - 1);
  const Tensor row = at.select(-1, 1).clamp(0, grid.rows - 1);
  return torch::one_hot(row * grid.columns + column, grid.rows * grid.columns).to(pixel.scalar_type());
}

Tensor ClassLoss(const ModuleOutput& output, const Label& label) {
  const Tensor& logits = output.decoded.at("class");
  const auto sentences = std::max(logits.size(1), label.value.size(1));
  const Tensor log_p = torch::log_softmax(logits, -1).expand({logits.size(0), sentences, logits.size(2)});
  const Tensor index =
      torch::where(label.valid, label.value, torch::zeros_like(label.value)).expand({logits.size(0), sentences});
  return Masked{-log_p.gather(-1, index.unsqueeze(-1)).squeeze(-1), label.valid}.Mean();
}

/// Position (3), then sines and cosines (6) when there are.
Tensor PoseLoss(const Tensor& value, const Label& label) {
  const Tensor clean = Clean(label);
  Tensor loss = kPositionWeight * SmoothL1(value.narrow(-1, 0, 3), clean.narrow(-1, 0, 3), kPositionBeta).mean(-1);
  if (value.size(-1) > 3)
    loss = loss + kAngleWeight * SmoothL1(value.narrow(-1, 3, 6), clean.narrow(-1, 3, 6), kAngleBeta).mean(-1);
  return Masked{loss, label.valid}.Mean();
}

Tensor TrajectoryLoss(const ModuleOutput& output, const Label& label) {
  // labelled for the demonstrated command alone
  const Tensor value = output.decoded.at("trajectory").narrow(1, 0, 1);
  const Tensor logits = output.gripper_logits.narrow(1, 0, 1);
  Label points = label;
  if (points.valid.dim() == 2) points.valid = points.valid.unsqueeze(-1).expand(points.value.sizes().slice(0, 3));
  const Tensor clean = Clean(points);
  const Tensor scale = output.waypoint_scale.unsqueeze(-1);
  const Tensor loss =
      kWaypointWeight *
          SmoothL1(value.narrow(-1, 0, 3) / scale, clean.narrow(-1, 0, 3) / scale, kWaypointBeta).mean(-1) +
      kAngleWeight * SmoothL1(value.narrow(-1, 3, 6), clean.narrow(-1, 3, 6), kAngleBeta).mean(-1) +
      kGripperWeight * torch::binary_cross_entropy_with_logits(logits, clean.select(-1, kWaypointSize - 1), {}, {},
                                                               torch::Reduction::None);
  return Masked{loss, points.valid}.Mean();
}

}  // namespace

Tensor Masked::Mean() const {
  const Tensor mask = valid.expand(loss.sizes());
  return torch::where(mask, loss, torch::zeros_like(loss)).sum() / mask.sum().clamp_min(1);
}

// The Gaussian is separable, and so is its sum over the grid.
Tensor PatchTarget(const Tensor& pixel, const Tensor& crop_origin, const TokenGrid& grid) {
  const Tensor at = (pixel - crop_origin.unsqueeze(1)) / grid.stride;
  const auto along = [&](int axis, int count) {
    const Tensor centres = torch::arange(count, pixel.options()) + 0.5;
    const Tensor distance = (at.select(-1, axis).unsqueeze(-1) - centres) / kPatchSigma;
    return torch::softmax(-0.5 * distance.square(), -1);  // (B, S, count), sums to 1
  };
  return (along(1, grid.rows).unsqueeze(-1) * along(0, grid.columns).unsqueeze(-2)).flatten(2);
}

Masked AttentionLoss(const ModuleConfig& module, const std::string& form, const std::vector<std::string>& keys,
                     const ModuleOutput& output, const Labels& labels, const Tensor& crop_origin,
                     const TokenGrid& grid) {
  const Tensor& map = output.attention;
  const auto tokens = grid.rows * grid.columns;
  const bool image = !keys.empty() && keys[0] == "image";
  Tensor mass, valid = torch::ones({map.size(0), 1}, map.options().dtype(torch::kBool));
  const auto add = [&](const Tensor& part) { mass = mass.defined() ? mass + part : part; };
  for (const std::string& item : module.attend) {
    const auto at = item.find('@');
    if (at == std::string::npos) {
      const auto key = std::find(keys.begin(), keys.end(), item) - keys.begin();
      add(map.select(-1, image ? tokens + key - 1 : key));
      continue;
    }
    const Label label = Find(labels, item.substr(at + 1));
    if (!label.value.defined()) return {};
    const Tensor pixel = Clean(label);
    valid = valid & label.valid & InCrop(pixel, crop_origin, grid);
    const Tensor on_image = map.narrow(-1, 0, tokens);
    if (form == "log" && module.attend.size() == 1) {
      const Tensor target = PatchTarget(pixel, crop_origin, grid);
      return {-(target * torch::log(on_image + kTiny)).sum(-1), valid};
    }
    add((NearestPatch(pixel, crop_origin, grid) * on_image).sum(-1));
  }
  return {form == "log" ? -torch::log(mass + kTiny) : (mass - 1).square(), valid};
}

Tensor DecodeLoss(const ModuleConfig& module, const ModuleOutput& output, const Labels& labels,
                  const Tensor& crop_origin, const TokenGrid& grid) {
  const Label label = Find(labels, module.decoder.target);
  if (!label.value.defined()) return {};
  const std::string kind = DecodeKind(module.decoder.target);
  if (kind == "class") return ClassLoss(output, label);
  if (kind == "trajectory") return TrajectoryLoss(output, label);
  const Tensor& value = output.decoded.at(kind);
  if (kind != "pixel") return PoseLoss(value, label);
  const Tensor pixel = Clean(label);
  return Masked{kPixelWeight * SmoothL1(value / kPixelScale, pixel / kPixelScale, kPixelBeta).mean(-1),
                label.valid & InCrop(pixel, crop_origin, grid)}
      .Mean();
}

}  // namespace etude::policy
