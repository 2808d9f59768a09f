// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/sizes.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

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

Size OfImage(const policy::ImageConfig& image) {
  Size sum = 0, channels = 3;
  for (const auto& layer : image.layers) {
    const auto next = static_cast<Size>(layer.channels);
    const auto kernel = static_cast<Size>(layer.kernel);
    sum += layer.kind == "residual" ? 18 * next * next : channels * next * kernel * kernel;
    channels = next;
  }
  return sum;
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

std::uint64_t LeastParameters(const policy::PolicyConfig& config) {
  const auto& language = config.language;
  const auto width = static_cast<Size>(config.width);
  Size sum = OfImage(config.image) + OfChain(config.joint_hidden) + width * width;
  if (language.clip_folder().empty())  // else a projection, of a width that only the folder tells
    sum += static_cast<Size>(language.buckets) * static_cast<Size>(language.width) +
           OfChain({language.width, language.hidden, config.width});
  for (const auto& module : config.modules) {
    if (config.attention == "module") sum += 4 * width * width;
    sum += OfChain(module.decoder.hidden);
  }
  return sum;
}

Status CheckSizes(const policy::PolicyConfig& config, std::uint64_t numbers) {
  const auto& crop = config.image.crop;
  if (crop.size() != 4 || std::any_of(crop.begin(), crop.end(), [](int x) { return x < 0 || x > kMaxPicture; }) ||
      crop[0] + crop[2] > kMaxPicture || crop[1] + crop[3] > kMaxPicture)
    return Fail(Code::kCorrupt, fmt::format("checkpoint: image.crop [{}] lies in no picture (u0, v0, width, height, "
                                            "px)",
                                            fmt::join(crop, ", ")));
  if (Tokens(config.image) > kMaxTokens)
    return Fail(Code::kCorrupt,
                fmt::format("checkpoint: {} image tokens, more than {}", Tokens(config.image), kMaxTokens));
  const std::uint64_t least = LeastParameters(config);
  if (least > numbers)
    return Fail(Code::kCorrupt, fmt::format("checkpoint: policy_config makes a network of {} numbers or more, the "
                                            "file holds {}",
                                            least, numbers));
  return {};
}

}  // namespace etude::checkpoint
