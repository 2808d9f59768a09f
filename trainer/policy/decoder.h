// SPDX-License-Identifier: Apache-2.0
// What turns a module's inputs into numbers: an Mlp whose first layer keeps the columns of each input as a parameter of
// their own, found by the input's name.
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "trainer/policy/torch.h"

namespace etude::policy {

/// Parameters: from.INPUT (h, width of INPUT), bias (h), then layer1, layer2, ... as in Mlp, h the first hidden width.
/// The initial values are those of one linear layer over all inputs, whatever they are called. A hidden layer as wide
/// as what it reads is residual, the first one included.
class Decoder : public torch::nn::Module {
 public:
  /// @param inputs  name and width of each, names distinct
  Decoder(const std::vector<std::pair<std::string, int>>& inputs, const std::vector<int>& hidden, int outputs,
          std::string activation);
  /// @param features  (B, S, width of the input) each, in the order of `inputs`
  torch::Tensor Forward(const std::vector<torch::Tensor>& features);
  /// Zeroes the last layer.
  void StartAtZero();

  /// Whether the decoder that has the tensors PREFIXfrom.INPUT, PREFIXlayer1.weight, ... adds all that it reads to what
  /// its first layer makes of it. False where there is no such decoder.
  static bool AddsItsInputs(const std::map<std::string, torch::Tensor>& tensors, const std::string& prefix);

 private:
  std::vector<torch::Tensor> from_;
  torch::Tensor bias_;
  std::vector<torch::nn::Linear> layers_;  ///< from the second on
  std::string activation_;
};

}  // namespace etude::policy
