// SPDX-License-Identifier: Apache-2.0
#include "services/relay/kept_checkpoints.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <string_view>
#include <utility>

#include "services/core/config.h"
#include "services/core/hash.h"
#include "services/core/identity.h"
#include "services/core/log.h"
#include "services/core/printable.h"
#include "services/episode/bounded_json.h"

namespace etude::relay {
namespace {

constexpr char kRecord[] = "kept.json";
constexpr char kLock[] = "kept.lock";
constexpr std::string_view kFilePrefix = "relayed-";
constexpr std::uint64_t kLargestRecord = 64u << 20;
// of one checkpoint; a byte becomes six at most, and all of them fit into the record
constexpr std::uint64_t kLargestMetadata = 1u << 20;

/// What kept.json says.
struct Record {
  KeptOwner run;
  std::map<std::string, Kept> channels;
};

std::string FileNameOf(const std::string& channel, std::uint64_t version) {
  return fmt::format("{}{}-{}.safetensors", kFilePrefix, channel, version);
}

bool HasText(const OrderedJson& json, const char* key) { return json.contains(key) && json[key].is_string(); }

std::optional<Kept> KeptOf(const OrderedJson& json) {
  if (!json.is_object() || !json.contains("version") || !json["version"].is_number_unsigned() ||
      !HasText(json, "sha256") || !HasText(json, "meta_json"))
    return std::nullopt;
  return Kept{.version = json["version"].get<std::uint64_t>(),
              .sha256 = json["sha256"].get<std::string>(),
              .meta_json = json["meta_json"].get<std::string>()};
}

// A file's name follows from channel and version: what stands in the record cannot lead out of the folder.
std::optional<Record> RecordOf(const OrderedJson& json) {
  if (!json.is_object() || !HasText(json, "run") || !HasText(json, "run_id") || !json.contains("channels") ||
      !json["channels"].is_object())
    return std::nullopt;
  const std::string user = HasText(json, "user") ? json["user"].get<std::string>() : "";
  Record record{{{json["run"].get<std::string>(), json["run_id"].get<std::string>()}, user}, {}};
  if (!IsPlainName(record.run.name) || !IsId(record.run.id)) return std::nullopt;
  for (const auto& [channel, entry] : json["channels"].items()) {
    auto kept = KeptOf(entry);
    if (!kept || !IsPlainName(channel) || record.channels.size() >= KeptCheckpoints::kMostChannels) return std::nullopt;
    kept->file = FileNameOf(channel, kept->version);
    record.channels[channel] = std::move(*kept);
  }
  return record;
}

Result<std::optional<Record>> ReadRecord(const Path& folder) {
  const Path file = folder / kRecord;
  const auto text = ReadTextFile(file, kLargestRecord);
  if (!text && text.error().code == Code::kNotFound) return std::optional<Record>();
  if (!text) return Fail(text.error().Wrap("the checkpoints that a relay keeps"));
  auto record = RecordOf(ParseBoundedJson(*text).value_or(OrderedJson()));
  if (!record)
    return Fail(Code::kCorrupt, fmt::format("'{}' does not say what a relay keeps; to begin anew, which forgets the "
                                            "newest versions that there were, remove it",
                                            file.string()));
  return record;
}

Result<std::vector<std::uint8_t>> ReadVerified(const Path& file, const Kept& kept) {
  ETUDE_ASSIGN_OR_RETURN(auto bytes, ReadBinaryFile(file));
  if (Sha256Hex(bytes) != kept.sha256)
    return Fail(Code::kCorrupt, fmt::format("'{}' was damaged: its bytes do not fit their hash", file.string()));
  return bytes;
}

}  // namespace

Result<std::optional<KeptOwner>> KeptRun(const Path& folder) {
  ETUDE_ASSIGN_OR_RETURN(const auto record, ReadRecord(folder));
  return record ? std::optional(record->run) : std::nullopt;
}

Result<KeptCheckpoints> KeptCheckpoints::Open(const Path& folder, const bus::Owner& run, const std::string& user) {
  ETUDE_RETURN_IF_ERROR(MakeFolders(folder));
  ETUDE_ASSIGN_OR_RETURN(auto lock,
                         FileLock::Take(folder / kLock, fmt::format("relay folder '{}' is used", folder.string())));
  ETUDE_ASSIGN_OR_RETURN(auto record, ReadRecord(folder));
  KeptCheckpoints kept(folder, run, std::move(lock));
  kept.user_ = user;
  if (!record || record->run.id != run.id) return kept;
  if (user.empty()) kept.user_ = record->run.user;
  kept.channels_ = std::move(record->channels);
  for (auto& [channel, one] : kept.channels_) {
    if (const auto bytes = ReadVerified(folder / one.file, one); !bytes) {
      Log().warn("a kept checkpoint cannot be passed on channel={} version={}: {}", channel, one.version,
                 bytes.error().message);
      one.whole = false;
    }
  }
  kept.RemoveOthers();
  return kept;
}

Status KeptCheckpoints::CheckVersion(const bus::PublishedBlob& blob) const {
  const auto found = channels_.find(blob.channel);
  if (found == channels_.end()) {
    if (channels_.size() < kMostChannels) return {};
    return Fail(Code::kInvalidArgument, fmt::format("{} channels are kept already", channels_.size()));
  }
  const Kept& kept = found->second;
  if (blob.version > kept.version || (blob.version == kept.version && blob.sha256 == kept.sha256)) return {};
  return Fail(Code::kInvalidArgument, fmt::format("version {} is not newer than {}, which is kept in '{}'",
                                                  blob.version, kept.version, folder_.string()));
}

// The record is what counts: without it the new file is one that nobody names.
Status KeptCheckpoints::Keep(const bus::PublishedBlob& blob) {
  if (!IsPlainName(blob.channel) || blob.owner != run_.id)
    return Fail(Code::kInvalidArgument, fmt::format("channel '{}' of {} is none of run {}", Printable(blob.channel),
                                                    Printable(blob.owner), run_.partition()));
  if (blob.meta_json.size() > kLargestMetadata)
    return Fail(Code::kInvalidArgument,
                fmt::format("its metadata has {} bytes, at most {} are kept", blob.meta_json.size(), kLargestMetadata));
  ETUDE_RETURN_IF_ERROR(CheckVersion(blob));
  const auto found = channels_.find(blob.channel);
  if (found != channels_.end() && found->second.version == blob.version && found->second.whole) return {};
  Kept fresh{blob.version, blob.sha256, blob.meta_json, FileNameOf(blob.channel, blob.version)};
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(folder_ / fresh.file, blob.bytes));
  auto channels = channels_;
  channels[blob.channel] = std::move(fresh);
  ETUDE_RETURN_IF_ERROR(WriteRecord(channels));
  channels_ = std::move(channels);
  RemoveOthers();
  return {};
}

// The record first: what it names must be there.
Status KeptCheckpoints::Forget(const std::string& channel) {
  auto channels = channels_;
  const auto forgotten = channels.extract(channel);
  if (!forgotten) return {};
  // It may be the only copy of a run that has gone, and the key the wrong one: it has another name before the record
  // forgets this one.
  const Path file = folder_ / forgotten.mapped().file, aside = folder_ / ("refused-" + forgotten.mapped().file);
  std::error_code error;
  std::filesystem::create_hard_link(file, aside, error);
  if (error == std::errc::operation_not_permitted || error == std::errc::operation_not_supported ||
      error == std::errc::function_not_supported)
    std::filesystem::copy_file(file, aside, std::filesystem::copy_options::overwrite_existing, error);
  if (error && error != std::errc::no_such_file_or_directory && error != std::errc::file_exists)
    return Fail(ErrnoError("set aside", file, error.value()));
  ETUDE_RETURN_IF_ERROR(WriteRecord(channels));
  channels_ = std::move(channels);
  RemoveOthers();
  return {};
}

Status KeptCheckpoints::WriteRecord(const std::map<std::string, Kept>& channels) const {
  OrderedJson list = OrderedJson::object();
  for (const auto& [channel, kept] : channels)
    list[channel] = {{"version", kept.version}, {"sha256", kept.sha256}, {"meta_json", kept.meta_json}};
  const OrderedJson json{{"run", run_.name}, {"run_id", run_.id}, {"user", user_}, {"channels", std::move(list)}};
  return WriteFileAtomically(folder_ / kRecord, JsonText(json, 1) + "\n");
}

// Versions that newer ones replaced, and what a killed process left half written. Files of other names are not ours.
void KeptCheckpoints::RemoveOthers() const {
  const auto is_kept = [&](const std::string& name) {
    return std::ranges::any_of(channels_, [&](const auto& item) { return item.second.file == name; });
  };
  std::vector<Path> found;
  std::error_code error;
  for (const auto& item : std::filesystem::directory_iterator(folder_, error)) {
    const std::string name = item.path().filename().string();
    const bool half_written = name.starts_with(std::string(kRecord) + ".tmp-");
    if (half_written || (name.starts_with(kFilePrefix) && !is_kept(name))) found.push_back(item.path());
  }
  for (const auto& path : found) std::filesystem::remove(path, error);
}

Result<std::vector<std::uint8_t>> KeptCheckpoints::Read(const std::string& channel) {
  const auto found = channels_.find(channel);
  if (found == channels_.end())
    return Fail(Code::kNotFound, fmt::format("no checkpoint of channel '{}' is kept", channel));
  auto bytes = ReadVerified(folder_ / found->second.file, found->second);
  if (!bytes && bytes.error().code != Code::kUnavailable) found->second.whole = false;
  return bytes;
}

}  // namespace etude::relay
