// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/language_encoder.h"

namespace etude::policy {

torch::Tensor LanguageEncoder::ForwardIds(const torch::Tensor&) {
  TORCH_CHECK(false, "this policy's language encoder reads sentences, not features of words");
}

TrainedLanguageEncoder::TrainedLanguageEncoder(const LanguageConfig& config, int width, const std::string& activation,
                                               Output output) {
  tokenizer_.buckets = config.buckets;
  // as many features share a word, single vectors are large so that their mean is not small
  vectors_ = register_parameter("vectors", torch::randn({config.buckets, config.width}));
  mlp_ =
      register_module("mlp", std::make_shared<Mlp>(config.width, std::vector<int>{config.hidden}, width, activation));
  if (output == Output::kNormalised) norm_ = register_module("norm", std::make_shared<LayerNorm>(width));
}

torch::Tensor TrainedLanguageEncoder::Forward(const std::vector<std::string>& sentences) {
  // the mean over words of the mean over a word's features is one weighted sum a sentence
  std::vector<std::int64_t> ids, offsets;
  std::vector<float> weights;
  for (const std::string& sentence : sentences) {
    offsets.push_back(static_cast<std::int64_t>(ids.size()));
    const auto words = language::Tokenize(sentence, tokenizer_);
    for (const auto& word : words) {
      ids.insert(ids.end(), word.begin(), word.end());
      weights.insert(weights.end(), word.size(), 1.0F / static_cast<float>(word.size() * words.size()));
    }
  }
  const auto device = vectors_.device();
  const auto sums = torch::embedding_bag(vectors_, torch::tensor(ids, torch::kInt64).to(device),
                                         torch::tensor(offsets, torch::kInt64).to(device),
                                         /*scale_grad_by_freq=*/false, /*mode=*/0, /*sparse=*/false,
                                         torch::tensor(weights, torch::kFloat32).to(vectors_.options()));
  return Finish(std::get<0>(sums));
}

// No number of words or features is written into what is traced.
torch::Tensor TrainedLanguageEncoder::ForwardIds(const torch::Tensor& ids) {
  const torch::Tensor there = (ids >= 0).to(vectors_.scalar_type());
  const torch::Tensor features = there.sum(1, /*keepdim=*/true);  // (W, 1) of each word
  const torch::Tensor words = features.clamp_max(1).sum();        // that are there
  const torch::Tensor weights = (there / (features.clamp_min(1) * words)).unsqueeze(-1);
  return Finish((torch::embedding(vectors_, ids.clamp_min(0)) * weights).flatten(0, 1).sum(0, /*keepdim=*/true));
}

torch::Tensor TrainedLanguageEncoder::Finish(const torch::Tensor& means) {
  const torch::Tensor tokens = mlp_->Forward(means);
  return norm_ != nullptr ? norm_->Forward(tokens) : tokens;
}

Status TrainedLanguageEncoder::Check(const std::string&) const { return {}; }

ClipLanguageEncoder::ClipLanguageEncoder(std::shared_ptr<clip::TextEncoder> text_encoder, int width, Output output)
    : text_encoder_(std::move(text_encoder)),
      projection_(register_module("projection", torch::nn::Linear(text_encoder_->width(), width))) {
  if (output == Output::kNormalised) norm_ = register_module("norm", std::make_shared<LayerNorm>(width));
}

torch::Tensor ClipLanguageEncoder::Forward(const std::vector<std::string>& sentences) {
  const torch::Tensor tokens = projection_->forward(text_encoder_->Embed(sentences).to(projection_->weight.options()));
  return norm_ != nullptr ? norm_->Forward(tokens) : tokens;
}

Status ClipLanguageEncoder::Check(const std::string& sentence) const { return text_encoder_->Check(sentence); }

}  // namespace etude::policy
