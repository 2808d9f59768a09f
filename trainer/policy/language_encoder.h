// SPDX-License-Identifier: Apache-2.0
// Sentence -> language token: trained along with the policy, or a trained projection of what CLIP says.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "services/core/result.h"
#include "services/language/senses.h"
#include "services/language/tokenizer.h"
#include "trainer/policy/clip/text_encoder.h"
#include "trainer/policy/config.h"
#include "trainer/policy/layers.h"
#include "trainer/policy/torch.h"

namespace etude::policy {

/// What words mean, as `config` wants it: nullptr without senses. @error as language::Senses::Open
Result<std::shared_ptr<const language::Senses>> OpenSenses(const LanguageConfig& config);

/// One vector a sentence.
class LanguageEncoder : public torch::nn::Module {
 public:
  enum class Output { kNormalised, kLinear };

  /// @param sentences  at least one
  /// @returns (D, d), one row a sentence; c10::Error for a sentence that Check refuses
  virtual torch::Tensor Forward(const std::vector<std::string>& sentences) = 0;
  /// The same of one sentence whose words are features already: for who has no tokeniser of ours (TorchScript).
  /// @param ids  (W, F) int64, a word a row, as language::Tokenize has them, at least one; -1 fills rows and rows of
  ///        nothing
  /// @returns (1, d); c10::Error of an encoder that reads no features
  virtual torch::Tensor ForwardIds(const torch::Tensor& ids);
  /// @error kInvalidArgument: what the encoder cannot read, and why
  virtual Status Check(const std::string& sentence) const = 0;
};

/// Word vectors in a trained table, each the mean of hashed features of a word's spelling and, with senses, plus the
/// mean of those of what it may mean; then what a subclass makes of them, a perceptron and, of kNormalised, a
/// normalisation. Reads any sentence. While it is trained, kUnspelled of the words that have senses enter by them
/// alone, so that a word of which only the senses are known says as much; which, is the sentence's hash and no draw.
class TrainedLanguageEncoder : public LanguageEncoder {
 public:
  static constexpr double kUnspelled = 0.3;

  Status Check(const std::string& sentence) const override;

 protected:
  using Senses = std::shared_ptr<const language::Senses>;

  /// @param senses   OpenSenses(config)
  /// @param summary  numbers that a subclass has of a sentence
  TrainedLanguageEncoder(const LanguageConfig& config, Senses senses, int summary, int width,
                         const std::string& activation, Output output);
  torch::Tensor Finish(const torch::Tensor& summaries);
  std::vector<language::WordFeatures> Tokenize(const std::string& sentence) const;

  std::int64_t buckets() const { return tokenizer_.buckets; }

  torch::Tensor vectors_;  ///< (LanguageConfig::rows(), word width)

 private:
  language::TokenizerConfig tokenizer_;
  Senses senses_;  ///< nullptr: none
  std::shared_ptr<Mlp> mlp_;
  std::shared_ptr<LayerNorm> norm_;  ///< kNormalised only
};

/// The mean of a sentence's words: of their order it knows what pairs of neighbours say.
class BagOfWordsEncoder : public TrainedLanguageEncoder {
 public:
  BagOfWordsEncoder(const LanguageConfig& config, Senses senses, int width, const std::string& activation,
                    Output output);
  torch::Tensor Forward(const std::vector<std::string>& sentences) override;
  torch::Tensor ForwardIds(const torch::Tensor& ids) override;
};

/// Convolutions over a sentence's words, and the largest of what they say anywhere in it (Kim 2014): who is put beside
/// whom, and who is to be kept off, is in the words around. Two layers of three words see five at once.
class ConvolutionEncoder : public TrainedLanguageEncoder {
 public:
  ConvolutionEncoder(const LanguageConfig& config, Senses senses, int width, const std::string& activation,
                     Output output);
  torch::Tensor Forward(const std::vector<std::string>& sentences) override;
  torch::Tensor ForwardIds(const torch::Tensor& ids) override;

 private:
  /// @param words  (D, W, word width), zero where `beyond`
  /// @param beyond  (D, 1, W) bool: behind a sentence's end; undefined: nothing is
  torch::Tensor Say(const torch::Tensor& words, const torch::Tensor& beyond);

  std::string activation_;
  torch::nn::Conv1d first_{nullptr}, second_{nullptr};
};

/// A linear map of CLIP's embedding, as in the original. The text encoder is shared, not owned, and no parameter of
/// this module: what is trained, averaged and kept is the map.
class ClipLanguageEncoder : public LanguageEncoder {
 public:
  ClipLanguageEncoder(std::shared_ptr<clip::TextEncoder> text_encoder, int width, Output output);
  torch::Tensor Forward(const std::vector<std::string>& sentences) override;
  Status Check(const std::string& sentence) const override;

 private:
  std::shared_ptr<clip::TextEncoder> text_encoder_;
  torch::nn::Linear projection_{nullptr};
  std::shared_ptr<LayerNorm> norm_;  ///< kNormalised only
};

}  // namespace etude::policy
