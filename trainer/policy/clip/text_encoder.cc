// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/clip/text_encoder.h"

#include <fmt/format.h>
#include <torch/utils.h>

#include <algorithm>
#include <exception>
#include <filesystem>
#include <utility>

#include "services/core/check.h"
#include "services/core/hash.h"

namespace etude::clip {
namespace {

constexpr char kModel[] = "model.safetensors", kVocabulary[] = "vocab.json", kMerges[] = "merges.txt",
               kConfig[] = "config.json";
constexpr std::uint64_t kMostText = 64 << 20;  // bytes of a text file

/// The files of a folder, and what they amount to.
struct Content {
  store::Safetensors model;
  std::string vocabulary, merges, config;
  std::string model_sha256;
};

Result<Content> ReadContent(const Path& folder) {
  Content content;
  ETUDE_ASSIGN_OR_RETURN(content.vocabulary, ReadTextFile(folder / kVocabulary, kMostText));
  ETUDE_ASSIGN_OR_RETURN(content.merges, ReadTextFile(folder / kMerges, kMostText));
  std::error_code ignored;
  if (std::filesystem::exists(folder / kConfig, ignored)) {
    ETUDE_ASSIGN_OR_RETURN(content.config, ReadTextFile(folder / kConfig, kMostText));
  }
  ETUDE_ASSIGN_OR_RETURN(const auto bytes, ReadBinaryFile(folder / kModel));
  content.model_sha256 = Sha256Hex(bytes);
  ETUDE_ASSIGN_OR_RETURN(content.model, store::DecodeSafetensors(bytes, IsOfTower));
  return content;
}

// heads are no tensor's shape, and another number of them is another tower
std::string HashOf(const Content& content, const TowerSizes& sizes) {
  return Sha256Hex(fmt::format("{}  {}\n{}  {}\n{}  {}\nheads {}\n", Sha256Hex(content.merges), kMerges,
                               content.model_sha256, kModel, Sha256Hex(content.vocabulary), kVocabulary, sizes.heads));
}

Status CheckHash(const std::string& sha256, const std::string& wanted) {
  if (wanted.empty() || sha256 == wanted) return {};
  return Fail(Code::kInvalidArgument,
              fmt::format("its content is {:.12}, and the policy was trained with {:.12}: give the folder that it was "
                          "trained with (etude policy --clip DIR, or ETUDE_CLIP; in training "
                          "policy.language.encoder=clip:DIR)",
                          sha256, wanted));
}

}  // namespace

struct TextEncoder::Parts {
  language::BytePairTokenizer tokenizer;
  Tower tower;
  std::string sha256;
};

Result<TextEncoder::Parts> TextEncoder::OpenParts(const Path& folder, const std::string& wanted) {
  ETUDE_ASSIGN_OR_RETURN(const Content content, ReadContent(folder));
  ETUDE_ASSIGN_OR_RETURN(const TowerSizes sizes, SizesOf(content.model, content.config));
  const std::string sha256 = HashOf(content, sizes);
  ETUDE_RETURN_IF_ERROR(CheckHash(sha256, wanted));
  ETUDE_ASSIGN_OR_RETURN(auto tokenizer, language::BytePairTokenizer::Parse(content.vocabulary, content.merges));
  if (tokenizer.largest_id() >= sizes.vocabulary)
    return Fail(Code::kCorrupt, fmt::format("vocab.json has an id {}, and model.safetensors embeds {} tokens",
                                            tokenizer.largest_id(), sizes.vocabulary));
  ETUDE_ASSIGN_OR_RETURN(auto tower, Tower::Create(content.model, sizes));
  return Parts{std::move(tokenizer), std::move(tower), sha256};
}

TextEncoder::TextEncoder(Parts parts, std::size_t remembered)
    : tokenizer_(std::move(parts.tokenizer)),
      tower_(std::move(parts.tower)),
      sha256_(std::move(parts.sha256)),
      most_remembered_(remembered) {}

Result<std::shared_ptr<TextEncoder>> TextEncoder::Open(const Path& folder, const std::string& sha256,
                                                       std::size_t remembered) {
  ETUDE_CHECK(remembered > 0);
  auto parts = OpenParts(folder, sha256);
  if (!parts) {
    Error error = parts.error().Wrap(fmt::format("open language clip:{}", folder.string()));
    if (error.code == Code::kNotFound)
      error.message += fmt::format(
          "; it needs {}, {} and {} of a CLIP model, as Hugging Face's "
          "openai/clip-vit-base-patch32 has them",
          kModel, kVocabulary, kMerges);
    return Fail(std::move(error));
  }
  return std::shared_ptr<TextEncoder>(new TextEncoder(std::move(*parts), remembered));
}

Result<std::vector<std::int64_t>> TextEncoder::TokensOf(const std::string& sentence) const {
  const auto longer = [&](const std::string& what) {
    return Fail(Code::kInvalidArgument, fmt::format("the sentence '{:.60}...' has {}: say it shorter", sentence, what));
  };
  if (sentence.size() > kMostBytes)
    return longer(fmt::format("{} bytes, CLIP reads up to {}", sentence.size(), kMostBytes));
  auto tokens = tokenizer_.Encode(sentence);
  const auto positions = static_cast<std::size_t>(tower_.sizes().positions);
  if (tokens.size() > positions)
    return longer(fmt::format("{} tokens with its start and end, CLIP reads up to {}", tokens.size(), positions));
  return tokens;
}

Status TextEncoder::Check(const std::string& sentence) const {
  const auto tokens = TokensOf(sentence);
  return tokens ? Status() : Status(Fail(tokens.error()));
}

torch::Tensor TextEncoder::Compute(const std::string& sentence) const {
  const auto tokens = TokensOf(sentence);
  TORCH_CHECK(tokens, tokens.error().message);
  // the first end token: where the vocabulary lacks a symbol there is one before the last
  const auto end = std::find(tokens->begin(), tokens->end(), tokenizer_.end_token());
  return tower_.Embed(*tokens, end - tokens->begin());
}

TextEncoder::Embedding TextEncoder::Remember(const std::string& sentence, Embedding embedding) {
  recent_.push_front(sentence);
  remembered_[sentence] = {embedding, recent_.begin()};
  if (recent_.size() > most_remembered_) Forget(recent_.back());
  return embedding;
}

void TextEncoder::Forget(const std::string& sentence) {
  const auto found = remembered_.find(sentence);
  if (found == remembered_.end()) return;
  const auto place = found->second.place;
  remembered_.erase(found);
  recent_.erase(place);
}

TextEncoder::Embedding TextEncoder::Find(const std::string& sentence) {
  std::promise<torch::Tensor> promise;
  Embedding embedding;
  {
    const MutexLock lock(mutex_);
    if (const auto found = remembered_.find(sentence); found != remembered_.end()) {
      recent_.splice(recent_.begin(), recent_, found->second.place);
      return found->second.embedding;
    }
    embedding = Remember(sentence, promise.get_future().share());
    ++computed_;
  }
  try {
    promise.set_value(Compute(sentence));
  } catch (const std::exception&) {
    promise.set_exception(std::current_exception());
    const MutexLock lock(mutex_);
    Forget(sentence);
  }
  return embedding;
}

torch::Tensor TextEncoder::Embed(const std::vector<std::string>& sentences) {
  // every one that nobody has begun is computed here before any of the others is waited for
  std::vector<Embedding> embeddings;
  for (const std::string& sentence : sentences) embeddings.push_back(Find(sentence));
  const torch::NoGradGuard no_grad;
  torch::Tensor rows = torch::empty({static_cast<std::int64_t>(sentences.size()), width()}, torch::kFloat32);
  for (std::size_t i = 0; i < embeddings.size(); ++i)
    rows.select(0, static_cast<std::int64_t>(i)).copy_(embeddings[i].get());
  return rows;
}

std::uint64_t TextEncoder::computed() const {
  const MutexLock lock(mutex_);
  return computed_;
}

Result<std::shared_ptr<TextEncoder>> Folders::Open(const std::string& folder, const std::string& sha256) {
  const std::string& place = instead_.empty() ? folder : instead_;
  const MutexLock lock(mutex_);
  if (const auto found = open_.find(place); found != open_.end() && found->second->sha256() == sha256)
    return found->second;
  ETUDE_ASSIGN_OR_RETURN(auto opened, TextEncoder::Open(place, sha256));
  open_[place] = opened;
  return opened;
}

}  // namespace etude::clip
