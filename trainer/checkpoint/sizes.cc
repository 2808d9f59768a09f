// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/sizes.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <set>

#include "trainer/policy/names.h"

namespace etude::checkpoint {
namespace {

constexpr std::uint64_t kMaxTokens = 65536;  // of the picture

using Size = std::uint64_t;  // sums of products of validated sizes stay far below its end

Size OfChain(const std::vector<int>& widths) {
  Size sum = 0;
  for (std::size_t i = 1; i < widths.size(); ++i)
    sum += static_cast<Size>(widths[i - 1]) * static_cast<Size>(widths[i]);
  return sum;
}

Size OfImage(const policy::PolicyConfig& config) {
  const policy::ImageConfig& image = config.image;
  const auto width = static_cast<Size>(config.width);
  Size sum = 0, channels = 3;
  for (const auto& layer : image.layers) {
    const auto next = static_cast<Size>(layer.channels);
    const auto kernel = static_cast<Size>(layer.kernel);
    sum += layer.kind == "residual" ? 18 * next * next : channels * next * kernel * kernel;
    channels = next;
  }
  return sum + channels * width + (image.position == "index" ? (width + 2) * width : 0);
}

// Of each module, or of each level with the maps to keys, values and queries that its modules share.
Size OfAttention(const policy::PolicyConfig& config) {
  const Size square = static_cast<Size>(config.width) * static_cast<Size>(config.width);
  if (config.attention == "module") return 4 * square * config.modules.size();
  std::set<int> levels;
  Size heads = 6;  // key and value of picture, joints and language
  for (const auto& module : config.modules) {
    levels.insert(module.level);
    const auto reads = policy::ResolveReads(config, module);
    const bool self = std::find(reads.begin(), reads.end(), "self") != reads.end();
    if (module.query.empty()) heads += self ? 3 : 1;
  }
  return (4 * levels.size() + heads) * square;
}

Size OfDecoder(const policy::PolicyConfig& config, const policy::ModuleConfig& module, int joints) {
  const policy::Quantity* quantity = policy::QuantityOf(module);
  if (quantity == nullptr) return 0;
  std::vector<int> widths{0};
  for (const std::string& input : module.decoder.inputs)
    widths[0] += policy::FeatureWidth(config, policy::ParseDecoderInput(input), joints);
  widths.insert(widths.end(), module.decoder.hidden.begin(), module.decoder.hidden.end());
  widths.push_back(quantity->width(policy::HeadOf(config, module)));
  return OfChain(widths);
}

Size Tokens(const policy::ImageConfig& image) {
  Size rows = static_cast<Size>(image.crop[3]), columns = static_cast<Size>(image.crop[2]);
  for (const auto& layer : image.layers) {
    if (layer.kind != "conv") continue;
    const auto stride = static_cast<Size>(layer.stride);
    rows = (rows + stride - 1) / stride;
    columns = (columns + stride - 1) / stride;
  }
  return rows * columns;
}

}  // namespace

std::uint64_t LeastParameters(const policy::PolicyConfig& config, int joints) {
  const auto& language = config.language;
  std::vector<int> joint_encoder{(config.joint_fourier ? 3 : 1) * joints};
  joint_encoder.insert(joint_encoder.end(), config.joint_hidden.begin(), config.joint_hidden.end());
  joint_encoder.push_back(config.width);
  Size sum = OfImage(config) + OfChain(joint_encoder) + OfAttention(config);
  if (language.clip_folder().empty())  // else a projection, of a width that only the folder tells
    sum += static_cast<Size>(language.rows()) * static_cast<Size>(language.width) +
           OfChain({language.width, language.hidden, config.width});
  for (const auto& module : config.modules)
    sum += OfDecoder(config, module, joints) + (module.own_image ? OfImage(config) : 0);
  return sum;
}

Status CheckSizes(const policy::PolicyConfig& config, int joints, std::uint64_t numbers) {
  if (joints < 0 || joints > kMaxJoints)
    return Fail(Code::kCorrupt, fmt::format("checkpoint: embodiment.joints {} is not in [0, {}]", joints, kMaxJoints));
  const auto& crop = config.image.crop;
  if (crop.size() != 4 || std::any_of(crop.begin(), crop.end(), [](int x) { return x < 0 || x > kMaxPicture; }) ||
      crop[0] + crop[2] > kMaxPicture || crop[1] + crop[3] > kMaxPicture)
    return Fail(Code::kCorrupt, fmt::format("checkpoint: image.crop [{}] lies in no picture (u0, v0, width, height, "
                                            "px)",
                                            fmt::join(crop, ", ")));
  if (Tokens(config.image) > kMaxTokens)
    return Fail(Code::kCorrupt,
                fmt::format("checkpoint: {} image tokens, more than {}", Tokens(config.image), kMaxTokens));
  const std::uint64_t least = LeastParameters(config, joints);
  if (least > numbers)
    return Fail(Code::kCorrupt, fmt::format("checkpoint: policy_config makes a network of {} numbers or more, the "
                                            "file holds {}",
                                            least, numbers));
  return {};
}

}  // namespace etude::checkpoint
