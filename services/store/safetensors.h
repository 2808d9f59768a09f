// SPDX-License-Identifier: Apache-2.0
// safetensors files: u64 header size | JSON header | packed little-endian tensors. No code is ever
// run from a file. Source: the format's README (huggingface/safetensors).
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "services/core/config.h"
#include "services/core/file.h"
#include "services/core/result.h"

namespace etude::store {

constexpr std::uint64_t kMaxSafetensorsHeader = 100'000'000;  // bytes

enum class DType { kF32, kF16, kBF16, kF64, kI64, kI32, kU8, kBool };

std::size_t SizeOf(DType dtype);
std::string_view ToString(DType dtype);  ///< "F32", ...

struct Tensor {
  DType dtype = DType::kF32;
  std::vector<std::int64_t> shape;
  std::vector<std::uint8_t> data;  ///< row-major, little-endian
};

struct Safetensors {
  std::map<std::string, std::string> metadata;  ///< __metadata__
  std::map<std::string, Tensor> tensors;
};

/// The bytes are a pure function of the content: wide types first, then names in order, so that
/// every tensor is aligned to its type; header padded to 8. Sizes must fit shapes and dtypes
/// (checked).
std::vector<std::uint8_t> EncodeSafetensors(const Safetensors& content);

/// @error kCorrupt: header too long (kMaxSafetensorsHeader), not JSON, offsets out of range, overlapping or
/// with holes, duplicate names, sizes that do not fit shape and dtype. Nothing is allocated before
/// it is checked.
/// @param wanted  tensors for whose names it is false are checked and left out; none: all are there
Result<Safetensors> DecodeSafetensors(std::span<const std::uint8_t> bytes,
                                      const std::function<bool(std::string_view)>& wanted = {});

/// The JSON header alone, for who looks at a large file; what it says of tensors is not checked.
/// @param most  bytes that it may have  @error kCorrupt: longer, cut, not a JSON map
Result<OrderedJson> ReadSafetensorsHeader(int fd, const Path& path, std::uint64_t most = kMaxSafetensorsHeader);

Status WriteSafetensors(const Path& path, const Safetensors& content);
Result<Safetensors> ReadSafetensors(const Path& path);

}  // namespace etude::store
