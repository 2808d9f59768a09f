// SPDX-License-Identifier: Apache-2.0
#include "services/bus/serialized.h"

#include <dds/ddsi/ddsi_serdata.h>

#include <algorithm>
#include <array>
#include <cstring>

namespace etude::bus {
namespace {

// Reads XCDR2 of a final struct on a machine of the sample's byte order.
class Cursor {
 public:
  explicit Cursor(std::span<const std::uint8_t> cdr) {
    // the header's second byte: 0x07 is "XCDR2, final, little-endian"
    ok_ = cdr.size() >= 4 && cdr[0] == 0 && cdr[1] == 0x07;
    if (ok_) bytes_ = cdr.subspan(4);
  }
  void Read(std::uint8_t& value) { ReadNumber(value); }
  void Read(std::uint32_t& value) { ReadNumber(value); }
  void Read(std::uint64_t& value) { ReadNumber(value); }
  void Read(std::string_view& text) {
    const auto raw = ReadRun();
    if (raw.empty() || raw.back() != 0) ok_ = false;
    if (!ok_) return;
    text = {reinterpret_cast<const char*>(raw.data()), raw.size() - 1};
  }
  void Read(std::span<const std::uint8_t>& bytes) { bytes = ReadRun(); }
  bool ok() const { return ok_; }

 private:
  template <class T>
  void ReadNumber(T& value) {
    constexpr std::size_t kAlign = std::min<std::size_t>(sizeof(T), 4);  // XCDR2 aligns to 4 at most
    at_ = (at_ + kAlign - 1) / kAlign * kAlign;
    if (!ok_ || at_ > bytes_.size() || bytes_.size() - at_ < sizeof(T)) {
      ok_ = false;
      return;
    }
    std::memcpy(&value, bytes_.data() + at_, sizeof(T));
    at_ += sizeof(T);
  }
  std::span<const std::uint8_t> ReadRun() {
    std::uint32_t length = 0;
    Read(length);
    if (!ok_ || bytes_.size() - at_ < length) {
      ok_ = false;
      return {};
    }
    const auto run = bytes_.subspan(at_, length);
    at_ += length;
    return run;
  }

  std::span<const std::uint8_t> bytes_;
  std::size_t at_ = 0;
  bool ok_ = false;
};

template <class... Fields>
bool ReadAll(std::span<const std::uint8_t> cdr, Fields&... fields) {
  Cursor cursor(cdr);
  (cursor.Read(fields), ...);
  return cursor.ok();
}

}  // namespace

// field orders as in proto/blob.idl

bool Parse(std::span<const std::uint8_t> cdr, ManifestView& v) {
  return ReadAll(cdr, v.id, v.size, v.token, v.chunk_size, v.chunk_count, v.channel, v.sender, v.owner, v.sha256,
                 v.meta_json, v.data, v.host);
}

bool Parse(std::span<const std::uint8_t> cdr, ChunkView& v) {
  return ReadAll(cdr, v.id, v.index, v.channel, v.sender, v.data);
}

bool Parse(std::span<const std::uint8_t> cdr, PublishedChunkView& v) {
  return ReadAll(cdr, v.version, v.size, v.chunk_size, v.index, v.slot, v.channel, v.publisher, v.data);
}

int TakeSerialized(const Endpoint& reader, int at_most,
                   const std::function<void(std::span<const std::uint8_t>)>& visit) {
  constexpr int kBatch = 64;
  std::array<ddsi_serdata*, kBatch> samples{};
  std::array<dds_sample_info_t, kBatch> infos;
  const int wanted = std::min(at_most, kBatch);
  const dds_return_t count =
      dds_takecdr(reader.get(), samples.data(), static_cast<std::uint32_t>(wanted), infos.data(), DDS_ANY_STATE);
  for (int i = 0; i < count; ++i) {
    ddsi_serdata* const sample = samples[static_cast<std::size_t>(i)];
    if (infos[static_cast<std::size_t>(i)].valid_data) {  // else an instance's end
      ddsrt_iovec_t bytes{};
      ddsi_serdata* const held = ddsi_serdata_to_ser_ref(sample, 0, ddsi_serdata_size(sample), &bytes);
      reader.traffic->Add(bytes.iov_len);
      visit({static_cast<const std::uint8_t*>(bytes.iov_base), bytes.iov_len});
      ddsi_serdata_to_ser_unref(held, &bytes);
    }
    ddsi_serdata_unref(sample);
  }
  return std::max(count, 0);
}

}  // namespace etude::bus
