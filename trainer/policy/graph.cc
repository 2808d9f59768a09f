// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/graph.h"

#include <algorithm>

#include "services/core/check.h"
#include "services/episode/action.h"

namespace etude::policy {
namespace {

using torch::Tensor;

constexpr int kWaves = 5;
constexpr double kLongestWave = 0.64;  // m; the shortest is 0.04

/// sin and cos of 2 pi x / wavelength: (..., 3) m -> (..., 30).
Tensor Waves(const Tensor& x) {
  std::vector<Tensor> parts;
  for (int k = 0; k < kWaves; ++k) {
    const Tensor phase = x * (2 * M_PI * (1 << k) / kLongestWave);
    parts.push_back(torch::sin(phase));
    parts.push_back(torch::cos(phase));
  }
  return torch::cat(parts, -1);
}

Tensor Position(const ModuleOutput& output) {
  const auto pose = output.decoded.find("pose");
  return pose != output.decoded.end() ? pose->second.narrow(-1, 0, 3) : output.decoded.at("position");
}

bool Reads(const Wiring& wiring, const std::string& key) {
  return std::find(wiring.reads.begin(), wiring.reads.end(), key) != wiring.reads.end();
}

int DecodedWidth(const std::string& kind, int objects) {
  if (kind == "class") return objects;
  if (kind == "pixel") return 2;
  if (kind == "pose") return 9;
  if (kind == "trajectory") return kWaypoints * kWaypointSize;
  return 3;
}

}  // namespace

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
                         const Normalization& normalization, const TokenGrid& grid, int segment)
    : config_(config),
      wiring_(std::move(wiring)),
      normalization_(normalization),
      width_(policy.width),
      heads_(policy.heads),
      objects_(static_cast<int>(policy.objects.size())),
      stride_(grid.stride),
      segment_(segment) {
  const bool own = policy.attention == "module";
  const auto others = static_cast<int>(wiring_.reads.size()) - (Reads(wiring_, "image") ? 1 : 0);
  if (config_.query.empty()) register_ = register_parameter("register", torch::randn({width_}));
  if (own) {
    attention_ = register_module("attention", std::make_shared<Attention>(width_, heads_));
    norm_ = register_module("norm", std::make_shared<LayerNorm>(width_));
    if (others > 0) segments_ = register_parameter("segments", 0.1 * torch::randn({others, width_}));
  } else if (config_.query.empty()) {
    const auto head = [&] { return std::make_shared<TokenHead>(width_, width_, policy.activation); };
    query_head_ = register_module("query_head", head());
    if (Reads(wiring_, "self")) {
      key_head_ = register_module("key_head", head());
      value_head_ = register_module("value_head", head());
    }
  }
  if (!config_.decoder.target.empty()) MakeDecoder(policy);
}

void GraphModule::MakeDecoder(const PolicyConfig& policy) {
  int features = 0;
  for (const std::string& text : config_.decoder.inputs) {
    inputs_.push_back(ParseDecoderInput(text));
    features += FeatureWidth(inputs_.back());
  }
  const std::string kind = DecodeKind(config_.decoder.target);
  decoder_ = register_module("decoder", std::make_shared<Mlp>(features, config_.decoder.hidden,
                                                              DecodedWidth(kind, objects_), policy.activation));
  // a pixel starts at the soft-argmax itself, a displacement at the difference of two positions
  if ((kind == "pixel" && Reads(wiring_, "image")) || !config_.decoder.between.empty()) decoder_->ScaleOutput(0);
}

int GraphModule::FeatureWidth(const DecoderInput& input) const {
  if (input.waves && input.kind != "joints") return 3 * 2 * kWaves;
  if (input.kind == "register" || input.kind == "language") return width_;
  if (input.kind == "soft_argmax") return 2 * heads_ + 2;
  if (input.kind == "joints") return static_cast<int>(normalization_.joint_mean.size(0)) * (input.waves ? 2 : 1);
  return DecodedWidth(input.kind, objects_);
}

ModuleOutput GraphModule::Forward(const Tokens& tokens, const std::vector<ModuleOutput>& earlier,
                                  const SharedAttention* shared) {
  const bool one = !wiring_.depends_on_sentence || (wiring_.first_sentence_only && is_training());
  const Context context{tokens, earlier, shared, tokens.joint_values.size(0), one ? 1 : tokens.sentence.size(1)};
  Attention& attention = shared != nullptr ? *shared->levels.at(config_.level) : *attention_;
  const Attended attended = attention.Forward(Query(context), CollectKeys(context));

  ModuleOutput output;
  output.reg = norm_ != nullptr ? norm_->Forward(attended.output) : attended.output;
  output.attention = attended.map;
  if (attended.pixels.defined()) {
    output.head_soft_argmax = attended.pixels + tokens.crop_origin.view({-1, 1, 1, 2});
    output.soft_argmax = output.head_soft_argmax.mean(2);
  }
  if (decoder_ != nullptr) Decode(context, output);
  return output;
}

Tensor GraphModule::Query(const Context& context) {
  if (config_.query.empty()) {
    const Tensor own =
        query_head_ != nullptr ? query_head_->Forward(register_) + context.shared->segments[segment_] : register_;
    return own.expand({context.batch, context.sentences, width_});
  }
  const Tensor& other = context.earlier[wiring_.index.at(config_.query)].reg;
  return context.Expand(config_.detach ? other.detach() : other);
}

// Its own register as a key; with own attention that is its query itself.
Token GraphModule::OwnToken(const Context& context, bool as_key) {
  if (!as_key || key_head_ == nullptr) {
    const Tensor query = Query(context);
    return {query, query};
  }
  const auto segment = context.shared->segments[segment_];
  return {(key_head_->Forward(register_) + segment).expand({context.batch, 1, width_}),
          (value_head_->Forward(register_) + segment).expand({context.batch, 1, width_})};
}

Keys GraphModule::CollectKeys(const Context& context) {
  Keys keys;
  std::vector<Tensor> key, value;
  for (const std::string& name : wiring_.reads) {
    if (name == "image") {
      keys.image_key = context.tokens.image.key;
      keys.image_value = context.tokens.image.value;
      keys.image_pixels = context.tokens.image_pixels;
      continue;
    }
    Token token;
    if (name == "language") {
      token = context.tokens.language;
    } else if (name == "joints") {
      token = context.tokens.joints;
    } else if (name == "self") {
      token = OwnToken(context, true);
    } else {
      const Tensor& reg = context.earlier[wiring_.index.at(name)].reg;
      token.key = token.value = config_.detach ? reg.detach() : reg;
    }
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
  if (segments_.defined()) {
    keys.other_key = keys.other_key + segments_;
    keys.other_value = same ? keys.other_key : keys.other_value + segments_;
  }
  return keys;
}

Tensor GraphModule::Feature(const DecoderInput& input, const Context& context, const ModuleOutput& own) const {
  if (input.kind == "joints") {
    const Tensor& x = context.tokens.joint_values;
    if (!input.waves) return x;
    const Tensor angle = normalization_.joint_mean + normalization_.joint_std * x;
    return torch::cat({torch::sin(angle), torch::cos(angle)}, -1);
  }
  if (input.kind == "language") return context.tokens.sentence;
  const ModuleOutput& source = input.module.empty() ? own : context.earlier[wiring_.index.at(input.module)];
  const auto pass = [&](const Tensor& x, bool detach) { return detach ? x.detach() : x; };
  const bool foreign = !input.module.empty();
  if (input.kind == "register") return pass(source.reg, foreign && config_.detach);
  if (input.kind == "soft_argmax") {
    const Tensor pixels = torch::cat({source.head_soft_argmax.flatten(2), source.soft_argmax}, -1);
    return pass(pixels, foreign && config_.detach) / kPixelScale - 1;
  }
  const bool detach = config_.decoder.detach || config_.detach;
  if (input.kind == "class") return pass(torch::softmax(source.decoded.at("class"), -1), detach);
  if (input.kind == "pixel") return pass(source.decoded.at("pixel"), detach) / kPixelScale - 1;
  if (input.kind == "displacement") {
    const Tensor x = pass(source.decoded.at("displacement"), detach);
    return input.waves ? Waves(x) : x / normalization_.displacement_std;
  }
  ETUDE_CHECK(input.kind == "position", "{}", input.kind);
  const Tensor x = pass(Position(source), detach);
  return input.waves ? Waves(x) : (x - normalization_.position_mean) / normalization_.position_std;
}

void GraphModule::Decode(const Context& context, ModuleOutput& output) {
  std::vector<Tensor> features;
  for (const DecoderInput& input : inputs_) features.push_back(context.Expand(Feature(input, context, output)));
  const Tensor raw = decoder_->Forward(features.size() == 1 ? features[0] : torch::cat(features, -1));

  const std::string kind = DecodeKind(config_.decoder.target);
  const auto place = [&](const Tensor& x) { return normalization_.position_mean + normalization_.position_std * x; };
  if (kind == "class") {
    output.decoded["class"] = raw;
  } else if (kind == "pixel") {
    output.decoded["pixel"] =
        output.soft_argmax.defined() ? output.soft_argmax + 2.0 * stride_ * raw : kPixelScale * (1 + raw);
  } else if (kind == "position") {
    output.decoded["position"] = place(raw);
  } else if (kind == "pose") {
    output.decoded["pose"] = torch::cat({place(raw.narrow(-1, 0, 3)), raw.narrow(-1, 3, 6)}, -1);
  } else if (kind == "displacement") {
    Tensor displacement = normalization_.displacement_std * raw;
    if (!config_.decoder.between.empty()) {
      const auto position = [&](const std::string& module) {
        const Tensor p = Position(context.earlier[wiring_.index.at(module)]);
        return context.Expand(config_.decoder.detach || config_.detach ? p.detach() : p);
      };
      displacement = displacement + position(config_.decoder.between[1]) - position(config_.decoder.between[0]);
    }
    output.decoded["displacement"] = displacement;
  } else {
    DecodeTrajectory(context, raw, output);
  }
}

void GraphModule::DecodeTrajectory(const Context& context, const Tensor& raw, ModuleOutput& output) const {
  const Tensor points = raw.view({context.batch, context.sentences, kWaypoints, kWaypointSize});
  Tensor xyz = points.narrow(-1, 0, 3);
  if (config_.decoder.relative_to.empty()) {
    xyz = normalization_.position_mean + normalization_.position_std * xyz;
  } else {
    const Tensor origin = Position(context.earlier[wiring_.index.at(config_.decoder.relative_to)]);
    const Tensor fixed = config_.decoder.detach ? origin.detach() : origin;
    xyz = context.Take(fixed).unsqueeze(2) + normalization_.offset_std * xyz;
  }
  output.waypoint_scale = normalization_.offset_std.mean(-1);
  output.gripper_logits = points.select(-1, kWaypointSize - 1);
  output.decoded["trajectory"] =
      torch::cat({xyz, points.narrow(-1, 3, 6), torch::sigmoid(output.gripper_logits).unsqueeze(-1)}, -1);
}

}  // namespace etude::policy
