// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/image_encoder.h"

#include <fmt/format.h>

#include <cmath>

#include "services/core/check.h"
#include "trainer/policy/fused_norm.h"
#include "trainer/policy/torch_process.h"

namespace etude::policy {
namespace {

constexpr int kWaves = 4;
constexpr int kPositionFeatures = 1 + 2 * kWaves;

NormRelu::Kind NormKind(const std::string& norm) {
  if (norm == "batch") return NormRelu::Kind::kBatch;
  return norm == "instance" ? NormRelu::Kind::kInstance : NormRelu::Kind::kNone;
}

torch::Tensor ConvWeight(int outputs, int inputs, int kernel) {
  torch::Tensor weight = torch::empty({outputs, inputs, kernel, kernel});
  torch::nn::init::kaiming_normal_(weight, 0, torch::kFanOut, torch::kReLU);
  return weight;
}

torch::Tensor Convolve(const torch::Tensor& x, const torch::Tensor& weight, const torch::Tensor& bias, int stride,
                       const std::string& padding) {
  const auto half = weight.size(2) / 2;
  const torch::Tensor w = weight.to(x.scalar_type());
  const torch::Tensor b = bias.defined() ? bias.to(x.scalar_type()) : bias;
  if (padding == "reflect" && half > 0) {
    // torch mirrors no bfloat16
    const torch::Tensor padded = torch::reflection_pad2d(x.to(weight.scalar_type()), {half, half, half, half})
                                     .to(x.scalar_type())
                                     .contiguous(kChannelsLast);
    return torch::conv2d(padded, w, b, stride);
  }
  return torch::conv2d(x, w, b, stride, half);
}

}  // namespace

TokenGrid::TokenGrid(const ImageConfig& config) : rows(config.crop[3]), columns(config.crop[2]) {
  // "same" padding: each stride rounds up
  for (const ImageLayer& layer : config.layers) {
    if (layer.kind != "conv") continue;
    rows = (rows + layer.stride - 1) / layer.stride;
    columns = (columns + layer.stride - 1) / layer.stride;
    stride *= layer.stride;
  }
}

torch::Tensor TokenGrid::Centres(const torch::TensorOptions& options) const {
  const torch::Tensor u = (torch::arange(columns, options) + 0.5) * stride;
  const torch::Tensor v = (torch::arange(rows, options) + 0.5) * stride;
  return torch::stack({u.repeat({rows}), v.repeat_interleave(columns)}, -1);
}

torch::Tensor PositionFeatures(const torch::Tensor& x) {
  std::vector<torch::Tensor> parts{x};
  for (int k = 0; k < kWaves; ++k) {
    const torch::Tensor phase = x * (M_PI * (1 << k));
    parts.push_back(torch::sin(phase));
    parts.push_back(torch::cos(phase));
  }
  return torch::stack(parts, -1);
}

ImageEncoder::ImageEncoder(const ImageConfig& config, int width, const std::string& precision)
    : config_(config), grid_(config), wants_bf16_(precision == "bf16") {
  int channels = 3;
  for (std::size_t i = 0; i < config_.layers.size(); ++i) {
    layers_.push_back(MakeLayer(config_.layers[i], channels, static_cast<int>(i)));
    channels = config_.layers[i].channels;
  }
  narrow_ = register_module("narrow", torch::nn::Linear(channels, width));
  if (config_.position == "fourier") {
    position_ = register_module("position",
                                torch::nn::Linear(torch::nn::LinearOptions(2 * kPositionFeatures, width).bias(false)));
    norm_ = register_module("norm", std::make_shared<LayerNorm>(width));
  } else {
    position_ = register_module("position", torch::nn::Linear(width + 2, width));
  }
}

ImageEncoder::Layer ImageEncoder::MakeLayer(const ImageLayer& config, int channels, int index) {
  Layer layer{.config = config, .weights = {}, .bias = {}, .norms = {}};
  const bool residual = config.kind == "residual";
  const int kernel = residual ? 3 : config.kernel;
  for (int i = 0; i < (residual ? 2 : 1); ++i) {
    const std::string name = fmt::format("layer{}_{}", index, i);
    layer.weights.push_back(register_parameter(name + "_weight", ConvWeight(config.channels, channels, kernel)));
    layer.norms.push_back(
        register_module(name + "_norm", std::make_shared<NormRelu>(config.channels, NormKind(config.norm))));
  }
  if (config.norm == "none")
    layer.bias = register_parameter(fmt::format("layer{}_bias", index), torch::zeros({config.channels}));
  return layer;
}

torch::Tensor ImageEncoder::Normalised(const torch::Tensor& images, torch::ScalarType type) const {
  // 0..255 and its difference to a whole mean are exact in bfloat16
  return images.to(type).contiguous(kChannelsLast).sub_(config_.pixel_mean).mul_(1 / config_.pixel_scale);
}

torch::Tensor ImageEncoder::ApplyLayer(Layer& layer, const torch::Tensor& x) {
  const auto& [config, weights, bias, norms] = layer;
  if (config.kind == "conv") return norms[0]->Forward(Convolve(x, weights[0], bias, config.stride, config.padding));
  const torch::Tensor y = norms[0]->Forward(Convolve(x, weights[0], {}, 1, config.padding));
  return norms[1]->Forward(Convolve(y, weights[1], bias, 1, config.padding), x);
}

torch::Tensor ImageEncoder::Forward(const torch::Tensor& images, const torch::Tensor& crop_origin) {
  ETUDE_CHECK(images.dim() == 4 && images.size(1) == 3 && images.size(2) == config_.crop[3] &&
                  images.size(3) == config_.crop[2],
              "images are {}x{}, the crop is {}x{}", images.size(-1), images.size(-2), config_.crop[2],
              config_.crop[3]);
  const bool bf16 = wants_bf16_ && (images.is_cuda() || HasFastBf16());
  torch::Tensor x = Normalised(images, bf16 ? torch::kBFloat16 : narrow_->weight.scalar_type());
  for (Layer& layer : layers_) x = ApplyLayer(layer, x);
  // channels-last memory is (B, P, C) already
  const torch::Tensor features = x.permute({0, 2, 3, 1}).reshape({x.size(0), grid_.rows * grid_.columns, x.size(1)});
  return config_.position == "fourier" ? FourierTokens(features, crop_origin) : IndexTokens(features);
}

// Absolute pixel coordinates, so that a jittered crop does not move the world. A linear map of
// features of u and of v is the sum of a map per column and a map per row.
torch::Tensor ImageEncoder::FourierTokens(const torch::Tensor& features, const torch::Tensor& crop_origin) {
  const auto options = crop_origin.options();
  const torch::Tensor u = (torch::arange(grid_.columns, options) + 0.5) * grid_.stride;
  const torch::Tensor v = (torch::arange(grid_.rows, options) + 0.5) * grid_.stride;
  const auto embed = [&](const torch::Tensor& pixels, int axis) {
    const torch::Tensor absolute = (pixels.unsqueeze(0) + crop_origin.select(1, axis).unsqueeze(1)) / kPixelScale - 1;
    return torch::matmul(PositionFeatures(absolute),
                         position_->weight.narrow(1, axis * kPositionFeatures, kPositionFeatures).t());
  };
  const torch::Tensor position = embed(v, 1).unsqueeze(2) + embed(u, 0).unsqueeze(1);  // (B, rows, columns, d)
  const torch::Tensor tokens = torch::nn::functional::linear(features, narrow_->weight.to(features.scalar_type()),
                                                             narrow_->bias.to(features.scalar_type()));
  return norm_->Forward(tokens + position.flatten(1, 2));
}

// The original's: ReLU, then row and column numbers beside the features, then another linear map.
torch::Tensor ImageEncoder::IndexTokens(const torch::Tensor& features) {
  const auto type = features.scalar_type();
  const torch::Tensor narrow =
      torch::relu(torch::nn::functional::linear(features, narrow_->weight.to(type), narrow_->bias.to(type)));
  const auto options = position_->weight.options();
  const torch::Tensor column = torch::arange(grid_.columns, options).repeat({grid_.rows});
  const torch::Tensor row = torch::arange(grid_.rows, options).repeat_interleave(grid_.columns);
  const auto width = narrow.size(2);
  const torch::Tensor place =
      torch::matmul(torch::stack({column, row}, -1), position_->weight.narrow(1, width, 2).t()) + position_->bias;
  const torch::Tensor mapped = torch::nn::functional::linear(narrow, position_->weight.narrow(1, 0, width).to(type));
  return torch::relu(mapped.to(place.scalar_type()) + place).to(type);
}

}  // namespace etude::policy
