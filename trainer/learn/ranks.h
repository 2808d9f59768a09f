// SPDX-License-Identifier: Apache-2.0
// Several processes, on one host or many, that train one network: each computes the gradients of its part of every
// batch, and all make the same step with their sum. Rank 0 decides, evaluates, keeps and publishes; the others follow.
//
// Over torch's c10d, with Gloo; gradients by NCCL where every rank has a CUDA device of its own. Each rank makes the
// whole batch and uses its part of it, so that R ranks with one replica each compute what one rank with R replicas
// does.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "services/core/result.h"
#include "trainer/policy/torch.h"

namespace etude::learn {

struct RanksOptions {
  int size = 1;
  int rank = 0;
  std::string host = "127.0.0.1";      ///< of rank 0
  std::uint16_t port = 0;              ///< of rank 0; 0 at rank 0: any free one, see Meeting
  torch::Device device = torch::kCPU;  ///< that this rank computes on
  /// A silence after which the others count as lost: longer than a checkpoint, a validation's batch and the wait for
  /// data. Validations and waits for room on the disk are no silence (KeepWaiting).
  std::chrono::milliseconds patience{300'000};
  /// Asked some times a second while the ranks come together; an error ends that with its words. None: nothing is.
  std::function<Status()> watch = nullptr;
};

/// The address of this machine from which `host` is reached, as numbers; "": it cannot be told. What a host's own name
/// stands for is no answer: in Debian's /etc/hosts that is 127.0.1.1, where no other host finds it.
std::string AddressTowards(const std::string& host, std::uint16_t port);

/// Where ranks find each other; rank 0's process holds it.
class Meeting {
 public:
  /// @error kUnavailable: the port is taken; the host cannot be reached within `patience`
  static Result<Meeting> Open(const RanksOptions& options);
  /// In this process only: ranks that are threads.
  static Meeting InProcess();
  std::uint16_t port() const { return port_; }

 private:
  friend class Ranks;
  std::shared_ptr<void> store_;  ///< keeps a c10d::Store
  std::uint16_t port_ = 0;
};

/// What rank 0 says before each step.
struct StepOrder {
  bool go = true;  ///< false: the run is over
  int level = 0;   ///< modules of this level and below are trained
  double lr = 0;
};

/// Not thread-safe. Every call but KeepWaiting and Abandon is made by all ranks, in the same order.
class Ranks {
 public:
  /// Waits for all. @error of `watch`; kUnavailable: which ones did not come, a stop request; kInvalidArgument: not a
  /// rank of that size
  static Result<std::unique_ptr<Ranks>> Join(const Meeting& meeting, const RanksOptions& options);
  ~Ranks();

  int rank() const;
  int size() const;
  bool leads() const { return rank() == 0; }
  /// Whether Sum goes from card to card (NCCL) for what lies on this rank's device.
  bool by_nccl() const;
  /// Whether another rank was lost: no call succeeds any more.
  bool lost() const;

  /// Rank 0's order, on every rank. @error kUnavailable: a rank was lost; the message says at what
  Result<StepOrder> Agree(const StepOrder& order);
  /// Nothing is said to the others any more: they may be anywhere in a step.
  void Abandon();
  /// Rank 0 is there and has no order yet: the patience of the others, who wait in Agree, begins anew. Nothing once the
  /// run is over, and of the others; a rank that is lost is the next Agree's error.
  void KeepWaiting();
  /// The sum over the ranks, in place, the same bits on each. @param values  float32, dense, on any device @error as
  /// Agree
  Status Sum(torch::Tensor& values);
  /// @error kInvalidArgument on every rank when `value` (a configuration, a dataset's fingerprint) is not the same on
  /// all; as Agree
  Status CheckSame(const std::string& what, const std::string& value);

 private:
  struct Impl;
  explicit Ranks(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::learn
