// SPDX-License-Identifier: Apache-2.0
// Sentence -> language token: the mean of word vectors, each the mean of hashed features, then a
// perceptron.
#pragma once

#include <torch/torch.h>

#include <memory>
#include <string>
#include <vector>

#include "services/language/tokenizer.h"
#include "trainer/policy/config.h"
#include "trainer/policy/layers.h"

namespace etude::policy {

class LanguageEncoder : public torch::nn::Module {
 public:
  enum class Output { kNormalised, kLinear };
  LanguageEncoder(const LanguageConfig& config, int width, const std::string& activation, Output output);
  /// @returns (D, d), one row a sentence
  torch::Tensor Forward(const std::vector<std::string>& sentences);

 private:
  language::TokenizerConfig tokenizer_;
  torch::Tensor vectors_;  ///< (buckets, word width)
  std::shared_ptr<Mlp> mlp_;
  std::shared_ptr<LayerNorm> norm_;  ///< kNormalised only
};

}  // namespace etude::policy
