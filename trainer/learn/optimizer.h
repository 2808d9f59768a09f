// SPDX-License-Identifier: Apache-2.0
// AdamW over one flat buffer on the policies' device: parameters of all replicas share their storage, gradients of each
// replica lie in one array, so that averaging, clipping, the update and saving are single passes
// over memory.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "trainer/learn/adamw_kernel.h"
#include "trainer/learn/config.h"
#include "trainer/policy/policy.h"
#include "trainer/policy/torch.h"

namespace etude::learn {

/// Learning rate of step `step` (from 0) when `progress` of the run is over.
double LearningRate(const OptimizerConfig& config, std::uint64_t step, double progress);

/// Not thread-safe, but replicas may run backward side by side (each has its own gradients).
class Optimizer {
 public:
  /// Moves the parameters of `replicas` (same network, same weights) into shared storage.
  /// Those that take no gradient (Policy::Freeze) are left alone.
  Optimizer(const OptimizerConfig& config, std::vector<std::shared_ptr<policy::Policy>> replicas);

  void ZeroGradients();
  /// The sum over the replicas, to be summed over other processes' too before Step. Step calls it unless it was.
  torch::Tensor& SumGradients();
  /// How many copies of the network the gradient is the mean over, others' included; at first the replicas.
  void AverageOver(int copies) { copies_ = copies; }
  struct Outcome {
    double gradient_norm = 0;  ///< before clipping; not finite: nothing was updated
    /// Part (policy::PartsOf) -> its share of that norm: their squares add up to its square. Parts without a gradient
    /// are absent.
    std::map<std::string, double> part_norms;
  };
  /// Averages the replicas' gradients and updates. A parameter whose gradient is exactly zero (its
  /// module is not trained yet) is left alone: no decay, no step of its bias correction.
  Outcome Step(double lr);

  /// Averaged weights (decay 0: none, also where there were some); of a parameter's first steps, whenever they come, a
  /// shorter average. `ExchangeAverage` swaps them with the parameters;
  /// call it in pairs.
  void UpdateAverage(double decay);
  void ExchangeAverage();

  bool averages() const { return average_.defined(); }
  std::size_t size() const;  ///< numbers that it trains
  /// By parameter: "first/NAME", "second/NAME" (shaped as it), "steps/NAME" (1) and "average/NAME"; "average_steps".
  /// The parameters themselves are the policy's.
  std::map<std::string, torch::Tensor> StateTensors() const;
  /// Each parameter gets what stands under its name; one that has nothing there (it was frozen) begins anew, and what
  /// stands there for one that is frozen now is left: other parameters do not notice.
  /// @error kCorrupt when something of a parameter is missing or has another size; nothing is changed then.
  Status LoadStateTensors(const std::map<std::string, torch::Tensor>& tensors);

 private:
  struct Segment {
    std::string name, part;
    std::size_t offset = 0, count = 0;
    bool decay = false;
    std::vector<std::int64_t> sizes, strides;
  };
  /// Counts a step of a segment.
  AdamwStep NextStep(std::size_t segment, double lr, double scale);
  torch::Tensor ViewOf(const torch::Tensor& flat, const Segment& segment) const;
  OptimizerConfig config_;
  std::vector<Segment> segments_;
  torch::Tensor parameters_, first_, second_, steps_;  // (N) each; steps_: int64, one a segment, on the CPU
  torch::Tensor average_, average_steps_;              // (N), (1) on the CPU; undefined: off
  std::vector<torch::Tensor> gradients_;               // (N), one a replica
  bool summed_ = false;                                // the first is the sum
  int copies_ = 1;
};

}  // namespace etude::learn
