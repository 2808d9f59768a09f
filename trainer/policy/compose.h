// SPDX-License-Identifier: Apache-2.0
// One policy's file on top of another's: how hierarchies grow. No torch here.
#pragma once

#include <string>

#include "services/core/config.h"

namespace etude::policy {

/// What the map of a policy says of its modules; none where it has no list of them.
OrderedJson ModuleEntries(const OrderedJson& policy);
/// The module that such an entry is of; "" where it names none.
std::string EntryName(const OrderedJson& entry);

/// `base` with what `addition` says. A module that `base` has too is given what the addition's entry of that name
/// reads, attends to and decodes from, in addition; its other keys are replaced, as every key of the policy is.
/// Modules that `base` lacks are appended. Both as their files say them; nothing is checked.
OrderedJson Compose(const OrderedJson& base, const OrderedJson& addition);

/// Where a module of `graph` is as `before` has it and reads "all", what that was in `before` is written out: what is
/// put on top of a trained graph changes no module that it does not name.
void KeepReads(const OrderedJson& before, OrderedJson& graph);

}  // namespace etude::policy
