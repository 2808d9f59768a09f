// SPDX-License-Identifier: Apache-2.0
// Names of an enumeration's values.
#pragma once

#include <initializer_list>
#include <string_view>
#include <type_traits>
#include <utility>

namespace etude {

/// EnumName(cause, {{Cause::kGoal, "goal"}, {Cause::kBudget, "budget"}}); `otherwise` for a value that is not there,
/// as one off the wire may be. @param names  of literals: what is returned points into them
template <class Enum>
constexpr std::string_view EnumName(
    Enum value, std::initializer_list<std::pair<std::type_identity_t<Enum>, std::string_view>> names,
    std::string_view otherwise = "?") {
  for (const auto& [known, name] : names)
    if (known == value) return name;
  return otherwise;
}

}  // namespace etude
