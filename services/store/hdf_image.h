// SPDX-License-Identifier: Apache-2.0
// An HDF5 file's bytes without HDF5's library: no lock, no parser, one pass, and large data stays where it is. What it
// knows of the format is what an episode's file needs (HDF5 File Format Specification 3.0): superblock 2, object
// headers 2 with compact links and attributes, contiguous arrays, frames in chunks under a version 1 B-tree, texts in
// global heaps. The library, h5py and h5dump read it as a file of format 1.8; tests compare it with what HdfWriter
// makes of the same calls.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "services/codec/frames.h"
#include "services/core/result.h"

namespace etude::store::internal {

using Shape = std::vector<std::uint64_t>;

/// A file in two parts: what was made of it, and the streams of frames, which lie one after the other behind it and
/// belong to the caller.
struct HdfImageBytes {
  std::vector<std::uint8_t> head;
  std::vector<std::span<const std::uint8_t>> streams;
};

/// The calls of HdfWriter that an episode's file is made of; the same calls give the same bytes. Not thread-safe;
/// any number of them work at once.
class HdfImage {
 public:
  HdfImage();
  ~HdfImage();

  /// With its parents. A path is absolute; what an attribute is of must have been made before.
  void Group(const std::string& path);
  /// Variable-length UTF-8, up to its first NUL.
  void Attribute(const std::string& object, const char* name, std::string_view text);
  template <class T>
  void Attribute(const std::string& object, const char* name, T value) requires std::is_arithmetic_v<T> {
    AddAttribute(object, name, TypeOf<T>(), {}, BytesOf(&value, 1));
  }
  template <class T>
  void Attribute(const std::string& object, const char* name, const std::vector<T>& values, const Shape& shape) {
    AddAttribute(object, name, TypeOf<T>(), shape, BytesOf(values.data(), values.size()));
  }
  template <class T>
  void Array(const std::string& path, const std::vector<T>& values, const Shape& shape) {
    AddArray(path, TypeOf<T>(), shape, BytesOf(values.data(), values.size()));
  }
  /// (count, height, width, 3) uint8, each chunk a stream; the streams must outlive what Finish gives.
  void Frames(const std::string& path, const codec::FrameLayout& layout, std::size_t count,
              const std::vector<std::span<const std::uint8_t>>& streams);

  /// Call once, last. @error kInternal with the first call that did not fit
  Result<HdfImageBytes> Finish();

 private:
  using Bytes = std::vector<std::uint8_t>;
  struct Object;
  struct Text;

  template <class T>
  static Bytes TypeOf();
  template <class T>
  static std::span<const std::uint8_t> BytesOf(const T* values, std::size_t count) {
    return {reinterpret_cast<const std::uint8_t*>(values), count * sizeof(T)};
  }
  Object* Find(const std::string& path);
  Object* Make(const std::string& path);
  void AddAttribute(const std::string& object, const char* name, const Bytes& type, const Shape& shape,
                    std::span<const std::uint8_t> data);
  void AddArray(const std::string& path, const Bytes& type, const Shape& shape, std::span<const std::uint8_t> data);
  void Complain(std::string what);
  std::uint64_t PlaceHead();  ///< gives all but the streams their addresses; returns where it ends
  std::uint64_t PlaceTexts(std::uint64_t at);
  void WriteHeaps(Bytes& out) const;

  std::vector<std::unique_ptr<Object>> objects_;  // the root first, parents before their children
  std::map<std::string, Object*, std::less<>> by_path_;
  std::vector<Text> texts_;
  std::string failed_;
};

}  // namespace etude::store::internal
