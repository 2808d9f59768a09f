// SPDX-License-Identifier: Apache-2.0
// Section numbers are those of the HDF5 File Format Specification 3.0.
#include "services/store/hdf_image.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <limits>
#include <type_traits>

namespace etude::store::internal {
namespace {

static_assert(std::endian::native == std::endian::little, "values are copied as they lie in memory");

using Bytes = std::vector<std::uint8_t>;

constexpr std::uint64_t kUndefined = UINT64_MAX;  // an address
constexpr std::size_t kSuperblockSize = 48;
constexpr std::size_t kHeapHead = 16;      // of a collection, and of each object in it
constexpr std::size_t kHeapLeast = 4096;   // bytes of a collection, as the library has it
constexpr std::size_t kHeapMost = 60'000;  // beyond, the next text begins another collection
constexpr std::size_t kTreeSlots = 64;     // entries of a node: twice the library's default K of 32
constexpr std::size_t kMostMessage = 65'535;

enum Message : std::uint8_t {
  kDataspace = 0x01,
  kLinkInfo = 0x02,
  kDatatype = 0x03,
  kFillValue = 0x05,
  kLink = 0x06,
  kLayout = 0x08,
  kGroupInfo = 0x0A,
  kFilters = 0x0B,
  kAttribute = 0x0C,
  kAttributeInfo = 0x15,
};
constexpr std::uint8_t kConstant = 1, kUnshared = 4;  // message flags

template <class T>
void Put(Bytes& out, T value) requires std::is_arithmetic_v<T> {
  const auto at = out.size();
  out.resize(at + sizeof(T));
  std::memcpy(out.data() + at, &value, sizeof(T));
}

void Put(Bytes& out, std::span<const std::uint8_t> bytes) { out.insert(out.end(), bytes.begin(), bytes.end()); }

void Put(Bytes& out, std::string_view text) { out.insert(out.end(), text.begin(), text.end()); }

void PadTo(Bytes& out, std::uint64_t size) { out.resize(std::max<std::size_t>(out.size(), size), 0); }

std::uint64_t Align8(std::uint64_t size) { return (size + 7) / 8 * 8; }

// lookup3 of Bob Jenkins, which HDF5 has for the checksums of its metadata.
std::uint32_t Checksum(std::span<const std::uint8_t> bytes) {
  std::uint32_t a = 0xdeadbeef + static_cast<std::uint32_t>(bytes.size()), b = a, c = a;
  const auto add = [&](std::span<const std::uint8_t> block) {
    std::uint32_t words[3] = {0, 0, 0};
    std::memcpy(words, block.data(), block.size());
    a += words[0];
    b += words[1];
    c += words[2];
  };
  while (bytes.size() > 12) {
    add(bytes.first(12));
    a = (a - c) ^ std::rotl(c, 4), c += b;
    b = (b - a) ^ std::rotl(a, 6), a += c;
    c = (c - b) ^ std::rotl(b, 8), b += a;
    a = (a - c) ^ std::rotl(c, 16), c += b;
    b = (b - a) ^ std::rotl(a, 19), a += c;
    c = (c - b) ^ std::rotl(b, 4), b += a;
    bytes = bytes.subspan(12);
  }
  if (bytes.empty()) return c;
  add(bytes);
  c = (c ^ b) - std::rotl(b, 14);
  a = (a ^ c) - std::rotl(c, 11);
  b = (b ^ a) - std::rotl(a, 25);
  c = (c ^ b) - std::rotl(b, 16);
  a = (a ^ c) - std::rotl(c, 4);
  b = (b ^ a) - std::rotl(a, 14);
  return (c ^ b) - std::rotl(b, 24);
}

void PutChecksumFrom(Bytes& out, std::size_t begin) { Put(out, Checksum(std::span(out).subspan(begin))); }

// IV.A.2.d, version 1; the first byte has version and class.
Bytes IntegerType(std::uint32_t size, bool is_signed) {
  Bytes type{0x10, static_cast<std::uint8_t>(is_signed ? 0x08 : 0x00), 0, 0};
  Put(type, size);
  Put(type, std::uint16_t{0});
  Put(type, static_cast<std::uint16_t>(8 * size));
  return type;
}

struct FloatLayout {
  std::uint8_t sign, exponent_at, exponent_bits, mantissa_bits;
  std::uint32_t bias;
};

Bytes FloatType(std::uint32_t size, const FloatLayout& layout) {
  Bytes type{0x11, 0x20, layout.sign, 0};
  Put(type, size);
  Put(type, std::uint16_t{0});
  Put(type, static_cast<std::uint16_t>(8 * size));
  Put(type, std::span<const std::uint8_t>(Bytes{layout.exponent_at, layout.exponent_bits, 0, layout.mantissa_bits}));
  Put(type, layout.bias);
  return type;
}

// A string of variable length, UTF-8, ended by NUL: of bytes.
Bytes TextType() {
  Bytes type{0x19, 0x01, 0x01, 0};
  Put(type, std::uint32_t{16});
  Put(type, IntegerType(1, false));
  return type;
}

// IV.A.2.b, version 2; what does not grow has its extents as the largest ones, too.
Bytes Dataspace(const Shape& shape) {
  const bool scalar = shape.empty();
  Bytes space{2, static_cast<std::uint8_t>(shape.size()), static_cast<std::uint8_t>(scalar ? 0 : 1),
              static_cast<std::uint8_t>(scalar ? 0 : 1)};
  for (int twice = 0; twice < 2; ++twice)
    for (const std::uint64_t extent : shape) Put(space, extent);
  return space;
}

void PutMessage(Bytes& out, Message type, std::uint8_t flags, std::span<const std::uint8_t> body) {
  out.push_back(type);
  Put(out, static_cast<std::uint16_t>(body.size()));
  out.push_back(flags);
  Put(out, body);
}

// Link info and attribute info (IV.A.2.c, IV.A.2.v) begin alike: nothing lies outside of the object's header.
Bytes CompactInfo() {
  Bytes info{0, 0};
  Put(info, kUndefined);
  Put(info, kUndefined);
  return info;
}

struct Attr {
  std::string name;
  Bytes type;
  Shape shape;
  Bytes data;
  std::size_t text = SIZE_MAX;  // whose place is not known yet
};

std::string_view ParentOf(std::string_view path) { return path.substr(0, path.rfind('/')); }
std::string_view NameOf(std::string_view path) { return path.substr(path.rfind('/') + 1); }

}  // namespace

struct HdfImage::Text {
  std::string text;
  std::uint64_t collection = 0;  // where its collection begins
  std::uint32_t index = 0;       // in it
  bool first = false;            // of its collection
  std::uint64_t collection_size = 0;
};

struct HdfImage::Object {
  explicit Object(bool is_group) : group(is_group) {}

  bool group;
  std::vector<Attr> attributes;
  std::vector<std::pair<std::string, const Object*>> links;
  Bytes type;
  Shape shape;
  Bytes data;                                          // of a contiguous array
  std::vector<std::span<const std::uint8_t>> streams;  // of frames
  Shape chunk;                                         // what each of them holds
  std::uint64_t address = 0, data_address = kUndefined;

  bool chunked() const { return !streams.empty(); }
  std::size_t key_size() const { return 8 + 8 * (shape.size() + 1); }
  std::size_t node_size() const { return 24 + kTreeSlots * 8 + (kTreeSlots + 1) * key_size(); }
  // Nodes of each level of the streams' B-tree, leaves first.
  std::vector<std::size_t> tree_levels() const {
    std::vector<std::size_t> levels;
    std::size_t count = streams.size();
    do levels.push_back(count = (count + kTreeSlots - 1) / kTreeSlots);
    while (count > 1);
    return levels;
  }
  std::size_t tree_size() const {
    std::size_t nodes = 0;
    for (const std::size_t level : tree_levels()) nodes += level;
    return nodes * node_size();
  }

  // IV.A.1.b. The size depends on no address, so that it is known before any is.
  void WriteHeader(Bytes& out, const std::vector<Text>& texts) const {
    Bytes messages;
    if (group)
      PutGroup(messages);
    else
      PutArray(messages);
    if (!attributes.empty()) PutMessage(messages, kAttributeInfo, kUnshared, CompactInfo());
    for (const Attr& attribute : attributes) PutAttribute(messages, attribute, texts);
    const std::size_t begin = out.size();
    Put(out, std::string_view("OHDR"));
    out.push_back(2);
    constexpr std::uint8_t kSizeIn4Bytes = 0x02, kAttributeBounds = 0x10;
    out.push_back(kSizeIn4Bytes | kAttributeBounds);
    Put(out, std::uint16_t{128});  // so many attributes stay in a header ...
    Put(out, std::uint16_t{64});   // ... and so few come back to it
    Put(out, static_cast<std::uint32_t>(messages.size()));
    Put(out, messages);
    PutChecksumFrom(out, begin);
  }

  void WriteTree(Bytes& out) const;
  void WriteTreeKey(Bytes& out, std::uint64_t stream) const;

 private:
  void PutGroup(Bytes& out) const {
    PutMessage(out, kLinkInfo, 0, CompactInfo());
    Bytes info{0, 1};  // with bounds, as those of attributes
    Put(info, std::uint16_t{64});
    Put(info, std::uint16_t{32});
    PutMessage(out, kGroupInfo, kConstant, info);
    for (const auto& [name, object] : links) {
      Bytes link{1, 0, static_cast<std::uint8_t>(name.size())};  // hard, its name ASCII of at most 255 bytes
      Put(link, std::string_view(name));
      Put(link, object->address);
      PutMessage(out, kLink, 0, link);
    }
  }

  void PutArray(Bytes& out) const {
    PutMessage(out, kDataspace, 0, Dataspace(shape));
    PutMessage(out, kDatatype, kConstant, type);
    // space: late, or with each chunk; fill value: as set, or never written
    const Bytes fill{3, static_cast<std::uint8_t>(chunked() ? 0x07 : 0x0A)};
    PutMessage(out, kFillValue, kConstant, fill);
    if (chunked()) {
      constexpr std::uint16_t kDeflate = 1, kOptional = 1;
      Bytes filters{2, 1};
      Put(filters, kDeflate);
      Put(filters, kOptional);
      Put(filters, std::uint16_t{1});
      Put(filters, std::uint32_t{1});  // the level; readers do not need it
      PutMessage(out, kFilters, kConstant, filters);
    }
    Bytes layout{3, static_cast<std::uint8_t>(chunked() ? 2 : 1)};
    if (chunked()) {
      layout.push_back(static_cast<std::uint8_t>(shape.size() + 1));
      Put(layout, data_address);
      for (const std::uint64_t extent : chunk) Put(layout, static_cast<std::uint32_t>(extent));
      Put(layout, std::uint32_t{1});  // byte a value
    } else {
      Put(layout, data_address);
      Put(layout, std::uint64_t{data.size()});
    }
    PutMessage(out, kLayout, 0, layout);
  }

  // IV.A.2.m, version 3
  static void PutAttribute(Bytes& out, const Attr& attribute, const std::vector<Text>& texts) {
    const Bytes space = Dataspace(attribute.shape);
    Bytes body{3, 0};
    Put(body, static_cast<std::uint16_t>(attribute.name.size() + 1));
    Put(body, static_cast<std::uint16_t>(attribute.type.size()));
    Put(body, static_cast<std::uint16_t>(space.size()));
    body.push_back(0);  // name in ASCII
    Put(body, std::string_view(attribute.name));
    body.push_back(0);
    Put(body, attribute.type);
    Put(body, space);
    if (attribute.text < texts.size()) {
      const Text& text = texts[attribute.text];
      Put(body, static_cast<std::uint32_t>(text.text.size()));
      Put(body, text.collection);
      Put(body, text.index);
    } else {
      Put(body, attribute.data);
    }
    PutMessage(out, kAttribute, 0, body);
  }
};

void HdfImage::Object::WriteTreeKey(Bytes& out, std::uint64_t stream) const {
  const bool last = stream >= streams.size();
  Put(out, static_cast<std::uint32_t>(last ? 0 : streams[stream].size()));
  Put(out, std::uint32_t{0});  // no filter is left out
  // where it begins; behind the last one what would follow it along each extent
  const std::uint64_t at = last ? streams.size() - 1 : stream, beyond = last ? 1 : 0;
  const std::uint64_t bands = (shape[1] + chunk[1] - 1) / chunk[1];
  const std::uint64_t place[] = {at / bands, at % bands, 0, 0};
  for (std::size_t i = 0; i < shape.size(); ++i) Put(out, (place[i] + beyond) * chunk[i]);
  Put(out, beyond);
}

// III.A.1, node type 1. `data_address` is that of the root: levels follow each other from the root down to the leaves,
// and what the leaves name lies one after the other behind `first_stream`, which the caller has put into `data`.
void HdfImage::Object::WriteTree(Bytes& out) const {
  std::uint64_t first_stream = 0;
  std::memcpy(&first_stream, data.data(), sizeof(first_stream));
  const auto levels = tree_levels();
  std::vector<std::uint64_t> level_at(levels.size());
  std::uint64_t at = data_address;
  for (std::size_t level = levels.size(); level-- > 0; at += levels[level] * node_size()) level_at[level] = at;

  for (std::size_t level = levels.size(); level-- > 0;) {
    const std::size_t below = level == 0 ? streams.size() : levels[level - 1];
    std::uint64_t span = 1;  // streams below an entry
    for (std::size_t i = 0; i < level; ++i) span *= kTreeSlots;
    std::uint64_t stream_at = first_stream;
    for (std::size_t node = 0; node < levels[level]; ++node) {
      const std::size_t begin = out.size(), first = node * kTreeSlots, used = std::min(kTreeSlots, below - first);
      const auto sibling = [&](bool there, std::size_t which) {
        Put(out, there ? level_at[level] + which * node_size() : kUndefined);
      };
      Put(out, std::string_view("TREE"));
      out.push_back(1);
      out.push_back(static_cast<std::uint8_t>(level));
      Put(out, static_cast<std::uint16_t>(used));
      sibling(node > 0, node - 1);
      sibling(node + 1 < levels[level], node + 1);
      for (std::size_t i = first; i < first + used; ++i) {
        WriteTreeKey(out, i * span);
        Put(out, level == 0 ? stream_at : level_at[level - 1] + i * node_size());
        if (level == 0) stream_at += streams[i].size();
      }
      WriteTreeKey(out, (first + used) * span);
      PadTo(out, begin + node_size());
    }
  }
}

HdfImage::HdfImage() { by_path_.emplace("", objects_.emplace_back(std::make_unique<Object>(true)).get()); }
HdfImage::~HdfImage() = default;

template <>
Bytes HdfImage::TypeOf<float>() {
  return FloatType(4, {31, 23, 8, 23, 127});
}
template <>
Bytes HdfImage::TypeOf<double>() {
  return FloatType(8, {63, 52, 11, 52, 1023});
}
template <>
Bytes HdfImage::TypeOf<std::uint8_t>() {
  return IntegerType(1, false);
}
template <>
Bytes HdfImage::TypeOf<std::int64_t>() {
  return IntegerType(8, true);
}
template <>
Bytes HdfImage::TypeOf<std::uint64_t>() {
  return IntegerType(8, false);
}

void HdfImage::Complain(std::string what) {
  if (failed_.empty()) failed_ = std::move(what);
}

HdfImage::Object* HdfImage::Find(const std::string& path) {
  const auto found = by_path_.find(path);
  if (found != by_path_.end()) return found->second;
  Complain("there is no " + path);
  return nullptr;
}

// The object that `path` names, new.
HdfImage::Object* HdfImage::Make(const std::string& path) {
  const std::string parent(ParentOf(path)), name(NameOf(path));
  Group(parent);
  Object* const above = Find(parent);
  if (above == nullptr) return nullptr;
  constexpr std::size_t kLongestName = 255;
  if (!above->group || name.empty() || name.size() > kLongestName || by_path_.contains(path)) {
    Complain(
        fmt::format("'{}' cannot be made: it is there, its parent is no group, or its name is not of 1 to {} bytes",
                    path, kLongestName));
    return nullptr;
  }
  Object* const made = objects_.emplace_back(std::make_unique<Object>(false)).get();
  above->links.emplace_back(name, made);
  by_path_.emplace(path, made);
  return made;
}

void HdfImage::Group(const std::string& path) {
  if (by_path_.contains(path)) return;
  if (Object* const made = Make(path)) made->group = true;
}

void HdfImage::Attribute(const std::string& object, const char* name, std::string_view text) {
  Object* const of = Find(object);
  if (of == nullptr) return;
  text = text.substr(0, text.find('\0'));
  if (text.size() > std::numeric_limits<std::uint32_t>::max()) return Complain(fmt::format("{} is too long", name));
  of->attributes.push_back({name, TextType(), {}, {}, texts_.size()});
  texts_.push_back({std::string(text)});
}

void HdfImage::AddAttribute(const std::string& object, const char* name, const Bytes& type, const Shape& shape,
                            std::span<const std::uint8_t> data) {
  Object* const of = Find(object);
  if (of == nullptr) return;
  constexpr std::size_t kRoom = 1000;  // for what stands before the values
  if (data.size() + std::strlen(name) > kMostMessage - kRoom)
    return Complain(fmt::format("attribute {} of {}: {} bytes", name, object, data.size()));
  of->attributes.push_back({name, type, shape, {data.begin(), data.end()}});
}

void HdfImage::AddArray(const std::string& path, const Bytes& type, const Shape& shape,
                        std::span<const std::uint8_t> data) {
  std::uint32_t width = 0;
  std::memcpy(&width, type.data() + 4, sizeof(width));
  std::uint64_t expected = width;
  for (const std::uint64_t extent : shape) expected *= extent;
  if (expected != data.size()) return Complain("array " + path + ": its size does not fit its shape");
  Object* const made = Make(path);
  if (made == nullptr) return;
  made->type = type;
  made->shape = shape;
  made->data.assign(data.begin(), data.end());
}

void HdfImage::Frames(const std::string& path, const codec::FrameLayout& layout, std::size_t count,
                      const std::vector<std::span<const std::uint8_t>>& streams) {
  for (const auto& stream : streams)
    if (stream.empty() || stream.size() > std::numeric_limits<std::uint32_t>::max())
      return Complain(fmt::format("frames {}: a stream of {} bytes", path, stream.size()));
  if (count == 0 || !layout.IsGood() || streams.size() != layout.streams(count) ||
      static_cast<std::size_t>(layout.chunk.frames) > count)
    return Complain(fmt::format("frames {}: {} streams for {}", path, streams.size(), count));
  Object* const made = Make(path);
  if (made == nullptr) return;
  const auto extent = [](int n) { return static_cast<std::uint64_t>(n); };
  made->type = TypeOf<std::uint8_t>();
  made->shape = {count, extent(layout.height), extent(layout.width), 3};
  made->chunk = {extent(layout.chunk.frames), extent(layout.rows()), extent(layout.width), 3};
  made->streams = streams;
}

// III.E: texts in collections of at least kHeapLeast bytes, from `at` on. Returns where they end.
std::uint64_t HdfImage::PlaceTexts(std::uint64_t at) {
  for (std::size_t begin = 0; begin < texts_.size();) {
    std::uint64_t size = kHeapHead;
    std::size_t end = begin;
    for (; end < texts_.size(); ++end) {
      const std::uint64_t more = kHeapHead + Align8(texts_[end].text.size());
      if (end > begin && size + more > kHeapMost) break;
      size += more;
      texts_[end].collection = at;
      texts_[end].index = static_cast<std::uint32_t>(end - begin + 1);
    }
    texts_[begin].first = true;
    texts_[begin].collection_size = std::max<std::uint64_t>(size + kHeapHead, kHeapLeast);  // room for the end's head
    at += texts_[begin].collection_size;
    begin = end;
  }
  return at;
}

void HdfImage::WriteHeaps(Bytes& out) const {
  for (std::size_t begin = 0; begin < texts_.size();) {
    const std::uint64_t end_at = texts_[begin].collection + texts_[begin].collection_size;
    Put(out, std::string_view("GCOL"));
    Put(out, std::uint32_t{1});  // version
    Put(out, texts_[begin].collection_size);
    std::size_t i = begin;
    do {
      const std::string& text = texts_[i].text;
      Put(out, static_cast<std::uint16_t>(texts_[i].index));
      Put(out, std::uint16_t{0});
      Put(out, std::uint32_t{0});
      Put(out, std::uint64_t{text.size()});
      Put(out, std::string_view(text));
      PadTo(out, out.size() + Align8(text.size()) - text.size());
    } while (++i < texts_.size() && !texts_[i].first);
    Put(out, std::uint64_t{0});  // object 0: what is free
    Put(out, end_at - (out.size() - sizeof(std::uint64_t)));
    PadTo(out, end_at);
    begin = i;
  }
}

std::uint64_t HdfImage::PlaceHead() {
  std::uint64_t at = kSuperblockSize;
  for (const auto& object : objects_) {
    Bytes header;
    object->WriteHeader(header, texts_);
    object->address = at;
    at += header.size();
  }
  at = PlaceTexts(Align8(at));
  for (const auto& object : objects_)
    if (object->chunked()) {
      object->data_address = at = Align8(at);
      at += object->tree_size();
    }
  for (const auto& object : objects_)
    if (!object->data.empty()) {
      object->data_address = at = Align8(at);
      at += object->data.size();
    }
  return at;
}

Result<HdfImageBytes> HdfImage::Finish() {
  if (!failed_.empty()) return Fail(Code::kInternal, "make an HDF5 file: " + failed_);
  const std::uint64_t head_size = PlaceHead();
  std::uint64_t at = head_size;
  HdfImageBytes image;
  for (const auto& object : objects_) {
    if (!object->chunked()) continue;
    Put(object->data, at);
    for (const auto& stream : object->streams) at += stream.size();
    image.streams.insert(image.streams.end(), object->streams.begin(), object->streams.end());
  }

  Bytes& out = image.head;
  out.reserve(head_size);
  Put(out, std::string_view("\x89HDF\r\n\x1a\n"));
  Put(out, std::uint32_t{0x00080802});  // version 2, addresses and sizes of 8 bytes
  Put(out, std::uint64_t{0});           // base address
  Put(out, kUndefined);                 // no extension
  Put(out, at);                         // the file's end
  Put(out, objects_.front()->address);
  PutChecksumFrom(out, 0);
  for (const auto& object : objects_) object->WriteHeader(out, texts_);
  PadTo(out, Align8(out.size()));
  WriteHeaps(out);
  for (const auto& object : objects_)
    if (object->chunked()) {
      PadTo(out, object->data_address);
      object->WriteTree(out);
    }
  for (const auto& object : objects_)
    if (!object->chunked() && !object->data.empty()) {
      PadTo(out, object->data_address);
      Put(out, std::span<const std::uint8_t>(object->data));
    }
  return image;
}

}  // namespace etude::store::internal
