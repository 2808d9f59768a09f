// SPDX-License-Identifier: Apache-2.0
// Numeric arrays as safetensors answers.
#pragma once

#include <cstring>
#include <string>
#include <vector>

#include "dashboard/server/http/answers.h"
#include "services/store/safetensors.h"

namespace etude::api {

template <class T>
store::Tensor TensorOf(store::DType dtype, const std::vector<T>& values, std::vector<std::int64_t> shape) {
  store::Tensor tensor{dtype, std::move(shape), std::vector<std::uint8_t>(values.size() * sizeof(T))};
  if (!values.empty()) std::memcpy(tensor.data.data(), values.data(), tensor.data.size());  // little-endian, as we are
  return tensor;
}
template <class T>
store::Tensor TensorOf(store::DType dtype, const std::vector<T>& values) {
  return TensorOf(dtype, values, {static_cast<std::int64_t>(values.size())});
}

inline http::Answer ArraysAnswer(const store::Safetensors& content) {
  const auto bytes = store::EncodeSafetensors(content);
  return http::BytesAnswer(std::string(bytes.begin(), bytes.end()), "application/vnd.safetensors");
}

}  // namespace etude::api
