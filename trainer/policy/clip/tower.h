// SPDX-License-Identifier: Apache-2.0
// CLIP's text tower (Radford et al. 2021, "Learning transferable visual models from natural language supervision",
// section 2.4): a causal pre-norm transformer; the end token's last state, normalised and projected, is what the
// sentence means.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <string>
#include <vector>

#include "services/core/result.h"
#include "services/store/safetensors.h"

namespace etude::clip {

/// Of a tower; of ViT-B/32's: 49408, 77, 512, 2048, 12, 8, 512.
struct TowerSizes {
  std::int64_t vocabulary = 0;  ///< token ids
  std::int64_t positions = 0;   ///< tokens of the longest sentence, start and end included
  std::int64_t width = 0;       ///< of a token
  std::int64_t hidden = 0;      ///< of the layer between a block's two linear ones
  std::int64_t layers = 0;
  std::int64_t heads = 0;
  std::int64_t output = 0;  ///< of what a sentence becomes
};

/// Whether a tensor of model.safetensors is the text tower's; the others are the picture's.
bool IsOfTower(std::string_view name);

/// What config.json says (`text_config` in it, or itself), and for what it does not say the tensors' shapes; heads are
/// then 64 wide each. The output is always as wide as its tensor: config.json says that in two places, which differ in
/// published files.
/// @param config_json  "": there is none
/// @error kCorrupt: neither tells a size (names the tensor); sizes that cannot be; another activation than quick_gelu,
/// another epsilon than 1e-5
Result<TowerSizes> SizesOf(const store::Safetensors& model, const std::string& config_json);

/// Frozen by what it is: no torch module, so that no optimiser, average or checkpoint ever sees its weights.
/// Immutable; Embed may be called from several threads at once.
class Tower {
 public:
  /// Weights of float32, float16 or bfloat16, kept as float32.
  /// @error kCorrupt: every tensor that is missing, or of another shape or type than `sizes` wants, by name
  static Result<Tower> Create(const store::Safetensors& model, const TowerSizes& sizes);

  const TowerSizes& sizes() const { return sizes_; }
  /// @param ids  at most sizes().positions, each in [0, sizes().vocabulary)
  /// @param end  the place of the end token in `ids`
  /// @returns (output) float32, without gradient
  torch::Tensor Embed(const std::vector<std::int64_t>& ids, std::int64_t end) const;

 private:
  /// A linear map, or a normalisation.
  struct Affine {
    torch::Tensor weight, bias;
  };
  struct Block {
    Affine norm1, query, key, value, out, norm2, up, down;
  };
  class Weights;
  Tower() = default;
  torch::Tensor Normalise(const torch::Tensor& x, const Affine& norm) const;
  torch::Tensor Attend(const torch::Tensor& x, const Block& block) const;

  TowerSizes sizes_;
  torch::Tensor tokens_, positions_;  ///< (V, W), (P, W)
  std::vector<Block> blocks_;
  Affine norm_;
  torch::Tensor projection_;  ///< (O, W)
};

}  // namespace etude::clip
