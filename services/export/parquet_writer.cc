// SPDX-License-Identifier: Apache-2.0
#include "services/export/parquet_writer.h"

#include <fmt/format.h>

#include <cerrno>
#include <set>
#include <utility>

#include "services/export/parquet_page.h"
#include "services/export/thrift_compact.h"

namespace etude::exports {
namespace {

using internal::Page;
using internal::ThriftWriter;

constexpr std::string_view kMagic = "PAR1";

// numbers of parquet.thrift
constexpr std::int32_t kOptional = 1, kRepeated = 2;
constexpr std::int32_t kUtf8 = 0, kListType = 3;     // converted types
constexpr int kStringLogical = 1, kListLogical = 3;  // logical types

// What the footer says of one column of one row group.
struct ChunkRecord {
  std::uint64_t offset = 0, size = 0, levels = 0;
  std::optional<std::string> min, max;
};

struct GroupRecord {
  std::uint64_t rows = 0, size = 0, offset = 0;
  std::vector<ChunkRecord> chunks;
};

// A logical type is a union whose members are empty structs.
void LogicalType(ThriftWriter& thrift, int member) {
  thrift.BeginStruct(10);
  thrift.BeginStruct(member);
  thrift.EndStruct();
  thrift.EndStruct();
}

void Node(ThriftWriter& thrift, const std::string& name, std::int32_t repetition, bool is_list) {
  thrift.BeginElement();
  thrift.Integer(3, repetition);
  thrift.Text(4, name);
  thrift.Integer(5, 1);  // one child
  if (is_list) {
    thrift.Integer(6, kListType);
    LogicalType(thrift, kListLogical);
  }
  thrift.EndStruct();
}

void Leaf(ThriftWriter& thrift, const std::string& name, ParquetType type) {
  thrift.BeginElement();
  thrift.Integer(1, static_cast<std::int32_t>(internal::PhysicalTypeOf(type)));
  thrift.Integer(3, kOptional);
  thrift.Text(4, name);
  if (type == ParquetType::kText) {
    thrift.Integer(6, kUtf8);
    LogicalType(thrift, kStringLogical);
  }
  thrift.EndStruct();
}

// The tree of names, parents first: a list is NAME > list > element.
void Schema(ThriftWriter& thrift, const std::vector<ParquetColumn>& columns) {
  std::size_t nodes = 1;
  for (const auto& column : columns) nodes += 1 + 2 * static_cast<std::size_t>(column.lists);
  thrift.BeginStructs(2, nodes);
  thrift.BeginElement();
  thrift.Text(4, "schema");
  thrift.Integer(5, static_cast<std::int32_t>(columns.size()));
  thrift.EndStruct();
  for (const auto& column : columns) {
    std::string name = column.name;
    for (int depth = 0; depth < column.lists; ++depth) {
      Node(thrift, name, kOptional, true);
      Node(thrift, "list", kRepeated, false);
      name = "element";
    }
    Leaf(thrift, name, column.type);
  }
}

std::vector<std::string> PathOf(const ParquetColumn& column) {
  std::vector<std::string> path{column.name};
  for (int depth = 0; depth < column.lists; ++depth) path.insert(path.end(), {"list", "element"});
  return path;
}

void Chunk(ThriftWriter& thrift, const ParquetColumn& column, const ChunkRecord& chunk) {
  thrift.BeginElement();
  thrift.Long(2, static_cast<std::int64_t>(chunk.offset));
  thrift.BeginStruct(3);
  thrift.Integer(1, static_cast<std::int32_t>(internal::PhysicalTypeOf(column.type)));
  thrift.Integers(
      2, {static_cast<std::int32_t>(internal::Encoding::kPlain), static_cast<std::int32_t>(internal::Encoding::kRle)});
  thrift.Texts(3, PathOf(column));
  thrift.Integer(4, 0);  // not compressed
  thrift.Long(5, static_cast<std::int64_t>(chunk.levels));
  thrift.Long(6, static_cast<std::int64_t>(chunk.size));
  thrift.Long(7, static_cast<std::int64_t>(chunk.size));
  thrift.Long(9, static_cast<std::int64_t>(chunk.offset));
  if (chunk.min && chunk.max) {
    thrift.BeginStruct(12);
    if (column.lists == 0) thrift.Long(3, 0);  // of nulls; a list without values has a place that counts as one
    thrift.Text(5, *chunk.max);
    thrift.Text(6, *chunk.min);
    thrift.EndStruct();
  }
  thrift.EndStruct();
  thrift.EndStruct();
}

void Group(ThriftWriter& thrift, const std::vector<ParquetColumn>& columns, const GroupRecord& group) {
  thrift.BeginElement();
  thrift.BeginStructs(1, columns.size());
  for (std::size_t i = 0; i < columns.size(); ++i) Chunk(thrift, columns[i], group.chunks[i]);
  thrift.Long(2, static_cast<std::int64_t>(group.size));
  thrift.Long(3, static_cast<std::int64_t>(group.rows));
  thrift.Long(5, static_cast<std::int64_t>(group.offset));
  thrift.Long(6, static_cast<std::int64_t>(group.size));
  thrift.EndStruct();
}

}  // namespace

struct ParquetWriter::Impl {
  Path path;
  std::vector<ParquetColumn> columns;
  std::map<std::string, std::string> metadata;
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> file;
  std::vector<GroupRecord> groups = {};
  std::uint64_t bytes = 0, rows = 0;

  Status Write(std::string_view text) {
    if (std::fwrite(text.data(), 1, text.size(), file.get()) != text.size())
      return Fail(ErrnoError("write", path, errno));
    bytes += text.size();
    return {};
  }

  std::string Footer() const {
    ThriftWriter thrift;
    thrift.Integer(1, 1);  // of the format
    Schema(thrift, columns);
    thrift.Long(3, static_cast<std::int64_t>(rows));
    thrift.BeginStructs(4, groups.size());
    for (const auto& group : groups) Group(thrift, columns, group);
    if (!metadata.empty()) {
      thrift.BeginStructs(5, metadata.size());
      for (const auto& [key, value] : metadata) {
        thrift.BeginElement();
        thrift.Text(1, key);
        thrift.Text(2, value);
        thrift.EndStruct();
      }
    }
    thrift.Text(6, "etude");
    thrift.BeginStructs(7, columns.size());  // minima and maxima are in the types' own order
    for (std::size_t i = 0; i < columns.size(); ++i) {
      thrift.BeginElement();
      thrift.BeginStruct(1);
      thrift.EndStruct();
      thrift.EndStruct();
    }
    thrift.EndStruct();
    return thrift.bytes();
  }
};

ParquetWriter::ParquetWriter(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
ParquetWriter::ParquetWriter(ParquetWriter&&) noexcept = default;
ParquetWriter& ParquetWriter::operator=(ParquetWriter&&) noexcept = default;
ParquetWriter::~ParquetWriter() = default;

Result<ParquetWriter> ParquetWriter::Create(const Path& path, std::vector<ParquetColumn> columns,
                                            std::map<std::string, std::string> metadata) {
  std::set<std::string> names;
  for (const auto& column : columns)
    if (column.name.empty() || column.lists < 0 || !names.insert(column.name).second)
      return Fail(Code::kInvalidArgument,
                  fmt::format("write '{}': column '{}' has no name, has it twice, or has {} levels of lists",
                              path.string(), column.name, column.lists));
  if (columns.empty()) return Fail(Code::kInvalidArgument, fmt::format("write '{}': no columns", path.string()));
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "wbe"), &std::fclose);
  if (!file) return Fail(ErrnoError("create", path, errno));
  auto impl = std::unique_ptr<Impl>(new Impl{path, std::move(columns), std::move(metadata), std::move(file)});
  ETUDE_RETURN_IF_ERROR(impl->Write(kMagic));
  return ParquetWriter(std::move(impl));
}

Status ParquetWriter::WriteRowGroup(std::size_t rows, const std::vector<ParquetCells>& cells) {
  Impl& impl = *impl_;
  if (cells.size() != impl.columns.size())
    return Fail(Code::kInvalidArgument, fmt::format("write '{}': values of {} columns, it has {}", impl.path.string(),
                                                    cells.size(), impl.columns.size()));
  std::vector<Page> pages;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    auto page = internal::MakePage(impl.columns[i], rows, cells[i]);
    if (!page) return Fail(page.error().Wrap(fmt::format("write '{}'", impl.path.string())));
    pages.push_back(std::move(*page));
  }
  if (rows == 0) return {};
  GroupRecord group{.rows = rows, .offset = impl.bytes};
  for (auto& page : pages) {
    group.chunks.push_back({impl.bytes, page.bytes.size(), page.levels, std::move(page.min), std::move(page.max)});
    group.size += page.bytes.size();
    ETUDE_RETURN_IF_ERROR(impl.Write(page.bytes));
  }
  impl.groups.push_back(std::move(group));
  impl.rows += rows;
  return {};
}

Status ParquetWriter::Finish() {
  const std::string footer = impl_->Footer();
  const auto size = static_cast<std::uint32_t>(footer.size());
  ETUDE_RETURN_IF_ERROR(impl_->Write(footer));
  ETUDE_RETURN_IF_ERROR(impl_->Write({reinterpret_cast<const char*>(&size), sizeof(size)}));
  ETUDE_RETURN_IF_ERROR(impl_->Write(kMagic));
  if (std::fclose(impl_->file.release()) != 0) return Fail(ErrnoError("write", impl_->path, errno));
  ETUDE_RETURN_IF_ERROR(SyncFile(impl_->path));
  return SyncFolder(impl_->path.parent_path());
}

std::uint64_t ParquetWriter::bytes() const { return impl_->bytes; }
std::uint64_t ParquetWriter::rows() const { return impl_->rows; }

}  // namespace etude::exports
