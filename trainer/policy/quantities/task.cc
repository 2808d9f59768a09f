// SPDX-License-Identifier: Apache-2.0
// What a sentence says to do: one of the policy's tasks. Ours: the paper supervises the object alone, and the verb is
// learned from trajectories, of which each picture has one.
#include "trainer/policy/quantities/categorical.h"

namespace etude::policy {
namespace {

class Task final : public Categorical {
 public:
  Task() : Categorical("task", "which of the policy's tasks the sentence means") {}
  bool IsOf(const data::Entity& entity) const override { return entity.kind == data::Entity::Kind::kCommand; }
  void FillLabel(const data::LabelContext& context, const data::EntityState& state, std::span<float> values,
                 std::span<std::uint8_t> valid) const override {
    FillName(context.tasks, state.name, values, valid);
  }
};

}  // namespace

const Quantity& TaskQuantity() {
  static const Task quantity;
  return quantity;
}

}  // namespace etude::policy
