// SPDX-License-Identifier: Apache-2.0
// What must hold for a task to be done, as plain data: a tree of kinds with parameters. Written in YAML as
//
//   all:
//     - risen: {by: 3 cm}
//     - grasped                      # every parameter at its default
//     - beside: {of: reference, side: left}
//
// This header knows the form only. Which kinds there are, what parameters they have and what they mean stands in
// worker/task/predicates, one file a kind.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "services/core/config.h"
#include "services/core/result.h"

namespace etude {

/// A parameter of a predicate: a quantity in SI units, or a word ("target", "left").
struct PredicateValue {
  double number = 0;
  std::string unit;  ///< "m" | "rad" | "m/s" | "s"; "" when none was written: the parameter's own
  std::string word;  ///< not empty: a word, and `number` says nothing

  bool is_word() const { return !word.empty(); }
  bool operator==(const PredicateValue&) const = default;
};

/// Text or number -> value. Units that are read: m, cm, mm, rad, deg, m/s, cm/s, s, ms.
/// @error kInvalidArgument: not finite, an unknown unit, not a plain word; `where` begins the message
Result<PredicateValue> ParsePredicateValue(const OrderedJson& json, const std::string& where);

/// One node of the tree. Value type.
struct PredicateSpec {
  std::string kind;                                  ///< "risen", "all"
  std::map<std::string, PredicateValue> parameters;  ///< those that were written
  std::vector<PredicateSpec> children;               ///< of all, any, then

  bool operator==(const PredicateSpec&) const = default;
};

inline constexpr int kPredicateDepth = 8;   ///< levels of a tree at most,
inline constexpr int kPredicateNodes = 64;  ///< and nodes

/// The form is checked here (one kind a node, depth, number of nodes, plain names), kinds and parameters are not.
/// @error kInvalidArgument; `where` begins the message
Result<PredicateSpec> PredicateFromJson(const OrderedJson& json, const std::string& where);
/// The inverse of PredicateFromJson, quantities in SI units.
OrderedJson ToJson(const PredicateSpec& spec);

}  // namespace etude
