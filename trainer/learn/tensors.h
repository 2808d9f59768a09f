// SPDX-License-Identifier: Apache-2.0
// Between plain arrays and tensors.
#pragma once

#include <map>
#include <string>

#include "trainer/data/batch.h"
#include "trainer/data/statistics.h"
#include "trainer/policy/policy.h"
#include "trainer/policy/torch.h"

namespace etude::learn {

/// What the network sees of pictures [first, last) of `batch`, and what it should say.
struct Part {
  policy::Inputs inputs;
  policy::Labels labels;
};
/// On the CPU tensors share the batch's memory: it must outlive them and stay unchanged. On another device they are
/// copies, which nobody waits for.
Part PartOf(data::Batch& batch, int first, int last, const torch::Device& device = torch::kCPU);

policy::Normalization ToNormalization(const data::Statistics& statistics);

}  // namespace etude::learn
