// SPDX-License-Identifier: Apache-2.0
// HDF5 in memory, as far as this folder needs it. The C library is not thread-safe: each object
// here holds the process's one HDF5 mutex as long as it lives, so keep them short-lived. Both
// classes are sticky: after the first failure later calls do nothing, and Finish() tells what
// failed.
#pragma once

#include <hdf5.h>

#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "services/core/file.h"
#include "services/core/result.h"
#include "services/store/dataset.h"
#include "services/store/hdf_image.h"

namespace etude::store::internal {

/// An owned HDF5 identifier of any kind.
class Hid {
 public:
  Hid() = default;
  explicit Hid(hid_t id) : id_(id) {}
  Hid(Hid&& other) noexcept : id_(std::exchange(other.id_, -1)) {}
  Hid& operator=(Hid&& other) noexcept {
    std::swap(id_, other.id_);
    return *this;
  }
  ~Hid() {
    if (id_ >= 0) H5Idec_ref(id_);
  }
  hid_t get() const { return id_; }
  explicit operator bool() const { return id_ >= 0; }

 private:
  hid_t id_ = -1;
};

/// The mutex, and no messages of HDF5 on stderr.
class HdfLock {
 public:
  HdfLock();
  void Release() { lock_.unlock(); }

 private:
  std::unique_lock<std::mutex> lock_;
};

/// A file's memory while HDF5 has it, and its bytes once HDF5 has closed it.
struct FileImage {
  std::size_t size = 0;
  std::vector<std::uint8_t> bytes;
};

/// Native type of T's values in memory, little-endian type of the same width in the file.
template <class T>
struct HdfType;

/// Builds an HDF5 file in memory, or adds to one on disk. The same calls give the same bytes: no time stamps, fixed
/// format version. Paths are absolute ("/data/demo_1/actions"); missing groups are made.
class HdfWriter {
 public:
  HdfWriter();
  /// Of a file on disk, which need not fit into memory: made, empty, or opened to add to it.
  enum class OnDisk { kNew, kAdd };
  HdfWriter(const Path& file, OnDisk how);

  void Group(const std::string& path);
  /// Variable-length UTF-8.
  void Attribute(const std::string& object, const char* name, std::string_view text);
  template <class T>
  void Attribute(const std::string& object, const char* name, T value) requires std::is_arithmetic_v<T> {
    WriteAttribute(object, name, {}, HdfType<T>::native(), HdfType<T>::file(), &value);
  }
  template <class T>
  void Attribute(const std::string& object, const char* name, const std::vector<T>& values, const Shape& shape) {
    WriteAttribute(object, name, shape, HdfType<T>::native(), HdfType<T>::file(), values.data());
  }
  template <class T>
  void Array(const std::string& path, const std::vector<T>& values, const Shape& shape) {
    WriteArray(path, shape, HdfType<T>::native(), HdfType<T>::file(), values.data(), values.size());
  }
  /// (frames, height, width, 3) uint8, one frame a chunk with the deflate filter; the zlib streams
  /// become the chunks as they are.
  void Frames(const std::string& path, int height, int width,
              const std::vector<std::span<const std::uint8_t>>& streams);
  /// (n,) byte strings of one length, padded with NUL.
  void FixedStrings(const std::string& path, const std::vector<std::string>& texts);
  void ExternalLink(const std::string& path, const std::string& file, const std::string& object);
  /// `path` of another file, whose bytes these are, with all below it: compressed chunks as they are.
  void CopyFrom(std::span<const std::uint8_t> bytes, const std::string& path);

  /// The file's bytes, none of a file on disk; call once, last. @error kInternal with the first call that failed.
  Result<std::vector<std::uint8_t>> Finish();

 private:
  void WriteAttribute(const std::string& object, const char* name, const Shape& shape, hid_t native, hid_t file,
                      const void* data);
  void WriteArray(const std::string& path, const Shape& shape, hid_t native, hid_t file, const void* data,
                  std::size_t count);
  // remembers a failed call; returns whether all is well
  bool Check(bool good, const std::string& what);
  bool MakePropertyLists();

  HdfLock lock_;
  std::unique_ptr<FileImage> image_;   // null: on disk
  Hid file_, link_, group_, dataset_;  // the file; creation property lists
  std::string failed_;
};

/// Reads an HDF5 file from memory. Sizes are checked against the file's before anything is
/// allocated.
class HdfReader {
 public:
  explicit HdfReader(std::span<const std::uint8_t> bytes);

  std::string Text(const std::string& object, const char* name);
  template <class T>
  T Scalar(const std::string& object, const char* name) {
    T value{};
    ReadAttribute(object, name, HdfType<T>::native(), 1, &value);
    return value;
  }
  template <class T>
  std::vector<T> Vector(const std::string& object, const char* name, std::size_t size) {
    std::vector<T> values(size);
    ReadAttribute(object, name, HdfType<T>::native(), size, values.data());
    return values;
  }
  /// Of the given rank; `shape` gets the extents.
  template <class T>
  std::vector<T> Array(const std::string& path, std::size_t rank, Shape& shape) {
    Hid dataset = OpenArray(path, rank, sizeof(T), shape);
    std::uint64_t count = failed_.empty() ? 1 : 0;
    if (count)
      for (const auto extent : shape) count *= extent;
    std::vector<T> values(count);
    if (count) ReadArray(dataset, path, HdfType<T>::native(), values.data());
    return values;
  }
  /// Where the chunks of a picture array lie; `shape` gets its four extents.
  std::vector<FrameLocation> FrameLocations(const std::string& path, Shape& shape);
  /// Names in a group, in alphabetical order.
  std::vector<std::string> Children(const std::string& group);

  /// Closes the file; call once, last. @error kCorrupt with the first call that failed.
  Status Finish();

 private:
  Hid OpenArray(const std::string& path, std::size_t rank, std::size_t width, Shape& shape);
  void ReadArray(const Hid& dataset, const std::string& path, hid_t native, void* data);
  void ReadAttribute(const std::string& object, const char* name, hid_t native, std::size_t count, void* data);
  bool Check(bool good, const std::string& what);

  HdfLock lock_;
  std::size_t size_;
  Hid file_;
  std::string failed_;
};

#define ETUDE_HDF_TYPE(type, native_id, file_id) \
  template <>                                    \
  struct HdfType<type> {                         \
    static hid_t native() { return native_id; }  \
    static hid_t file() { return file_id; }      \
  };
ETUDE_HDF_TYPE(float, H5T_NATIVE_FLOAT, H5T_IEEE_F32LE)
ETUDE_HDF_TYPE(double, H5T_NATIVE_DOUBLE, H5T_IEEE_F64LE)
ETUDE_HDF_TYPE(std::uint8_t, H5T_NATIVE_UINT8, H5T_STD_U8LE)
ETUDE_HDF_TYPE(std::int64_t, H5T_NATIVE_INT64, H5T_STD_I64LE)
ETUDE_HDF_TYPE(std::uint64_t, H5T_NATIVE_UINT64, H5T_STD_U64LE)
#undef ETUDE_HDF_TYPE

}  // namespace etude::store::internal
