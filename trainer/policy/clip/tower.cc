// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/clip/tower.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <torch/utils.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <optional>

#include "services/core/check.h"
#include "services/episode/bounded_json.h"

namespace etude::clip {
namespace {

using torch::Tensor;

constexpr std::string_view kPrefix = "text_model.";
constexpr char kTokens[] = "text_model.embeddings.token_embedding.weight";
constexpr char kPositions[] = "text_model.embeddings.position_embedding.weight";
constexpr char kLayers[] = "text_model.encoder.layers.";
constexpr char kProjection[] = "text_projection.weight";
constexpr double kEpsilon = 1e-5;
constexpr std::int64_t kHeadWidth = 64;            // of every CLIP that was published
constexpr std::int64_t kMostOfAnything = 1 << 24;  // products of two sizes stay far from overflow
constexpr std::int64_t kMostLayers = 1024;
constexpr std::size_t kNamedProblems = 8;

tl::unexpected<Error> Corrupt(std::string message) { return Fail(Code::kCorrupt, std::move(message)); }

// `name` is the tensor that tells `size`, where config.json does not
Status CheckSize(const std::string& name, std::int64_t size, std::int64_t most) {
  if (size < 1) return Corrupt(fmt::format("model.safetensors: '{}' is missing, or no matrix", name));
  if (size > most) return Corrupt(fmt::format("model.safetensors: '{}': a size of more than {}", name, most));
  return {};
}

std::string LayerName(std::int64_t layer) { return fmt::format("{}{}.", kLayers, layer); }

// one more than the largest number that stands behind kLayers
std::int64_t CountLayers(const store::Safetensors& model) {
  std::int64_t count = 0;
  for (const auto& [name, tensor] : model.tensors) {
    if (!name.starts_with(kLayers)) continue;
    std::int64_t layer = -1;
    std::from_chars(name.data() + std::string_view(kLayers).size(), name.data() + name.size(), layer);
    count = std::max(count, std::min(layer, kMostLayers) + 1);
  }
  return count;
}

/// What config.json says of the text tower.
class Config {
 public:
  static Result<Config> Parse(const std::string& text) {
    Config config;
    if (text.empty()) return config;
    const auto json = ParseBoundedJson(text);
    if (!json || !json->is_object()) return Corrupt("config.json is not a JSON map");
    config.root_ = *json;
    const auto inner = json->find("text_config");
    config.text_ = inner != json->end() && inner->is_object() ? *inner : *json;
    return config;
  }

  /// Replaces `size` by what stands under `key`, if anything does.
  Status Read(const char* key, std::int64_t& size) const {
    const OrderedJson* found = Find(key);
    if (!found) return {};
    if (!found->is_number_unsigned()) return Corrupt(fmt::format("config.json: '{}' is {}", key, found->dump()));
    size = static_cast<std::int64_t>(
        std::min<std::uint64_t>(found->get<std::uint64_t>(), static_cast<std::uint64_t>(kMostOfAnything) + 1));
    return {};
  }

  // what the tower computes otherwise is not this tower
  Status CheckKind() const {
    if (const OrderedJson* found = Find("hidden_act"); found && *found != "quick_gelu")
      return Corrupt(fmt::format("config.json: hidden_act is {}, and only quick_gelu is known", found->dump()));
    const OrderedJson* epsilon = Find("layer_norm_eps");
    if (epsilon && !(epsilon->is_number() && std::abs(epsilon->get<double>() - kEpsilon) < 1e-9))
      return Corrupt(fmt::format("config.json: layer_norm_eps is {}, and only {} is known", epsilon->dump(), kEpsilon));
    return {};
  }

 private:
  // some keys stand beside text_config
  const OrderedJson* Find(const char* key) const {
    for (const OrderedJson* map : {&text_, &root_})
      if (const auto found = map->find(key); found != map->end() && !found->is_null()) return &*found;
    return nullptr;
  }

  OrderedJson root_ = OrderedJson::object(), text_ = OrderedJson::object();
};

}  // namespace

bool IsOfTower(std::string_view name) { return name.starts_with(kPrefix) || name == kProjection; }

Result<TowerSizes> SizesOf(const store::Safetensors& model, const std::string& config_json) {
  const auto extent = [&](const std::string& name, std::size_t axis) -> std::int64_t {
    const auto found = model.tensors.find(name);
    return found != model.tensors.end() && found->second.shape.size() == 2 ? found->second.shape[axis] : 0;
  };
  TowerSizes sizes{.vocabulary = extent(kTokens, 0),
                   .positions = extent(kPositions, 0),
                   .width = extent(kTokens, 1),
                   .hidden = extent(LayerName(0) + "mlp.fc1.weight", 0),
                   .layers = CountLayers(model),
                   .output = extent(kProjection, 0)};
  ETUDE_ASSIGN_OR_RETURN(const Config config, Config::Parse(config_json));
  ETUDE_RETURN_IF_ERROR(config.CheckKind());
  ETUDE_RETURN_IF_ERROR(config.Read("vocab_size", sizes.vocabulary));
  ETUDE_RETURN_IF_ERROR(config.Read("max_position_embeddings", sizes.positions));
  ETUDE_RETURN_IF_ERROR(config.Read("hidden_size", sizes.width));
  ETUDE_RETURN_IF_ERROR(config.Read("intermediate_size", sizes.hidden));
  ETUDE_RETURN_IF_ERROR(config.Read("num_hidden_layers", sizes.layers));
  ETUDE_RETURN_IF_ERROR(config.Read("num_attention_heads", sizes.heads));
  for (const auto& [size, most, name] : {std::tuple{sizes.vocabulary, kMostOfAnything, std::string(kTokens)},
                                         {sizes.positions, kMostOfAnything, kPositions},
                                         {sizes.width, kMostOfAnything, kTokens},
                                         {sizes.hidden, kMostOfAnything, LayerName(0) + "mlp.fc1.weight"},
                                         {sizes.layers, kMostLayers, LayerName(0) + "mlp.fc1.weight"},
                                         {sizes.output, kMostOfAnything, kProjection}})
    ETUDE_RETURN_IF_ERROR(CheckSize(name, size, most));
  if (sizes.heads == 0 && sizes.width % kHeadWidth == 0) sizes.heads = sizes.width / kHeadWidth;
  if (sizes.heads < 1 || sizes.width % sizes.heads != 0)
    return Corrupt(
        fmt::format("{} heads on a width of {}: config.json has to say num_attention_heads, which divides it",
                    sizes.heads, sizes.width));
  return sizes;
}

/// Takes tensors out of a file and remembers what is wrong with them.
class Tower::Weights {
 public:
  explicit Weights(const store::Safetensors& model) : model_(model) {}

  Tensor Take(const std::string& name, const std::vector<std::int64_t>& shape) {
    const auto found = model_.tensors.find(name);
    if (found == model_.tensors.end()) return Problem(fmt::format("'{}' is missing", name));
    const store::Tensor& tensor = found->second;
    if (tensor.shape != shape)
      return Problem(
          fmt::format("'{}' is [{}], not [{}]", name, fmt::join(tensor.shape, ", "), fmt::join(shape, ", ")));
    const auto type = TypeOf(tensor.dtype);
    if (!type) return Problem(fmt::format("'{}' is {}, not F32, F16 or BF16", name, store::ToString(tensor.dtype)));
    // from_blob does not own, and wants no const
    void* const data = const_cast<std::uint8_t*>(tensor.data.data());
    return torch::from_blob(data, shape, torch::TensorOptions().dtype(*type))
        .to(torch::kFloat32, /*non_blocking=*/false, /*copy=*/true);
  }

  Affine TakeAffine(const std::string& name, std::vector<std::int64_t> shape) {
    Tensor weight = Take(name + ".weight", shape);
    return {std::move(weight), Take(name + ".bias", {shape.front()})};
  }

  Status status() const {
    if (problems_.empty()) return {};
    const std::size_t named = std::min(problems_.size(), kNamedProblems);
    const std::vector<std::string> first(problems_.begin(), problems_.begin() + static_cast<std::ptrdiff_t>(named));
    return Corrupt(fmt::format("model.safetensors: {}{}", fmt::join(first, "; "),
                               named < problems_.size() ? fmt::format("; and {} more", problems_.size() - named) : ""));
  }

 private:
  static std::optional<torch::ScalarType> TypeOf(store::DType type) {
    if (type == store::DType::kF32) return torch::kFloat32;
    if (type == store::DType::kF16) return torch::kFloat16;
    if (type == store::DType::kBF16) return torch::kBFloat16;
    return std::nullopt;
  }

  Tensor Problem(std::string text) {
    problems_.push_back(std::move(text));
    return {};
  }

  const store::Safetensors& model_;
  std::vector<std::string> problems_;
};

Result<Tower> Tower::Create(const store::Safetensors& model, const TowerSizes& sizes) {
  const std::int64_t width = sizes.width;
  Weights weights(model);
  Tower tower;
  tower.sizes_ = sizes;
  tower.tokens_ = weights.Take(kTokens, {sizes.vocabulary, width});
  tower.positions_ = weights.Take(kPositions, {sizes.positions, width});
  for (std::int64_t layer = 0; layer < sizes.layers; ++layer) {
    const std::string name = LayerName(layer);
    Block& block = tower.blocks_.emplace_back();
    block.norm1 = weights.TakeAffine(name + "layer_norm1", {width});
    block.query = weights.TakeAffine(name + "self_attn.q_proj", {width, width});
    block.key = weights.TakeAffine(name + "self_attn.k_proj", {width, width});
    block.value = weights.TakeAffine(name + "self_attn.v_proj", {width, width});
    block.out = weights.TakeAffine(name + "self_attn.out_proj", {width, width});
    block.norm2 = weights.TakeAffine(name + "layer_norm2", {width});
    block.up = weights.TakeAffine(name + "mlp.fc1", {sizes.hidden, width});
    block.down = weights.TakeAffine(name + "mlp.fc2", {width, sizes.hidden});
  }
  tower.norm_ = weights.TakeAffine("text_model.final_layer_norm", {width});
  tower.projection_ = weights.Take(kProjection, {sizes.output, width});
  ETUDE_RETURN_IF_ERROR(weights.status());
  return tower;
}

Tensor Tower::Normalise(const Tensor& x, const Affine& norm) const {
  return torch::layer_norm(x, {sizes_.width}, norm.weight, norm.bias, kEpsilon);
}

// x: (T, W). Each token sees itself and those before it.
Tensor Tower::Attend(const Tensor& x, const Block& block) const {
  const std::int64_t length = x.size(0), head_width = sizes_.width / sizes_.heads;
  const auto heads = [&](const Affine& map) {  // (h, T, W / h)
    return torch::linear(x, map.weight, map.bias).view({length, sizes_.heads, head_width}).transpose(0, 1);
  };
  const Tensor later =
      torch::full({length, length}, -std::numeric_limits<float>::infinity(), x.options()).triu(/*diagonal=*/1);
  const Tensor scores =
      torch::matmul(heads(block.query), heads(block.key).transpose(1, 2)) / std::sqrt(static_cast<double>(head_width));
  const Tensor read = torch::matmul(torch::softmax(scores + later, -1), heads(block.value));
  return torch::linear(read.transpose(0, 1).reshape({length, sizes_.width}), block.out.weight, block.out.bias);
}

Tensor Tower::Embed(const std::vector<std::int64_t>& ids, std::int64_t end) const {
  const auto length = static_cast<std::int64_t>(ids.size());
  ETUDE_CHECK(length <= sizes_.positions && end >= 0 && end < length, "{} tokens, end at {}", length, end);
  const torch::NoGradGuard no_grad;
  Tensor x = tokens_.index_select(0, torch::tensor(ids, torch::kInt64)) + positions_.narrow(0, 0, length);
  for (const Block& block : blocks_) {
    x = x + Attend(Normalise(x, block.norm1), block);
    const Tensor up = torch::linear(Normalise(x, block.norm2), block.up.weight, block.up.bias);
    // quick_gelu
    x = x + torch::linear(up * torch::sigmoid(1.702 * up), block.down.weight, block.down.bias);
  }
  return torch::linear(Normalise(x.narrow(0, end, 1), norm_), projection_).squeeze(0);
}

}  // namespace etude::clip
