// SPDX-License-Identifier: Apache-2.0
// Sums from card to card by NCCL, in builds against a libtorch for CUDA that has it (CMakeLists.txt looks for its
// header).
#pragma once

#include <chrono>
#include <functional>
#include <string>
#include <torch/csrc/distributed/c10d/Store.hpp>
#include <vector>

#include "trainer/policy/torch.h"

namespace etude::learn {

/// What tells one card from all others, on any host (its UUID). "": `device` is none, or there is no NCCL here.
std::string CardOf(const torch::Device& device);

/// Whether each of these, one for each rank, is a card of its own: what NCCL asks for.
bool AreCardsApart(const std::vector<std::string>& cards);

/// Sums one tensor over the ranks, in place, and waits for it; throws what c10d throws when another rank is lost.
using CardSum = std::function<bool(std::vector<torch::Tensor>&)>;
/// A rank that is silent for `patience` is lost. The connections are made at the first sum.
/// @pre AreCardsApart of all ranks
CardSum OpenCardSum(const c10::intrusive_ptr<c10d::Store>& store, int rank, int size,
                    std::chrono::milliseconds patience);

}  // namespace etude::learn
