// SPDX-License-Identifier: Apache-2.0
#include "services/store/hdf.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <utility>

#include "services/core/file.h"

namespace etude::store::internal {
namespace {

std::mutex hdf_mutex;

constexpr std::size_t kGrowth = 1 << 20;  // bytes by which a file in memory grows

// What HDF5 says went wrong, innermost: there the cause stands. "" when it says nothing.
std::string HdfMessage() {
  std::string text;
  const auto collect = [](unsigned depth, const H5E_error2_t* error, void* out) -> herr_t {
    if (depth == 0 && error->desc != nullptr) *static_cast<std::string*>(out) = error->desc;
    return 0;
  };
  H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, collect, &text);
  H5Eclear2(H5E_DEFAULT);
  return text.empty() ? "" : fmt::format(" (HDF5: {})", text);
}

// A full disk is no bug: HDF5 tells a failed system call in words alone ("errno = 28, error message = ...").
Code CodeOf(const std::string& message) {
  static constexpr std::string_view kErrno = "errno = ";
  const std::size_t at = message.find(kErrno);
  if (at == std::string::npos) return Code::kInternal;
  return ErrnoError("", {}, std::atoi(message.c_str() + at + kErrno.size())).code;
}

// file access in memory only, format of HDF5 1.8 so that every reader of today opens it
Hid MemoryAccess() {
  Hid access(H5Pcreate(H5P_FILE_ACCESS));
  if (access.get() < 0 || H5Pset_fapl_core(access.get(), kGrowth, false) < 0 ||
      H5Pset_libver_bounds(access.get(), H5F_LIBVER_V18, H5F_LIBVER_V18) < 0)
    return {};
  return access;
}

// HDF5's callbacks around the memory of a file, so that its last state outlives H5Fclose.
// (H5Fget_file_image of an open file clears flags in the superblock without correcting its
// checksum.)
void* AllocateImage(std::size_t size, H5FD_file_image_op_t, void*) { return std::calloc(1, size); }

void* CopyImage(void* to, const void* from, std::size_t size, H5FD_file_image_op_t, void*) {
  return std::memcpy(to, from, size);
}

void* ResizeImage(void* image, std::size_t size, H5FD_file_image_op_t, void* context) {
  auto& sink = *static_cast<FileImage*>(context);
  auto* resized = static_cast<std::uint8_t*>(std::realloc(image, size));
  if (resized == nullptr) return nullptr;
  if (size > sink.size) std::memset(resized + sink.size, 0, size - sink.size);
  sink.size = size;
  return resized;
}

herr_t FreeImage(void* image, H5FD_file_image_op_t operation, void* context) {
  auto& sink = *static_cast<FileImage*>(context);
  const auto* bytes = static_cast<const std::uint8_t*>(image);
  if (operation == H5FD_FILE_IMAGE_OP_FILE_CLOSE) sink.bytes.assign(bytes, bytes + sink.size);
  std::free(image);
  return 0;
}

bool KeepImage(hid_t access, FileImage* sink) {
  H5FD_file_image_callbacks_t callbacks{};
  callbacks.image_malloc = AllocateImage;
  callbacks.image_memcpy = CopyImage;
  callbacks.image_realloc = ResizeImage;
  callbacks.image_free = FreeImage;
  callbacks.udata_copy = [](void* context) { return context; };
  callbacks.udata_free = [](void*) -> herr_t { return 0; };
  callbacks.udata = sink;
  return H5Pset_file_image_callbacks(access, &callbacks) >= 0;
}

Hid TextType() {
  Hid type(H5Tcopy(H5T_C_S1));
  if (type) {
    H5Tset_size(type.get(), H5T_VARIABLE);
    H5Tset_cset(type.get(), H5T_CSET_UTF8);
  }
  return type;
}

Hid Space(const Shape& shape) {
  if (shape.empty()) return Hid(H5Screate(H5S_SCALAR));
  const std::vector<hsize_t> extents(shape.begin(), shape.end());
  return Hid(H5Screate_simple(static_cast<int>(extents.size()), extents.data(), nullptr));
}

}  // namespace

HdfLock::HdfLock() : lock_(hdf_mutex) { H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr); }

HdfWriter::HdfWriter()
    : image_(std::make_unique<FileImage>()),
      link_(H5Pcreate(H5P_LINK_CREATE)),
      group_(H5Pcreate(H5P_GROUP_CREATE)),
      dataset_(H5Pcreate(H5P_DATASET_CREATE)) {
  const Hid creation(H5Pcreate(H5P_FILE_CREATE));
  const Hid access = MemoryAccess();
  const bool good = creation && access && KeepImage(access.get(), image_.get()) &&
                    H5Pset_obj_track_times(creation.get(), false) >= 0 && MakePropertyLists();
  if (Check(good, "set up")) {
    file_ = Hid(H5Fcreate("new.hdf5", H5F_ACC_TRUNC, creation.get(), access.get()));
    Check(bool(file_), "create a file in memory");
  }
}

HdfWriter::HdfWriter(const Path& file, OnDisk how)
    : link_(H5Pcreate(H5P_LINK_CREATE)), group_(H5Pcreate(H5P_GROUP_CREATE)), dataset_(H5Pcreate(H5P_DATASET_CREATE)) {
  const Hid creation(H5Pcreate(H5P_FILE_CREATE));
  const Hid access(H5Pcreate(H5P_FILE_ACCESS));
  const bool good = creation && access && H5Pset_libver_bounds(access.get(), H5F_LIBVER_V18, H5F_LIBVER_V18) >= 0 &&
                    H5Pset_obj_track_times(creation.get(), false) >= 0 && MakePropertyLists();
  if (!Check(good, "set up")) return;
  file_ = Hid(how == OnDisk::kNew ? H5Fcreate(file.c_str(), H5F_ACC_TRUNC, creation.get(), access.get())
                                  : H5Fopen(file.c_str(), H5F_ACC_RDWR, access.get()));
  Check(bool(file_), "open '" + file.string() + "'");
}

// no time of day in the file; attributes and few links stay in the object's own header
bool HdfWriter::MakePropertyLists() {
  return link_ && group_ && dataset_ && H5Pset_obj_track_times(group_.get(), false) >= 0 &&
         H5Pset_obj_track_times(dataset_.get(), false) >= 0 && H5Pset_attr_phase_change(group_.get(), 128, 64) >= 0 &&
         H5Pset_link_phase_change(group_.get(), 64, 32) >= 0 && H5Pset_create_intermediate_group(link_.get(), 1) >= 0;
}

bool HdfWriter::Check(bool good, const std::string& what) {
  if (!good && failed_.empty()) {
    const std::string message = HdfMessage();
    failed_ = what + message;
    code_ = CodeOf(message);
  }
  return failed_.empty();
}

void HdfWriter::Group(const std::string& path) {
  if (!failed_.empty()) return;
  // parents first: those that HDF5 makes on the way would not have our properties
  for (std::size_t slash = path.find('/', 1);; slash = path.find('/', slash + 1)) {
    const std::string part = path.substr(0, slash);
    if (H5Lexists(file_.get(), part.c_str(), H5P_DEFAULT) <= 0) {
      const Hid made(H5Gcreate2(file_.get(), part.c_str(), link_.get(), group_.get(), H5P_DEFAULT));
      if (!Check(bool(made), "create group " + part)) return;
    }
    if (slash == std::string::npos) return;
  }
}

void HdfWriter::Attribute(const std::string& object, const char* name, std::string_view text) {
  if (!failed_.empty()) return;
  const Hid type = TextType();
  const std::string terminated(text);
  const char* value = terminated.c_str();
  WriteAttribute(object, name, {}, type.get(), type.get(), &value);
}

void HdfWriter::WriteAttribute(const std::string& object, const char* name, const Shape& shape, hid_t native,
                               hid_t file, const void* data) {
  if (!failed_.empty()) return;
  const Hid space = Space(shape);
  const Hid attribute(
      H5Acreate_by_name(file_.get(), object.c_str(), name, file, space.get(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
  Check(attribute && H5Awrite(attribute.get(), native, data) >= 0,
        fmt::format("write attribute {} of {}", name, object));
}

void HdfWriter::WriteArray(const std::string& path, const Shape& shape, hid_t native, hid_t file, const void* data,
                           std::size_t count) {
  if (!failed_.empty()) return;
  std::uint64_t expected = 1;
  for (const auto extent : shape) expected *= extent;
  const std::string what = "write array " + path;
  if (!Check(expected == count, what + ": its size does not fit its shape")) return;
  Group(path.substr(0, path.rfind('/')));
  const Hid space = Space(shape);
  const Hid array(H5Dcreate2(file_.get(), path.c_str(), file, space.get(), link_.get(), dataset_.get(), H5P_DEFAULT));
  if (!Check(bool(array), what) || count == 0) return;
  Check(H5Dwrite(array.get(), native, H5S_ALL, H5S_ALL, H5P_DEFAULT, data) >= 0, what);
}

void HdfWriter::Frames(const std::string& path, const codec::FrameLayout& layout, std::size_t count,
                       const std::vector<std::span<const std::uint8_t>>& streams) {
  if (!failed_.empty()) return;
  if (!Check(layout.IsGood() && streams.size() == layout.streams(count), "frames " + path + ": not as many streams"))
    return;
  Group(path.substr(0, path.rfind('/')));
  const auto extent = [](int n) { return static_cast<hsize_t>(n); };
  const Hid space = Space({count, extent(layout.height), extent(layout.width), 3});
  const hsize_t chunk[4] = {extent(layout.chunk.frames), extent(layout.rows()), extent(layout.width), 3};
  const Hid creation(H5Pcopy(dataset_.get()));
  const bool ready = creation && H5Pset_chunk(creation.get(), 4, chunk) >= 0 &&
                     H5Pset_fill_time(creation.get(), H5D_FILL_TIME_NEVER) >= 0 &&
                     H5Pset_deflate(creation.get(), 1) >= 0;
  if (!Check(ready, "lay out frames " + path)) return;
  const Hid array(
      H5Dcreate2(file_.get(), path.c_str(), H5T_STD_U8LE, space.get(), link_.get(), creation.get(), H5P_DEFAULT));
  if (!Check(bool(array), "create frames " + path)) return;
  const auto bands = static_cast<std::size_t>(layout.bands());
  for (std::size_t i = 0; i < streams.size() && failed_.empty(); ++i) {
    const hsize_t at[4] = {i / bands * chunk[0], i % bands * chunk[1], 0, 0};
    Check(H5Dwrite_chunk(array.get(), H5P_DEFAULT, 0, at, streams[i].size(), streams[i].data()) >= 0,
          fmt::format("write stream {} of {}", i, path));
  }
}

void HdfWriter::FixedStrings(const std::string& path, const std::vector<std::string>& texts) {
  if (!failed_.empty()) return;
  std::size_t length = 1;
  for (const auto& text : texts) length = std::max(length, text.size());
  std::string packed(texts.size() * length, '\0');
  for (std::size_t i = 0; i < texts.size(); ++i)
    std::copy(texts[i].begin(), texts[i].end(), packed.begin() + static_cast<std::ptrdiff_t>(i * length));
  const Hid type(H5Tcopy(H5T_C_S1));
  if (!Check(type && H5Tset_size(type.get(), length) >= 0 && H5Tset_strpad(type.get(), H5T_STR_NULLPAD) >= 0,
             "make a string type"))
    return;
  WriteArray(path, {texts.size()}, type.get(), type.get(), packed.data(), texts.size());
}

void HdfWriter::ExternalLink(const std::string& path, const std::string& file, const std::string& object) {
  if (!failed_.empty()) return;
  Check(H5Lcreate_external(file.c_str(), object.c_str(), file_.get(), path.c_str(), link_.get(), H5P_DEFAULT) >= 0,
        "link " + path);
}

void HdfWriter::CopyFrom(std::span<const std::uint8_t> bytes, const std::string& path) {
  if (!failed_.empty()) return;
  const Hid access = MemoryAccess();
  const bool ready =
      access && H5Pset_file_image(access.get(), const_cast<std::uint8_t*>(bytes.data()), bytes.size()) >= 0;
  if (!Check(ready, "read bytes")) return;
  const Hid source(H5Fopen("source.hdf5", H5F_ACC_RDONLY, access.get()));
  if (!Check(bool(source), "open bytes")) return;
  Group(path.substr(0, path.rfind('/')));
  Check(H5Ocopy(source.get(), path.c_str(), file_.get(), path.c_str(), H5P_DEFAULT, link_.get()) >= 0, "copy " + path);
}

Result<std::vector<std::uint8_t>> HdfWriter::Finish() {
  if (failed_.empty()) Check(H5Fflush(file_.get(), H5F_SCOPE_LOCAL) >= 0, "flush");
  for (Hid* id : {&file_, &link_, &group_, &dataset_}) *id = Hid();
  lock_.Release();
  if (!image_) {
    if (!failed_.empty()) return Fail(code_, "write an HDF5 file: " + failed_);
    return std::vector<std::uint8_t>{};
  }

  // memory grows in steps; where the file ends stands in its superblock (version 2, file format
  // III.A)
  constexpr std::size_t kVersionAt = 8, kEndAt = 28, kSuperblockSize = 48;
  auto& bytes = image_->bytes;
  std::uint64_t end = 0;
  const bool whole = bytes.size() >= kSuperblockSize && bytes[kVersionAt] == 2;
  if (whole) std::memcpy(&end, &bytes[kEndAt], sizeof(end));
  if (failed_.empty() && (!whole || end > bytes.size())) failed_ = "close";
  if (!failed_.empty()) return Fail(Code::kInternal, "make an HDF5 file: " + failed_);
  bytes.resize(end);
  return std::move(bytes);
}

}  // namespace etude::store::internal
