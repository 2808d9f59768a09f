// SPDX-License-Identifier: Apache-2.0
// Which class of objects a sentence means: logits over the policy's nouns.
#include <algorithm>
#include <cmath>

#include "services/spec/object_names.h"
#include "trainer/policy/quantities/common.h"

namespace etude::policy {
namespace {

using torch::Tensor;

class Class final : public Quantity {
 public:
  std::string_view name() const override { return "class"; }
  std::string_view unit() const override { return "-"; }
  std::string_view meaning() const override { return "which of the policy's objects the sentence means"; }
  bool IsOf(const data::Entity& entity) const override { return entity.per_sentence() && !entity.is_set(); }

  std::vector<std::int64_t> label_shape() const override { return {}; }
  // a sentence says "apple", never which one
  void FillLabel(const data::LabelContext& context, const data::EntityState& state, std::span<float> values,
                 std::span<std::uint8_t> valid) const override {
    const auto& classes = context.classes;
    const auto known = std::find(classes.begin(), classes.end(), ObjectNoun(std::string(state.name)));
    if (known == classes.end()) return;
    values[0] = static_cast<float>(known - classes.begin());
    valid[0] = 1;
  }

  int width(const Head& head) const override { return static_cast<int>(head.classes.size()); }
  void Decode(const Head&, const Decoding&, const Tensor& raw, ModuleOutput& output) const override {
    output.decoded["class"] = raw;
  }

  int feature_width(const Head& head, bool fourier) const override { return fourier ? 0 : width(head); }
  Tensor Feature(const ModuleOutput& output, const Normalization&, bool, bool detach) const override {
    const Tensor probability = torch::softmax(output.decoded.at("class"), -1);
    return detach ? probability.detach() : probability;
  }

  Tensor Loss(const Head&, const LossesConfig& losses, const ModuleOutput& output, const Target& target,
              const PictureView&) const override {
    const Tensor& logits = output.decoded.at("class");
    const auto sentences = std::max(logits.size(1), target.value.size(1));
    const Tensor log_p = torch::log_softmax(logits, -1).expand({logits.size(0), sentences, logits.size(2)});
    const Tensor index = target.Clean().to(torch::kInt64).expand({logits.size(0), sentences});
    const Masked masked{-log_p.gather(-1, index.unsqueeze(-1)).squeeze(-1), target.valid};
    return losses.class_.weight * masked.Mean();
  }

  std::vector<Metric> Measure(const Head&, const ModuleOutput& output, const Target& target) const override {
    const Tensor same = output.decoded.at("class").argmax(-1) == target.value.to(torch::kInt64);
    return {{"accuracy", same, target.valid, 1, Metric::Role::kAccuracy}};
  }

  void Say(const Head& head, const ModuleOutput& output, OrderedJson& words) const override {
    const Tensor logits = output.decoded.at("class").select(0, 0).select(0, 0).to(torch::kCPU, torch::kFloat32);
    const Tensor probability = torch::softmax(logits, -1);
    const auto best = probability.argmax(-1).item<std::int64_t>();
    words["value"] = head.classes.at(static_cast<std::size_t>(best));
    words["probability"] = std::round(probability[best].item<double>() * 1e5) / 1e5;
  }
};

}  // namespace

const Quantity& ClassQuantity() {
  static const Class quantity;
  return quantity;
}

}  // namespace etude::policy
