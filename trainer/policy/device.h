// SPDX-License-Identifier: Apache-2.0
// Where a process computes: on the CPU, or on a CUDA device where libtorch was built for it. What is computed is the
// same; our own kernels are the CPU's, and elsewhere torch's operations stand in for them.
#pragma once

#include <string>

#include "services/core/result.h"
#include "trainer/policy/torch.h"

namespace etude::policy {

/// @param name  cpu | cuda | cuda:NUMBER @param rank  of several processes: `cuda` is theirs in turn
/// @error kInvalidArgument: no such name; kUnavailable: libtorch was built without CUDA, or this machine has no such
/// device (the message says which)
Result<torch::Device> OpenDevice(const std::string& name, int rank = 0);

/// A dense copy on `device`, or `tensor` itself where it is there. To CUDA it goes through pinned memory, and the
/// caller does not wait for it: `tensor` may be written again at once.
torch::Tensor ToDevice(const torch::Tensor& tensor, const torch::Device& device);

/// Whether our own kernels compute what lies on `device`.
bool UsesOwnKernels(const torch::Device& device);

/// While one lives, torch's operations compute on the CPU too: to compare what others compute with them. Any thread.
class AtenOnly {
 public:
  AtenOnly();
  ~AtenOnly();
  AtenOnly(AtenOnly&&) = delete;
};

}  // namespace etude::policy
