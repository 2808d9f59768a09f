// SPDX-License-Identifier: Apache-2.0
// Section numbers are those of the HDF5 File Format Specification 3.0.
#include "services/store/hdf_view.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <string_view>

#include "services/codec/deflate.h"

namespace etude::store::internal {
namespace {

static_assert(std::endian::native == std::endian::little, "values are copied as they lie in the file");

using Bytes = HdfView::Bytes;

constexpr std::size_t kMostBlocks = 64;  // of one object's header

// Reads from the front. Beyond the end everything is empty or 0, and it is not good any more.
class Cursor {
 public:
  explicit Cursor(Bytes bytes) : left_(bytes) {}

  Bytes Take(std::uint64_t size) {
    if (size > left_.size()) {
      good_ = false;
      left_ = {};
      return {};
    }
    const Bytes taken = left_.first(static_cast<std::size_t>(size));
    left_ = left_.subspan(static_cast<std::size_t>(size));
    return taken;
  }
  // little-endian, of at most 8 bytes
  std::uint64_t Number(std::size_t size) {
    std::uint64_t value = 0;
    const Bytes bytes = Take(size);
    if (!bytes.empty()) std::memcpy(&value, bytes.data(), bytes.size());
    return value;
  }
  bool Begins(std::string_view text) {
    const Bytes bytes = Take(text.size());
    return std::equal(bytes.begin(), bytes.end(), text.begin(), text.end(),
                      [](std::uint8_t a, char b) { return a == static_cast<std::uint8_t>(b); });
  }
  Bytes Rest() { return Take(left_.size()); }
  std::size_t left() const { return left_.size(); }
  bool good() const { return good_; }

 private:
  Bytes left_;
  bool good_ = true;
};

// Up to its first NUL.
std::string TextOf(Bytes bytes) { return {bytes.begin(), std::find(bytes.begin(), bytes.end(), 0)}; }

// IV.A.2.b; nothing where it is none that we write: another version, or null.
std::optional<Shape> ExtentsOf(Bytes space) {
  Cursor cursor(space);
  const auto version = cursor.Number(1), rank = cursor.Number(1);
  cursor.Number(1);  // whether largest extents follow
  const auto kind = cursor.Number(1);
  if (version == 1) cursor.Take(4);
  Shape shape(static_cast<std::size_t>(rank));
  for (auto& extent : shape) extent = cursor.Number(8);
  const bool known = version == 1 || (version == 2 && kind <= 1);
  return cursor.good() && known ? std::optional(shape) : std::nullopt;
}

// Nothing where it overflows.
std::optional<std::uint64_t> Product(std::uint64_t size, const Shape& shape) {
  for (const std::uint64_t extent : shape)
    if (__builtin_mul_overflow(size, extent, &size)) return std::nullopt;
  return size;
}

}  // namespace

HdfView::HdfView(Bytes bytes) : bytes_(bytes) {
  Cursor cursor(bytes);
  const bool begins = cursor.Begins("\x89HDF\r\n\x1a\n");
  const auto version = cursor.Number(1), address_size = cursor.Number(1), length_size = cursor.Number(1);
  cursor.Number(1);
  const auto base = cursor.Number(8);
  cursor.Take(16);  // extension, the file's end
  root_ = cursor.Number(8);
  if (!begins || !cursor.good() || version != 2 || address_size != 8 || length_size != 8 || base != 0)
    Complain("not an HDF5 file of format 1.8");
}

bool HdfView::Complain(const std::string& what) {
  if (failed_.empty()) failed_ = what;
  return false;
}

Bytes HdfView::From(std::uint64_t address) const {
  return address <= bytes_.size() ? bytes_.subspan(static_cast<std::size_t>(address)) : Bytes();
}

// Empty where it does not lie in the file.
Bytes HdfView::At(std::uint64_t address, std::uint64_t size) const { return Cursor(From(address)).Take(size); }

const HdfView::Header* HdfView::Open(const std::string& path) {
  if (!failed_.empty()) return nullptr;
  const Header* header = HeaderAt(root_);
  for (std::size_t begin = 1; header != nullptr && begin < path.size();) {
    const std::size_t end = std::min(path.find('/', begin), path.size());
    const auto link = header->links.find(path.substr(begin, end - begin));
    header = link == header->links.end() ? nullptr : HeaderAt(link->second);
    begin = end + 1;
  }
  if (header == nullptr) Complain("there is no " + path);
  return header;
}

const HdfView::Header* HdfView::HeaderAt(std::uint64_t address) {
  const auto [found, fresh] = headers_.try_emplace(address);
  if (fresh && !ReadHeader(address, found->second)) {
    headers_.erase(found);
    Complain(fmt::format("the object's header at {} is damaged", address));
    return nullptr;
  }
  return &found->second;
}

namespace {

// kinds of messages, IV.A.2
constexpr std::uint64_t kDataspace = 1, kDatatype = 3, kLink = 6, kLayout = 8, kAttribute = 12, kContinuation = 16;

// IV.A.2.g; a link of another kind than to an object of this file leads nowhere.
bool TakeLink(Bytes message, std::map<std::string, std::uint64_t>& links) {
  Cursor cursor(message);
  const auto version = cursor.Number(1), flags = cursor.Number(1);
  const auto kind = (flags & 8) != 0 ? cursor.Number(1) : 0;
  if ((flags & 4) != 0) cursor.Take(8);   // order of creation
  if ((flags & 16) != 0) cursor.Take(1);  // character set
  const Bytes name = cursor.Take(cursor.Number(std::size_t{1} << (flags & 3)));
  const auto address = kind == 0 ? cursor.Number(8) : 0;
  if (!cursor.good() || version != 1) return false;
  if (kind == 0) links.emplace(std::string(name.begin(), name.end()), address);
  return true;
}

}  // namespace

// IV.A.1.c
bool HdfView::Continue(Bytes message, std::vector<Bytes>& blocks) const {
  Cursor cursor(message);
  const auto address = cursor.Number(8), size = cursor.Number(8);
  constexpr std::uint64_t kFrame = 8;  // what stands around the messages: "OCHK", a checksum
  Cursor block(At(address, size));
  if (!cursor.good() || size < kFrame || !block.Begins("OCHK") || blocks.size() >= kMostBlocks) return false;
  blocks.push_back(block.Take(size - kFrame));
  return true;
}

// IV.A.1.b
bool HdfView::ReadHeader(std::uint64_t address, Header& header) const {
  Cursor cursor(From(address));
  const bool begins = cursor.Begins("OHDR") && cursor.Number(1) == 2;
  const auto flags = cursor.Number(1);
  if ((flags & 0x20) != 0) cursor.Take(16);  // times
  if ((flags & 0x10) != 0) cursor.Take(4);   // bounds of attributes
  std::vector<Bytes> blocks{cursor.Take(cursor.Number(std::size_t{1} << (flags & 3)))};
  const std::size_t head = (flags & 4) != 0 ? 6 : 4;  // of a message
  bool good = begins && cursor.good();
  for (std::size_t i = 0; good && i < blocks.size(); ++i)
    for (Cursor messages(blocks[i]); good && messages.left() >= head;) {
      const auto type = messages.Number(1), size = messages.Number(2), message_flags = messages.Number(1);
      messages.Take(head - 4);
      const Bytes body = messages.Take(size);
      good = messages.good() && (message_flags & 2) == 0;  // shared: what we read is not here
      if (type == kDataspace) header.space = body;
      if (type == kDatatype) header.type = body;
      if (type == kLayout) header.layout = body;
      if (type == kLink) good = good && TakeLink(body, header.links);
      if (type == kContinuation) good = good && Continue(body, blocks);
      if (type != kAttribute) continue;
      Cursor fields(body);  // IV.A.2.m, version 3
      good = good && fields.Number(1) == 3 && fields.Number(1) == 0;
      const auto name_size = fields.Number(2), type_size = fields.Number(2), space_size = fields.Number(2);
      fields.Take(1);
      const std::string name = TextOf(fields.Take(name_size));
      const Attribute attribute{fields.Take(type_size), fields.Take(space_size), fields.Rest()};
      good = good && fields.good() && header.attributes.emplace(name, attribute).second;
    }
  return good;
}

// IV.A.2.d: the class, whether it is signed, and the order of bytes are the same in every version.
bool HdfView::Is(Bytes type, const Type& wanted) {
  Cursor cursor(type);
  const auto kind = cursor.Number(1) & 0x0F, bits = cursor.Number(1);
  cursor.Take(2);
  const auto size = cursor.Number(4);
  const bool little_endian = (bits & 1) == 0;
  const bool is_kind = wanted.is_float ? kind == 1 : kind == 0 && ((bits & 8) != 0) == wanted.is_signed;
  return cursor.good() && is_kind && little_endian && size == wanted.size;
}

const HdfView::Attribute* HdfView::Find(const std::string& object, const char* name) {
  const Header* const header = Open(object);
  if (header == nullptr) return nullptr;
  const auto found = header->attributes.find(name);
  if (found != header->attributes.end()) return &found->second;
  Complain(fmt::format("{} has no attribute {}", object, name));
  return nullptr;
}

Bytes HdfView::Numbers(const std::string& object, const char* name, const Type& type, std::size_t count) {
  const Attribute* const found = Find(object, name);
  if (found == nullptr) return {};
  const auto extents = ExtentsOf(found->space);
  const bool fits =
      extents && Product(1, *extents) == count && Is(found->type, type) && found->data.size() >= count * type.size;
  if (fits) return found->data.first(count * type.size);
  Complain(fmt::format("attribute {} of {}: not {} numbers of {} bytes", name, object, count, type.size));
  return {};
}

// III.E
std::optional<Bytes> HdfView::HeapObject(std::uint64_t address, std::uint64_t index) const {
  Cursor head(From(address));
  const bool begins = head.Begins("GCOL") && head.Number(1) == 1;
  head.Take(3);
  const auto size = head.Number(8);
  constexpr std::uint64_t kHead = 16;  // of a collection, and of each object in it
  if (!begins || !head.good() || size < kHead) return std::nullopt;
  Cursor objects(At(address, size));
  objects.Take(kHead);
  while (objects.left() >= kHead) {
    const auto number = objects.Number(2);
    objects.Take(6);
    const auto length = objects.Number(8);
    if (number == 0) break;  // what is free; it is the last
    const Bytes data = objects.Take(length);
    if (!objects.good()) break;
    if (number == index) return data;
    objects.Take(std::min<std::uint64_t>(objects.left(), (8 - length % 8) % 8));
  }
  return std::nullopt;
}

std::string HdfView::Text(const std::string& object, const char* name) {
  const Attribute* const found = Find(object, name);
  if (found == nullptr) return {};
  Cursor type(found->type);
  const bool is_text = (type.Number(1) & 0x0F) == 9 && (type.Number(1) & 0x0F) == 1;
  const auto extents = ExtentsOf(found->space);
  Cursor reference(found->data);
  const auto length = reference.Number(4), address = reference.Number(8), index = reference.Number(4);
  if (is_text && type.good() && extents && Product(1, *extents) == 1 && reference.good()) {
    if (length == 0) return {};
    const auto data = HeapObject(address, index);
    if (data && data->size() >= length) return TextOf(data->first(static_cast<std::size_t>(length)));
  }
  Complain(fmt::format("attribute {} of {}: not one text", name, object));
  return {};
}

Bytes HdfView::Values(const std::string& path, const Type& type, std::size_t rank, Shape& shape) {
  shape.assign(rank, 0);
  const Header* const header = Open(path);
  if (header == nullptr) return {};
  const auto extents = ExtentsOf(header->space);
  Cursor layout(header->layout);  // IV.A.2.i, version 3, contiguous
  const bool contiguous = layout.Number(1) == 3 && layout.Number(1) == 1;
  const auto address = layout.Number(8), size = layout.Number(8);
  const auto wanted = extents ? Product(type.size, *extents) : std::nullopt;
  const bool fits = Is(header->type, type) && wanted && extents->size() == rank && contiguous && layout.good();
  const Bytes data = fits && *wanted > 0 && *wanted == size ? At(address, size) : Bytes();
  if (!fits || data.size() != *wanted) {
    Complain(fmt::format("array {}: not {} bytes a value in {} dimensions, or not in its file", path, type.size, rank));
    return {};
  }
  shape = *extents;
  return data;
}

// III.A.1, node type 1. Levels fall from the root down, so that no node is below itself; that many nodes share one
// below them is bounded by their number.
bool HdfView::ReadTree(std::uint64_t root, StoredFrames& frames) const {
  const codec::FrameLayout& layout = frames.layout;
  auto& locations = frames.streams;
  const auto of_block = static_cast<std::uint64_t>(layout.chunk.frames),
             rows = static_cast<std::uint64_t>(layout.rows()), bands = static_cast<std::uint64_t>(layout.bands());
  struct Node {
    std::uint64_t address, above;
  };
  constexpr std::uint64_t kAboveAll = 256;
  std::vector<Node> nodes{{root, kAboveAll}};
  std::size_t found = 0;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    const Node node = nodes[i];
    Cursor cursor(From(node.address));
    const bool begins = cursor.Begins("TREE") && cursor.Number(1) == 1;
    const auto level = cursor.Number(1), used = cursor.Number(2);
    cursor.Take(16);  // siblings
    if (!begins || level >= node.above) return false;
    for (std::uint64_t entry = 0; entry < used; ++entry) {
      const auto size = cursor.Number(4), left_out = cursor.Number(4);
      const auto frame = cursor.Number(8), row = cursor.Number(8);
      const Bytes others = cursor.Take(24);  // where it begins along the other extents
      const auto address = cursor.Number(8);
      if (!cursor.good()) return false;
      if (level > 0) {
        if (nodes.size() > locations.size()) return false;
        nodes.push_back({address, level});
        continue;
      }
      const bool first = std::ranges::all_of(others, [](std::uint8_t byte) { return byte == 0; });
      if (frame >= frames.count || frame % of_block != 0 || row / rows >= bands || row % rows != 0 || !first)
        return false;
      auto& location = locations[frame / of_block * bands + row / rows];
      if (location.size != 0 || left_out != 0 || size == 0 || size > codec::StreamBound(layout.stream_bytes()) ||
          At(address, size).empty())
        return false;
      location = {address, static_cast<std::uint32_t>(size)};
      ++found;
    }
  }
  return found == locations.size();
}

StoredFrames HdfView::Frames(const std::string& path) {
  const Header* const header = Open(path);
  if (header == nullptr) return {};
  const auto extents = ExtentsOf(header->space);
  Cursor layout(header->layout);  // version 3, chunked, of bytes
  const bool chunked = layout.Number(1) == 3 && layout.Number(1) == 2 && layout.Number(1) == 5;
  const auto tree = layout.Number(8);
  Shape chunk(5);
  for (auto& extent : chunk) extent = layout.Number(4);
  constexpr std::uint64_t kEntrySize = 56;  // of the tree, one a stream: what bounds the memory taken here
  constexpr std::uint64_t kMostSide = 1 << 20;
  StoredFrames frames;
  bool laid_out = extents && extents->size() == 4 && chunked && layout.good() &&
                  Is(header->type, TypeOf<std::uint8_t>()) && (*extents)[0] >= 1 && (*extents)[0] <= kMaxSteps &&
                  (*extents)[3] == 3 && chunk[2] == (*extents)[2] && chunk[3] == 3 && chunk[4] == 1 &&
                  std::max((*extents)[1], (*extents)[2]) <= kMostSide && chunk[1] >= 1 && chunk[1] <= (*extents)[1] &&
                  chunk[0] <= (*extents)[0];
  if (laid_out) {
    const auto number = [](std::uint64_t extent) { return static_cast<int>(extent); };
    frames.layout = {number((*extents)[2]), number((*extents)[1]), {number(chunk[0]), number(chunk[1])}};
    frames.count = (*extents)[0];
    laid_out =
        frames.layout.IsGood() && frames.layout.blocks(frames.count) <=
                                      bytes_.size() / kEntrySize / static_cast<std::size_t>(frames.layout.bands());
  }
  if (laid_out) frames.streams.resize(frames.layout.streams(frames.count));
  if (laid_out && ReadTree(tree, frames)) return frames;
  Complain(fmt::format("frames {}: not cut into streams as this program reads them, or one is not there", path));
  return {};
}

std::vector<std::string> HdfView::Children(const std::string& group) {
  std::vector<std::string> names;
  if (const Header* const header = Open(group))
    for (const auto& [name, address] : header->links) names.push_back(name);
  return names;
}

Status HdfView::Finish() const {
  if (!failed_.empty()) return Fail(Code::kCorrupt, failed_);
  return {};
}

}  // namespace etude::store::internal
