// SPDX-License-Identifier: Apache-2.0
// An episode's HDF5 file, read without HDF5's library. The library trusts what lies in global heaps and in B-trees,
// which no checksum of the format covers: in 1.10.8 the size of a text in its heap, or a node that is its own child,
// ends the process or never ends. Here every number is held against the bytes that are left. No lock, either: any
// number of files are read at once. What it knows of the format is what HdfImage writes, and what the library made of
// the same calls before it (HDF5 File Format Specification 3.0): links and attributes in object headers, which may be
// continued, contiguous arrays, chunks under a version 1 B-tree, texts in global heaps. Anything else is not found, or
// refused.
#pragma once

#include <cstdint>
#include <cstring>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include "services/core/result.h"
#include "services/store/dataset.h"
#include "services/store/hdf_image.h"

namespace etude::store::internal {

/// Sticky: after the first failure later calls give nothing, and Finish() tells what failed. Not thread-safe.
class HdfView {
 public:
  using Bytes = std::span<const std::uint8_t>;

  /// `bytes` must outlive it.
  explicit HdfView(Bytes bytes);

  /// One text of variable length, up to its first NUL.
  std::string Text(const std::string& object, const char* name);
  template <class T>
  T Scalar(const std::string& object, const char* name) {
    return Vector<T>(object, name, 1)[0];
  }
  template <class T>
  std::vector<T> Vector(const std::string& object, const char* name, std::size_t size) {
    std::vector<T> values(size);
    const Bytes data = Numbers(object, name, TypeOf<T>(), size);
    if (!data.empty()) std::memcpy(values.data(), data.data(), data.size());
    return values;
  }
  /// Of the given rank; `shape` gets the extents, zeros on failure.
  template <class T>
  std::vector<T> Array(const std::string& path, std::size_t rank, Shape& shape) {
    const Bytes data = Values(path, TypeOf<T>(), rank, shape);
    std::vector<T> values(data.size() / sizeof(T));
    if (!data.empty()) std::memcpy(values.data(), data.data(), data.size());
    return values;
  }
  /// Where the chunks of an array of frames (count, height, width, 3) lie; none on failure.
  StoredFrames Frames(const std::string& path);
  /// Names in a group, in alphabetical order.
  std::vector<std::string> Children(const std::string& group);

  /// @error kCorrupt with the first call that failed
  Status Finish() const;

 private:
  struct Attribute {
    Bytes type, space, data;
  };
  struct Header {
    std::map<std::string, std::uint64_t> links;  // name -> address of a header
    std::map<std::string, Attribute> attributes;
    Bytes type, space, layout;  // of an array
  };
  struct Type {
    bool is_float, is_signed;
    std::uint32_t size;
  };
  template <class T>
  static constexpr Type TypeOf() {
    return {std::is_floating_point_v<T>, std::is_integral_v<T> && std::is_signed_v<T>, sizeof(T)};
  }
  static bool Is(Bytes type, const Type& wanted);

  bool Complain(const std::string& what);  // false
  Bytes From(std::uint64_t address) const;
  Bytes At(std::uint64_t address, std::uint64_t size) const;
  const Header* Open(const std::string& path);
  const Header* HeaderAt(std::uint64_t address);
  bool ReadHeader(std::uint64_t address, Header& header) const;
  bool Continue(Bytes message, std::vector<Bytes>& blocks) const;
  const Attribute* Find(const std::string& object, const char* name);
  Bytes Numbers(const std::string& object, const char* name, const Type& type, std::size_t count);
  Bytes Values(const std::string& path, const Type& type, std::size_t rank, Shape& shape);
  std::optional<Bytes> HeapObject(std::uint64_t address, std::uint64_t index) const;
  bool ReadTree(std::uint64_t root, StoredFrames& frames) const;

  Bytes bytes_;
  std::uint64_t root_ = 0;
  std::map<std::uint64_t, Header> headers_;  // those that were read, by address
  std::string failed_;
};

}  // namespace etude::store::internal
