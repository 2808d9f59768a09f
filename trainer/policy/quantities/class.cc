// SPDX-License-Identifier: Apache-2.0
// Which class of objects a sentence means: one of the policy's nouns.
#include "services/spec/object_names.h"
#include "trainer/policy/quantities/categorical.h"

namespace etude::policy {
namespace {

class Class final : public Categorical {
 public:
  Class() : Categorical("class", "which of the policy's objects the sentence means") {}
  bool IsOf(const data::Entity& entity) const override { return entity.per_sentence() && entity.is_thing(); }
  // a sentence says "apple", never which one
  void FillLabel(const data::LabelContext& context, const data::EntityState& state, std::span<float> values,
                 std::span<std::uint8_t> valid) const override {
    FillName(context.classes, ObjectNoun(std::string(state.name)), values, valid);
  }
};

}  // namespace

const Quantity& ClassQuantity() {
  static const Class quantity;
  return quantity;
}

}  // namespace etude::policy
