// SPDX-License-Identifier: Apache-2.0
// CLIP's files in small: random weights from a fixed seed, a vocabulary of letters and a few merges.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <random>
#include <string>
#include <vector>

#include "services/core/config.h"
#include "services/core/file.h"
#include "services/store/safetensors.h"
#include "trainer/policy/torch.h"

namespace etude::clip {

struct TinyShape {
  std::int64_t width = 128, layers = 2, hidden = 192, positions = 77, output = 48;
  store::DType type = store::DType::kF32;
};

inline const char* const kTinyMerges =
    "#version: 0.2\n"
    "t h\n"
    "th e</w>\n"
    "p i\n"
    "c k</w>\n"
    "pi ck</w>\n";

/// Of every lower-case letter and what the merges make; '?' and all that is not ASCII are not in it.
inline Json TinyVocabulary() {
  Json ids = Json::object();
  const auto add = [&](const std::string& symbol) { ids.emplace(symbol, ids.size()); };
  for (const char* ending : {"", "</w>"})
    for (char c = 'a'; c <= 'z'; ++c) add(std::string(1, c) + ending);
  for (const char* symbol : {"1</w>", "2</w>", "!</w>", "'", ",</w>", "th", "the</w>", "pi", "ck</w>", "pick</w>"})
    add(symbol);
  add("<|startoftext|>");
  add("<|endoftext|>");
  return ids;
}

/// Writes tensors of one type.
class TinyWeights {
 public:
  TinyWeights(store::DType type, std::uint32_t seed) : type_(type), random_(seed) {}

  /// Numbers in middle +- spread.
  void Add(const std::string& name, const std::vector<std::int64_t>& shape, double spread, double middle = 0) {
    store::Tensor tensor{type_, shape, {}};
    std::int64_t count = 1;
    for (const auto extent : shape) count *= extent;
    for (std::int64_t i = 0; i < count; ++i)
      Append(static_cast<float>(middle + spread * (2.0 * random_() / 4294967295.0 - 1)), tensor.data);
    model_.tensors[name] = std::move(tensor);
  }
  /// Of a linear map that keeps the size of what it maps.
  void AddLinear(const std::string& name, std::int64_t outputs, std::int64_t inputs) {
    Add(name + ".weight", {outputs, inputs}, std::sqrt(3.0 / static_cast<double>(inputs)));
    Add(name + ".bias", {outputs}, 0.2);
  }
  void AddNorm(const std::string& name, std::int64_t width) {
    Add(name + ".weight", {width}, 0.3, 1);
    Add(name + ".bias", {width}, 0.2);
  }
  store::Safetensors Take() { return std::move(model_); }

 private:
  void Append(float value, std::vector<std::uint8_t>& data) const {
    const std::uint16_t half = type_ == store::DType::kF16 ? c10::Half(value).x : c10::BFloat16(value).x;
    const void* const bytes = type_ == store::DType::kF32 ? static_cast<const void*>(&value) : &half;
    const std::size_t at = data.size(), size = store::SizeOf(type_);
    data.resize(at + size);
    std::memcpy(data.data() + at, bytes, size);
  }

  store::DType type_;
  std::mt19937 random_;
  store::Safetensors model_;
};

inline store::Safetensors TinyModel(const TinyShape& shape = {}, std::uint32_t seed = 1) {
  TinyWeights weights(shape.type, seed);
  const auto vocabulary = static_cast<std::int64_t>(TinyVocabulary().size());
  weights.Add("text_model.embeddings.token_embedding.weight", {vocabulary, shape.width}, 1);
  weights.Add("text_model.embeddings.position_embedding.weight", {shape.positions, shape.width}, 0.5);
  for (std::int64_t i = 0; i < shape.layers; ++i) {
    const std::string name = "text_model.encoder.layers." + std::to_string(i) + ".";
    weights.AddNorm(name + "layer_norm1", shape.width);
    for (const char* map : {"q_proj", "k_proj", "v_proj", "out_proj"})
      weights.AddLinear(name + "self_attn." + map, shape.width, shape.width);
    weights.AddNorm(name + "layer_norm2", shape.width);
    weights.AddLinear(name + "mlp.fc1", shape.hidden, shape.width);
    weights.AddLinear(name + "mlp.fc2", shape.width, shape.hidden);
  }
  weights.AddNorm("text_model.final_layer_norm", shape.width);
  weights.Add("text_projection.weight", {shape.output, shape.width}, 0.2);
  return weights.Take();
}

/// The three files, without config.json.
inline void WriteTinyClip(const Path& folder, const store::Safetensors& model = TinyModel()) {
  ASSERT_TRUE(MakeFolders(folder));
  ASSERT_TRUE(store::WriteSafetensors(folder / "model.safetensors", model));
  ASSERT_TRUE(WriteFileAtomically(folder / "vocab.json", TinyVocabulary().dump()));
  ASSERT_TRUE(WriteFileAtomically(folder / "merges.txt", std::string_view(kTinyMerges)));
}

}  // namespace etude::clip
