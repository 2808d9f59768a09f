// SPDX-License-Identifier: Apache-2.0
// Writing with HDF5's library: the master file, a dataset as one file, and what tests compare hdf_image.h with. No file
// that came from elsewhere is read with it: it trusts what no checksum of the format covers (hdf_view.h). The library
// is not thread-safe: each writer holds the process's one HDF5 mutex as long as it lives, so keep them short-lived. A
// writer is sticky: after the first failure later calls do nothing, and Finish() tells what failed.
#pragma once

#include <hdf5.h>

#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "services/codec/frames.h"
#include "services/core/file.h"
#include "services/core/result.h"
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
  /// (count, height, width, 3) uint8 with the deflate filter; the zlib streams become the chunks as they are.
  void Frames(const std::string& path, const codec::FrameLayout& layout, std::size_t count,
              const std::vector<std::span<const std::uint8_t>>& streams);
  /// (n,) byte strings of one length, padded with NUL.
  void FixedStrings(const std::string& path, const std::vector<std::string>& texts);
  void ExternalLink(const std::string& path, const std::string& file, const std::string& object);
  /// `path` of another file, whose bytes these are, with all below it: compressed chunks as they are. Bytes that this
  /// process made, never those of a file: the library would follow what stands in them.
  void CopyFrom(std::span<const std::uint8_t> bytes, const std::string& path);

  /// The file's bytes, none of a file on disk; call once, last. @error with the first call that failed: the code
  /// of ErrnoError where the system's answer is the cause, else kInternal.
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
  std::string failed_;                 // the first call that failed, "" while all is well
  Code code_ = Code::kInternal;
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
