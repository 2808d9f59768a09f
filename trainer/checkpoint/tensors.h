// SPDX-License-Identifier: Apache-2.0
// Between torch's tensors and those of a safetensors file.
#pragma once

#include "services/core/result.h"
#include "services/store/safetensors.h"
#include "trainer/policy/torch.h"

namespace etude::checkpoint {

/// @error kInvalidArgument for a dtype that safetensors or torch does not have.
Result<store::Tensor> ToStore(const torch::Tensor& tensor);
torch::Tensor FromStore(const store::Tensor& tensor);

}  // namespace etude::checkpoint
