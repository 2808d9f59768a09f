// SPDX-License-Identifier: Apache-2.0
// Policies of schema 1 as this program's: their file said `target: target_position`, and parameters were rows of tables
// and columns of matrices. What a checkpoint of that time decodes does not change, sines and cosines included.
#pragma once

#include <map>
#include <string>

#include "services/core/config.h"
#include "trainer/policy/config.h"
#include "trainer/policy/torch.h"

namespace etude::policy {

/// A policy's resolved configuration of schema 1 in today's keys. What is not as it should be stays as it is, for
/// FromJson and Validate to refuse.
OrderedJson UpgradePolicyJson(OrderedJson json);

/// Names and shapes of schema 1's tensors in today's. @param config  upgraded and valid
/// What does not fit keeps its name, for LoadStateTensors to refuse.
void UpgradeStateNames(const PolicyConfig& config, std::map<std::string, torch::Tensor>& tensors);

}  // namespace etude::policy
