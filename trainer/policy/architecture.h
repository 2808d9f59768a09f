// SPDX-License-Identifier: Apache-2.0
// What tells networks apart: what a policy says beyond the defaults. A key that is added later, with a default that
// means what was before, changes no hash of anything that exists.
#pragma once

#include <string>

#include "services/core/config.h"
#include "trainer/policy/config.h"

namespace etude::policy {

/// The resolved configuration without what is at its default, also inside each layer and each module. Reading it
/// again gives `config`.
OrderedJson SaidOf(const PolicyConfig& config);

/// What of a policy's `language`, as its file says it, weights must fit: of clip:DIR what the folder holds, not where
/// it lies, and no sizes of an encoder that is not there.
OrderedJson LanguageThatWeightsFit(OrderedJson language);

/// SHA-256 of what weights must fit. Left out: names, losses and their weights, where attention is supervised,
/// gradient paths, precision, where clip's folder lies. @param said  SaidOf, or the policy_config of a checkpoint as it
/// stands there
std::string ArchitectureHash(const OrderedJson& said);
std::string ArchitectureHash(const PolicyConfig& config);

}  // namespace etude::policy
