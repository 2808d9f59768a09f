// SPDX-License-Identifier: Apache-2.0
// Picture -> image tokens: convolutions, a linear map per token, and where the token is.
// Shapes: B images, h x w px, P = rows x columns tokens, d width.
#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "trainer/policy/config.h"
#include "trainer/policy/layers.h"
#include "trainer/policy/quantities/output.h"
#include "trainer/policy/torch.h"

namespace etude::policy {

/// Where image tokens are; a function of the configuration alone.
struct TokenGrid {
  explicit TokenGrid(const ImageConfig& config);
  int rows = 0, columns = 0;
  int stride = 1;  ///< px of the picture from one token to the next
  /// (P, 2) px, u then v: centres of the tokens' patches, relative to the crop's corner.
  torch::Tensor Centres(const torch::TensorOptions& options) const;
};

class ImageEncoder : public torch::nn::Module {
 public:
  ImageEncoder(const ImageConfig& config, int width, const std::string& precision);
  /// @param images       (B, 3, h, w) uint8
  /// @param crop_origin  (B, 2) px
  /// @returns (B, P, d): with fourier positions float32, with index positions in the type of the convolutions
  torch::Tensor Forward(const torch::Tensor& images, const torch::Tensor& crop_origin);
  const TokenGrid& grid() const { return grid_; }

 private:
  struct Layer {
    ImageLayer config;
    std::vector<torch::Tensor> weights;  ///< one, or two of a residual layer
    torch::Tensor bias;                  ///< only without normalisation
    std::vector<std::shared_ptr<NormRelu>> norms;
  };
  Layer MakeLayer(const ImageLayer& config, int channels, int index);
  torch::Tensor Normalised(const torch::Tensor& images, torch::ScalarType type) const;
  torch::Tensor ApplyLayer(Layer& layer, const torch::Tensor& x);
  torch::Tensor FourierTokens(const torch::Tensor& features, const torch::Tensor& crop_origin);
  torch::Tensor IndexTokens(const torch::Tensor& features);

  ImageConfig config_;
  TokenGrid grid_;
  bool wants_bf16_;
  std::vector<Layer> layers_;
  torch::nn::Linear narrow_{nullptr};    ///< channels -> d
  torch::nn::Linear position_{nullptr};  ///< fourier: 18 -> d;  index: d + 2 -> d
  std::shared_ptr<LayerNorm> norm_;      ///< fourier only
};

/// Sines and cosines of pi 2^k x, k = 0..3, after x itself: (..., 9).
torch::Tensor PositionFeatures(const torch::Tensor& x);

}  // namespace etude::policy
