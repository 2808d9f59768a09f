// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/loss.h"

#include <algorithm>

#include "trainer/policy/names.h"
#include "trainer/policy/quantities/common.h"

namespace etude::policy {
namespace {

using torch::Tensor;

constexpr double kTiny = 1e-8;  // below it a logarithm's gradient is bounded

PictureView ViewOf(const Tensor& crop_origin, const TokenGrid& grid) {
  return {crop_origin, grid.columns * grid.stride, grid.rows * grid.stride};
}

/// (B, S, P) 1 on the patch under each pixel (the nearest, outside).
Tensor NearestPatch(const Tensor& pixel, const Tensor& crop_origin, const TokenGrid& grid) {
  const Tensor at = torch::floor((pixel - crop_origin.unsqueeze(1)) / grid.stride).to(torch::kInt64);
  const Tensor column = at.select(-1, 0).clamp(0, grid.columns - 1);
  const Tensor row = at.select(-1, 1).clamp(0, grid.rows - 1);
  return torch::one_hot(row * grid.columns + column, grid.rows * grid.columns).to(pixel.scalar_type());
}

/// Where an entity's pixels are, as weights of patches (B, S, P), and which samples have one in the crop (B, S).
struct Patches {
  Tensor weight, valid;
};

/// One of each sample: `patch` of it. Of a set the mean (`spread`, a distribution) or the union (a mask) of those in
/// view.
template <class Patch>
Patches PatchesOf(const Target& target, const PictureView& view, bool spread, Patch&& patch) {
  const Tensor pixel = target.Clean();
  const Tensor seen = target.valid & InView(pixel, view);
  if (pixel.dim() == 3) return {patch(pixel), seen};
  const auto slots = pixel.size(2);
  Tensor sum;
  for (std::int64_t k = 0; k < slots; ++k) {
    const Tensor one = patch(pixel.select(2, k)) * seen.select(2, k).unsqueeze(-1);
    sum = !sum.defined() ? one : spread ? sum + one : torch::maximum(sum, one);
  }
  const Tensor count = seen.sum(2).unsqueeze(-1).clamp_min(1);
  return {spread ? sum / count : sum, seen.any(2)};
}

}  // namespace

Target FindTarget(const Labels& labels, const std::string& name) {
  const auto value = labels.find(name);
  if (value == labels.end()) return {};
  const auto valid = labels.find(name + ".valid");
  if (valid != labels.end()) return {value->second, valid->second};
  return {value->second,
          torch::ones({value->second.size(0), value->second.size(1)}, value->second.options().dtype(torch::kBool))};
}

// The Gaussian is separable, and so is its sum over the grid.
Tensor PatchTarget(const Tensor& pixel, const Tensor& crop_origin, const TokenGrid& grid, double sigma) {
  const Tensor at = (pixel - crop_origin.unsqueeze(1)) / grid.stride;
  const auto along = [&](int axis, int count) {
    const Tensor centres = torch::arange(count, pixel.options()) + 0.5;
    const Tensor distance = (at.select(-1, axis).unsqueeze(-1) - centres) / sigma;
    return torch::softmax(-0.5 * distance.square(), -1);  // (B, S, count), sums to 1
  };
  return (along(1, grid.rows).unsqueeze(-1) * along(0, grid.columns).unsqueeze(-2)).flatten(2);
}

Masked AttentionLoss(const ModuleConfig& module, const AttentionLossConfig& form, const std::vector<std::string>& keys,
                     const ModuleOutput& output, const Labels& labels, const Tensor& crop_origin,
                     const TokenGrid& grid) {
  const Tensor& map = output.attention;
  const auto tokens = grid.rows * grid.columns;
  const bool image = !keys.empty() && keys[0] == "image";
  const bool log = form.kind == "log";
  const PictureView view = ViewOf(crop_origin, grid);
  const bool each = form.kind == "mse_each";
  const double share = 1.0 / static_cast<double>(module.attend.size());
  Tensor sum, valid = torch::ones({map.size(0), 1}, map.options().dtype(torch::kBool));
  const auto add = [&](const Tensor& part) {
    const Tensor term = each ? (part / share - 1).square() * share : part;
    sum = sum.defined() ? sum + term : term;
  };
  for (const std::string& item : module.attend) {
    const std::string entity = AttendedEntity(item);
    if (entity.empty()) {
      const auto key = std::find(keys.begin(), keys.end(), item) - keys.begin();
      add(map.select(-1, image ? tokens + key - 1 : key));
      continue;
    }
    Target target = FindTarget(labels, entity + ".pixel");
    if (!target.value.defined()) return {};
    // the demonstrated sentence's, which comes first, where the module was asked about no other
    if (map.size(1) == 1) target = {target.value.narrow(1, 0, 1), target.valid.narrow(1, 0, 1)};
    const Tensor on_image = map.narrow(-1, 0, tokens);
    if (log && module.attend.size() == 1) {
      const Patches patches = PatchesOf(target, view, true, [&](const Tensor& pixel) {
        return PatchTarget(pixel, crop_origin, grid, form.patch_sigma);
      });
      return {-(patches.weight * torch::log(on_image + kTiny)).sum(-1), patches.valid};
    }
    const Patches patches =
        PatchesOf(target, view, false, [&](const Tensor& pixel) { return NearestPatch(pixel, crop_origin, grid); });
    valid = valid & patches.valid;
    add((patches.weight * on_image).sum(-1));
  }
  if (each) return {sum, valid};
  return {log ? -torch::log(sum + kTiny) : (sum - 1).square(), valid};
}

Tensor DecodeLoss(const PolicyConfig& policy, const ModuleConfig& module, const ModuleOutput& output,
                  const Labels& labels, const Tensor& crop_origin, const TokenGrid& grid) {
  const Target target = FindTarget(labels, module.decoder.label());
  if (!target.value.defined()) return {};
  return QuantityOf(module)->Loss(HeadOf(policy, module), policy.losses, output, target, ViewOf(crop_origin, grid));
}

}  // namespace etude::policy
