// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/language_encoder.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "services/core/rng.h"

namespace etude::policy {

Result<std::shared_ptr<const language::Senses>> OpenSenses(const LanguageConfig& config) {
  if (!config.senses) return std::shared_ptr<const language::Senses>();
  return language::Senses::Open(config.sha256);
}

torch::Tensor LanguageEncoder::ForwardIds(const torch::Tensor&) {
  TORCH_CHECK(false, "this policy's language encoder reads sentences, not features of words");
}

TrainedLanguageEncoder::TrainedLanguageEncoder(const LanguageConfig& config, Senses senses, int summary, int width,
                                               const std::string& activation, Output output)
    : senses_(std::move(senses)) {
  tokenizer_.buckets = config.buckets;
  // as many features share a word, single vectors are large so that their mean is not small
  vectors_ = register_parameter("vectors", torch::randn({config.rows(), config.width}));
  mlp_ = register_module("mlp", std::make_shared<Mlp>(summary, std::vector<int>{config.hidden}, width, activation));
  if (output == Output::kNormalised) norm_ = register_module("norm", std::make_shared<LayerNorm>(width));
}

torch::Tensor TrainedLanguageEncoder::Finish(const torch::Tensor& summaries) {
  const torch::Tensor tokens = mlp_->Forward(summaries);
  return norm_ != nullptr ? norm_->Forward(tokens) : tokens;
}

std::vector<language::WordFeatures> TrainedLanguageEncoder::Tokenize(const std::string& sentence) const {
  auto words = language::Tokenize(sentence, tokenizer_, senses_.get());
  if (!senses_ || !is_training()) return words;
  Rng draw(MixSeed({}, sentence));
  for (auto& word : words) {
    const bool means_something = word.back() >= tokenizer_.buckets;
    if (draw.Bernoulli(kUnspelled) && means_something)
      std::erase_if(word, [&](std::int64_t id) { return id < tokenizer_.buckets; });
  }
  return words;
}

Status TrainedLanguageEncoder::Check(const std::string&) const { return {}; }

namespace {

// Sums of a table's rows, a sum at a time.
struct Sums {
  std::vector<std::int64_t> ids, offsets;
  std::vector<float> weights;

  void Begin() { offsets.push_back(static_cast<std::int64_t>(ids.size())); }
  // the mean of its spelling and that of its senses
  void Add(const language::WordFeatures& word, double share, std::int64_t buckets) {
    const auto senses = std::ranges::find_if(word, [&](std::int64_t id) { return id >= buckets; });
    for (const auto& [begin, end] : {std::pair{word.begin(), senses}, {senses, word.end()}}) {
      ids.insert(ids.end(), begin, end);
      const auto count = static_cast<std::size_t>(end - begin);
      weights.insert(weights.end(), count, static_cast<float>(share / static_cast<double>(count)));
    }
  }
  // (sums, width)
  torch::Tensor Of(const torch::Tensor& vectors) const {
    const auto device = vectors.device();
    return std::get<0>(torch::embedding_bag(vectors, torch::tensor(ids, torch::kInt64).to(device),
                                            torch::tensor(offsets, torch::kInt64).to(device),
                                            /*scale_grad_by_freq=*/false, /*mode=*/0, /*sparse=*/false,
                                            torch::tensor(weights, torch::kFloat32).to(vectors.options())));
  }
};

// Of one sentence's features, (W, F), -1 where there is none: as Sums of each word, (W, width), zero of a row of
// nothing. No number of words or features is written into what is traced.
torch::Tensor MeansOfWords(const torch::Tensor& vectors, const torch::Tensor& ids, std::int64_t buckets) {
  const auto shares = [&](const torch::Tensor& mask) {
    const torch::Tensor there = mask.to(vectors.scalar_type());
    return (there / there.sum(1, /*keepdim=*/true).clamp_min(1)).unsqueeze(-1);
  };
  const torch::Tensor weights =
      vectors.size(0) == buckets ? shares(ids >= 0) : shares((ids >= 0) & (ids < buckets)) + shares(ids >= buckets);
  return (torch::embedding(vectors, ids.clamp_min(0)) * weights).sum(1);
}

}  // namespace

BagOfWordsEncoder::BagOfWordsEncoder(const LanguageConfig& config, Senses senses, int width,
                                     const std::string& activation, Output output)
    : TrainedLanguageEncoder(config, std::move(senses), config.width, width, activation, output) {}

torch::Tensor BagOfWordsEncoder::Forward(const std::vector<std::string>& sentences) {
  // the mean over words of the means over a word's features is one weighted sum a sentence
  Sums sums;
  for (const std::string& sentence : sentences) {
    sums.Begin();
    const auto words = Tokenize(sentence);
    for (const auto& word : words) sums.Add(word, 1.0 / static_cast<double>(words.size()), buckets());
  }
  return Finish(sums.Of(vectors_));
}

torch::Tensor BagOfWordsEncoder::ForwardIds(const torch::Tensor& ids) {
  const torch::Tensor words = (ids >= 0).any(1).sum().clamp_min(1);
  return Finish(MeansOfWords(vectors_, ids, buckets()).sum(0, /*keepdim=*/true) / words);
}

ConvolutionEncoder::ConvolutionEncoder(const LanguageConfig& config, Senses senses, int width,
                                       const std::string& activation, Output output)
    : TrainedLanguageEncoder(config, std::move(senses), config.hidden, width, activation, output),
      activation_(activation) {
  const auto of_three_words = [&](int inputs) {
    return torch::nn::Conv1d(torch::nn::Conv1dOptions(inputs, config.hidden, 3).padding(1));
  };
  first_ = register_module("convolution0", of_three_words(config.width));
  second_ = register_module("convolution1", of_three_words(config.hidden));
}

torch::Tensor ConvolutionEncoder::Forward(const std::vector<std::string>& sentences) {
  std::vector<std::vector<language::WordFeatures>> all;
  std::vector<std::int64_t> lengths;
  for (const std::string& sentence : sentences)
    lengths.push_back(static_cast<std::int64_t>(all.emplace_back(Tokenize(sentence)).size()));
  const std::int64_t longest = *std::max_element(lengths.begin(), lengths.end());
  Sums sums;  // behind a sentence's end of nothing, which is zero
  for (const auto& words : all)
    for (std::int64_t w = 0; w < longest; ++w) {
      sums.Begin();
      if (w < static_cast<std::int64_t>(words.size())) sums.Add(words[static_cast<std::size_t>(w)], 1, buckets());
    }
  const auto words = sums.Of(vectors_).view({static_cast<std::int64_t>(all.size()), longest, -1});
  const auto ends = torch::tensor(lengths, torch::kInt64).to(words.device()).view({-1, 1, 1});
  return Say(words, torch::arange(longest, ends.options()) >= ends);
}

torch::Tensor ConvolutionEncoder::ForwardIds(const torch::Tensor& ids) {
  const torch::Tensor words = (ids >= 0).any(1).nonzero().squeeze(1);
  return Say(MeansOfWords(vectors_, ids.index_select(0, words), buckets()).unsqueeze(0), {});
}

torch::Tensor ConvolutionEncoder::Say(const torch::Tensor& words, const torch::Tensor& beyond) {
  const auto fill = [&](const torch::Tensor& x, float value) {
    return beyond.defined() ? x.masked_fill(beyond, value) : x;
  };
  const torch::Tensor near = Activate(first_->forward(words.transpose(1, 2)), activation_);
  const torch::Tensor said = second_->forward(fill(near, 0));  // as at the edges of a sentence alone
  return Finish(fill(said, -std::numeric_limits<float>::infinity()).amax(2));
}

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
