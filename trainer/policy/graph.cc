// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/graph.h"

#include <algorithm>

namespace etude::policy {
namespace {

using torch::Tensor;

bool Reads(const Wiring& wiring, const std::string& key) {
  return std::find(wiring.reads.begin(), wiring.reads.end(), key) != wiring.reads.end();
}

}  // namespace

Tensor JointFeatures(const Tensor& values, const Normalization& normalization) {
  const Tensor angle = normalization.joint_mean + normalization.joint_std * values;
  return torch::cat({torch::sin(angle), torch::cos(angle)}, -1);
}

/// One evaluation: what is there, and for how many sentences to work.
struct GraphModule::Context {
  const Tokens& tokens;
  const std::vector<ModuleOutput>& earlier;
  const SharedAttention* shared;
  std::int64_t batch, sentences;

  /// (B, S | 1, ...) as this evaluation needs it: the first sentence only when it works for one.
  Tensor Take(const Tensor& x) const { return x.size(1) > sentences ? x.narrow(1, 0, sentences) : x; }
  Tensor Expand(const Tensor& x) const {
    const Tensor taken = Take(x);
    if (taken.size(1) == sentences) return taken;
    std::vector<std::int64_t> sizes(taken.sizes().begin(), taken.sizes().end());
    sizes[1] = sentences;
    return taken.expand(sizes);
  }
};

GraphModule::GraphModule(const PolicyConfig& policy, const ModuleConfig& config, Wiring wiring,
                         const Normalization& normalization, const TokenGrid& grid)
    : config_(config),
      wiring_(std::move(wiring)),
      normalization_(normalization),
      width_(policy.width),
      stride_(grid.stride),
      head_(HeadOf(policy, config)),
      quantity_(QuantityOf(config)) {
  const bool own = policy.attention == "module";
  if (config_.query.empty()) register_ = register_parameter("register", torch::randn({width_}));
  if (own) {
    attention_ = register_module("attention", std::make_shared<Attention>(width_, policy.heads));
    norm_ = register_module("norm", std::make_shared<LayerNorm>(width_));
    RegisterSegments();
  } else if (config_.query.empty()) {
    const auto head = [&] { return std::make_shared<TokenHead>(width_, width_, policy.activation); };
    query_head_ = register_module("query_head", head());
    if (Reads(wiring_, "self")) {
      key_head_ = register_module("key_head", head());
      value_head_ = register_module("value_head", head());
    }
  }
  if (quantity_ != nullptr) MakeDecoder(policy);
  if (config_.own_image)
    own_image_ = register_module("image", std::make_shared<ImageEncoder>(policy.image, width_, policy.precision));
}

// one a key, by the key's name; drawn together, so that what a seed makes does not depend on how they are kept
void GraphModule::RegisterSegments() {
  std::vector<std::string> keys = wiring_.reads;
  std::erase(keys, "image");
  if (keys.empty()) return;
  const Tensor drawn = 0.1 * torch::randn({static_cast<std::int64_t>(keys.size()), width_});
  const auto segments = register_module("segments", std::make_shared<torch::nn::Module>());
  for (std::size_t i = 0; i < keys.size(); ++i)
    segments_.push_back(segments->register_parameter(keys[i], drawn[static_cast<std::int64_t>(i)].clone()));
}

void GraphModule::MakeDecoder(const PolicyConfig& policy) {
  std::vector<std::pair<std::string, int>> widths;
  for (const std::string& text : config_.decoder.inputs) {
    inputs_.push_back(ParseDecoderInput(text));
    widths.emplace_back(text,
                        FeatureWidth(policy, inputs_.back(), static_cast<int>(normalization_.joint_mean.size(0))));
  }
  decoder_ = register_module(
      "decoder", std::make_shared<Decoder>(widths, config_.decoder.hidden, quantity_->width(head_), policy.activation));
  if (quantity_->starts_at_zero(head_)) decoder_->StartAtZero();
}

ModuleOutput GraphModule::Forward(const Tokens& tokens, const std::vector<ModuleOutput>& earlier,
                                  const SharedAttention* shared) {
  const bool one = !wiring_.depends_on_sentence || (wiring_.first_sentence_only && is_training());
  const Context context{tokens, earlier, shared, tokens.joint_values.size(0), one ? 1 : tokens.sentence.size(1)};
  Attention& attention = shared != nullptr ? *shared->levels.at(config_.level) : *attention_;
  const Attended attended = attention.Forward(Query(context), CollectKeys(context));

  ModuleOutput output;
  output.register_token = norm_ != nullptr ? norm_->Forward(attended.output) : attended.output;
  output.attention = attended.map;
  output.head_attention = attended.heads;
  if (attended.pixels.defined()) {
    output.head_soft_argmax = attended.pixels + tokens.crop_origin.view({-1, 1, 1, 2});
    output.soft_argmax = output.head_soft_argmax.mean(2);
  }
  if (decoder_ != nullptr) Decode(context, output);
  return output;
}

Tensor GraphModule::Query(const Context& context) {
  if (config_.query.empty()) {
    const Tensor own = query_head_ != nullptr
                           ? query_head_->Forward(register_) + context.shared->segments.at(config_.name)
                           : register_;
    return own.expand({context.batch, context.sentences, width_});
  }
  return context.Expand(RegisterOf(config_.query, context));
}

const ModuleOutput& GraphModule::OutputOf(const std::string& module, const Context& context) const {
  return context.earlier[static_cast<std::size_t>(wiring_.index.at(module))];
}

// Nothing but its readers trains what a module says that decodes nothing: they carry their gradient to it.
Tensor GraphModule::RegisterOf(const std::string& module, const Context& context) const {
  const ModuleConfig& source = *wiring_.earlier[static_cast<std::size_t>(wiring_.index.at(module))];
  const Tensor& token = OutputOf(module, context).register_token;
  return config_.detach && !source.decoder.quantity.empty() ? token.detach() : token;
}

// Its own register as a key; with own attention that is its query itself.
Token GraphModule::OwnToken(const Context& context, bool as_key) {
  if (!as_key || key_head_ == nullptr) {
    const Tensor query = Query(context);
    return {query, query};
  }
  const auto segment = context.shared->segments.at(config_.name);
  return {(key_head_->Forward(register_) + segment).expand({context.batch, 1, width_}),
          (value_head_->Forward(register_) + segment).expand({context.batch, 1, width_})};
}

Token GraphModule::TokenOf(const std::string& name, const Context& context) {
  if (name == "language") return context.tokens.language;
  if (name == "joints") return context.tokens.joints;
  if (name == "self") return OwnToken(context, true);
  const Tensor token = RegisterOf(name, context);
  return {token, token};
}

Token GraphModule::ImageToken(const Tokens& tokens) {
  if (own_image_ == nullptr) return tokens.image;
  const Tensor seen =
      own_image_->Forward(tokens.picture, tokens.crop_origin).to(normalization_.joint_mean.scalar_type());
  return {seen, seen};
}

Keys GraphModule::CollectKeys(const Context& context) {
  Keys keys;
  std::vector<Tensor> key, value;
  for (const std::string& name : wiring_.reads) {
    if (name == "image") {
      const Token image = ImageToken(context.tokens);
      keys.image_key = image.key;
      keys.image_value = image.value;
      keys.image_pixels = context.tokens.image_pixels;
      keys.image_unattended = context.tokens.image_unattended;
      continue;
    }
    const Token token = TokenOf(name, context);
    key.push_back(context.Take(token.key));
    value.push_back(context.Take(token.value));
  }
  if (key.empty()) return keys;
  // keys that do not depend on the sentence stay (B, 1, ...) when none does
  std::int64_t sentences = 1;
  for (const Tensor& k : key) sentences = std::max(sentences, k.size(1));
  const auto stack = [&](std::vector<Tensor>& items) {
    for (Tensor& item : items) item = item.expand({context.batch, sentences, width_});
    return torch::stack(items, 2);
  };
  const bool same = key[0].is_same(value[0]) && context.shared == nullptr;
  keys.other_key = stack(key);
  keys.other_value = same ? keys.other_key : stack(value);
  if (!segments_.empty()) {
    const Tensor segments = torch::stack(segments_);
    keys.other_key = keys.other_key + segments;
    keys.other_value = same ? keys.other_key : keys.other_value + segments;
  }
  return keys;
}

Tensor GraphModule::Feature(const DecoderInput& input, const Context& context, const ModuleOutput& own) const {
  if (input.kind == "joints") {
    const Tensor& x = context.tokens.joint_values;
    return input.fourier ? JointFeatures(x, normalization_) : x;
  }
  if (input.kind == "joint_token") return context.tokens.joint_token;
  if (input.kind == "language") return context.tokens.sentence;
  const bool foreign = !input.module.empty();
  const ModuleOutput& source = foreign ? OutputOf(input.module, context) : own;
  if (input.kind == "register") return foreign ? RegisterOf(input.module, context) : source.register_token;
  if (input.kind == "soft_argmax") {
    const Tensor pixels = torch::cat({source.head_soft_argmax.flatten(2), source.soft_argmax}, -1);
    return (foreign && config_.detach ? pixels.detach() : pixels) / kPixelScale - 1;
  }
  const bool detach = config_.decoder.detach || config_.detach;
  return FindQuantity(input.kind)->Feature(source, normalization_, input.fourier, detach);
}

// (B, S', 6): where the camera is, and which way another module's pixel looks
torch::Tensor GraphModule::RayOf(const Context& context) const {
  TORCH_CHECK(context.tokens.viewpoint.defined(), "module ", config_.name, " needs to know the camera");
  const Tensor decoded = context.Expand(OutputOf(config_.decoder.from[0], context).decoded.at("pixel"));
  const Tensor pixel = config_.decoder.detach || config_.detach ? decoded.detach() : decoded;
  const Tensor viewpoint = context.tokens.viewpoint.unsqueeze(1);  // (B, 1, 12)
  const Tensor matrix = viewpoint.narrow(-1, 3, 9).unflatten(-1, {3, 3});
  const Tensor at = torch::cat({pixel, torch::ones_like(pixel.narrow(-1, 0, 1))}, -1);
  const Tensor way = (matrix * at.unsqueeze(-2)).sum(-1);  // (B, S', 3)
  return torch::cat({viewpoint.narrow(-1, 0, 3).expand_as(way), way}, -1);
}

// As Decoding::from; undefined without `from`
Tensor GraphModule::From(const Context& context) const {
  const auto position = [&](const std::string& module) { return PositionOf(OutputOf(module, context)); };
  const auto& from = config_.decoder.from;
  if (from.empty()) return {};
  if (config_.decoder.readout == "ray") return RayOf(context);
  const bool detach = config_.decoder.detach || (from.size() == 2 && config_.detach);
  if (config_.decoder.readout == "correction") {
    const Tensor plan = context.Take(OutputOf(from[0], context).decoded.at("trajectory"));
    return detach ? plan.detach() : plan;
  }
  if (from.size() == 1) return context.Take(detach ? position(from[0]).detach() : position(from[0]));
  const Tensor difference = context.Expand(position(from[1])) - context.Expand(position(from[0]));
  return detach ? difference.detach() : difference;
}

void GraphModule::Decode(const Context& context, ModuleOutput& output) {
  std::vector<Tensor> features;
  for (const DecoderInput& input : inputs_) features.push_back(context.Expand(Feature(input, context, output)));
  const Tensor from = From(context);
  quantity_->Decode(head_, {normalization_, stride_, &from}, decoder_->Forward(features), output);
}

}  // namespace etude::policy
