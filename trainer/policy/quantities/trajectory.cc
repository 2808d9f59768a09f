// SPDX-License-Identifier: Apache-2.0
// The end-effector's next waypoints (services/episode/action.h): (12, 10) numbers, for the demonstrated command alone.
#include <algorithm>

#include "services/episode/action.h"
#include "services/episode/trajectory_label.h"
#include "trainer/policy/quantities/common.h"
#include "trainer/policy/quantities/rotation.h"

namespace etude::policy {
namespace {

using torch::Tensor;

constexpr int kGripper = kWaypointSize - 1;
constexpr double kSure = 1e-4;  // a gripper's probability is corrected as a logit, which is finite from here on

class Trajectory final : public Quantity {
 public:
  Trajectory() : Quantity("trajectory", "m", "waypoints over the next 120 control steps") {}
  /// relative: offsets from the position of another module (`from: [MODULE]`). correction: what is added to another
  /// module's trajectory, at first nothing (residual policies, Silver et al. 2018).
  std::vector<std::string> own_readouts() const override { return {"relative", "correction"}; }
  bool starts_at_zero(const Head& head) const override { return head.readout == "correction"; }
  bool IsOf(const data::Entity& entity) const override { return entity.kind == data::Entity::Kind::kEe; }

  std::vector<std::int64_t> label_shape() const override { return {kWaypoints, kWaypointSize}; }
  int label_parts() const override { return kWaypoints; }
  void FillLabel(const data::LabelContext& context, const data::EntityState&, std::span<float> values,
                 std::span<std::uint8_t> valid) const override {
    const TrajectoryLabel label = LabelTrajectory(context.episode, context.step);
    std::copy(label.values.begin(), label.values.end(), values.begin());
    std::copy(label.valid.begin(), label.valid.end(), valid.begin());
  }

  int width(const Head&) const override { return kWaypoints * kWaypointSize; }
  void Decode(const Head& head, const Decoding& decoding, const Tensor& raw, ModuleOutput& output) const override {
    const Normalization& n = decoding.normalization;
    const Tensor points = raw.unflatten(-1, {kWaypoints, kWaypointSize});
    Tensor xyz = points.narrow(-1, 0, 3), rotation = points.narrow(-1, 3, 6), gripper = points.select(-1, kGripper);
    if (head.readout == "correction") {
      xyz = decoding.from->narrow(-1, 0, 3) + n.offset_std * xyz;
      rotation = decoding.from->narrow(-1, 3, 6) + rotation;
      gripper = torch::logit(decoding.from->select(-1, kGripper), kSure) + gripper;
    } else {
      xyz = head.readout == "relative" ? decoding.from->unsqueeze(2) + n.offset_std * xyz
                                       : n.position_mean + n.position_std * xyz;
    }
    output.waypoint_scale = n.offset_std.mean(-1);
    output.gripper_logits = gripper;
    output.decoded["trajectory"] = torch::cat({xyz, rotation, torch::sigmoid(gripper).unsqueeze(-1)}, -1);
  }

  std::vector<std::string> statistics(const Head& head) const override {
    if (head.readout == "relative" || head.readout == "correction") return {"offset"};
    return {"position", "offset"};
  }

  // its form alone, wherever the hand is: how far each waypoint is from the first one, and the gripper
  int feature_width(const Head&, bool /*fourier*/) const override { return kWaypoints * 4; }
  Tensor Feature(const ModuleOutput& output, const Normalization& n, bool /*fourier*/, bool detach) const override {
    const Tensor& said = output.decoded.at("trajectory");
    const Tensor plan = detach ? said.detach() : said;
    const Tensor xyz = plan.narrow(-1, 0, 3);
    return torch::cat({(xyz - xyz.narrow(-2, 0, 1)) / n.offset_std, plan.narrow(-1, kGripper, 1)}, -1).flatten(-2);
  }

  Tensor Loss(const Head& head, const LossesConfig& losses, const ModuleOutput& output, const Target& target,
              const PictureView&) const override {
    const Tensor value = output.decoded.at("trajectory").narrow(1, 0, 1);
    const Tensor logits = output.gripper_logits.narrow(1, 0, 1);
    const Target points = OfWaypoints(target);
    const Tensor clean = points.Clean();
    const Tensor scale = output.waypoint_scale.unsqueeze(-1);
    const Tensor wanted = ToForm(clean.narrow(-1, 3, 6), head.rotation);
    const Tensor loss =
        losses.waypoint.weight *
            SmoothL1(value.narrow(-1, 0, 3) / scale, clean.narrow(-1, 0, 3) / scale, losses.waypoint).mean(-1) +
        losses.rotation.weight * SmoothL1(value.narrow(-1, 3, 6), wanted, losses.rotation).mean(-1) +
        losses.gripper.weight *
            torch::binary_cross_entropy_with_logits(logits, clean.select(-1, kGripper), {}, {}, torch::Reduction::None);
    return Masked{loss, points.valid}.Mean();
  }

  std::vector<Metric> Measure(const Head& head, const ModuleOutput& output, const Target& target) const override {
    const Tensor said = output.decoded.at("trajectory").narrow(1, 0, 1);
    const Target points = OfWaypoints(target);
    const Tensor distance = Distance(said, points.value, 3);
    const Tensor angle = AngleDegrees(said.narrow(-1, 3, 6), head.rotation, points.value.narrow(-1, 3, 6));
    const Tensor same = (said.select(-1, kGripper) > 0.5) == (points.value.select(-1, kGripper) > 0.5);
    return {{"cm", distance, points.valid, 100, Metric::Role::kError},
            {"first_cm", distance.select(-1, 0), points.valid.select(-1, 0), 100},
            {"deg", angle, points.valid},
            {"gripper", same, points.valid}};
  }

  void Say(const Head& head, const ModuleOutput& output, OrderedJson& words) const override {
    const Tensor& said = output.decoded.at("trajectory");
    words["value"] = Rounded(WithRotation(said, 3, To6D(said.narrow(-1, 3, 6), head.rotation)));
  }

 private:
  // a mask a waypoint, also where the label has one a sample
  static Target OfWaypoints(Target target) {
    if (target.valid.dim() == 2) target.valid = target.valid.unsqueeze(-1).expand(target.value.sizes().slice(0, 3));
    return target;
  }
};

}  // namespace

const Quantity& TrajectoryQuantity() {
  static const Trajectory quantity;
  return quantity;
}

}  // namespace etude::policy
