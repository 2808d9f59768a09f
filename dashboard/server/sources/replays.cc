// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/sources/replays.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>

#include "dashboard/server/sources/bounded_folder.h"
#include "services/core/hash.h"
#include "services/core/identity.h"

namespace etude::sources {
namespace {

constexpr std::size_t kKeyDigits = 32;
constexpr std::chrono::hours kAbandoned{1};  // none takes that long

bool IsKey(const std::string& text) {
  return text.size() == kKeyDigits && text.find_first_not_of("0123456789abcdef") == std::string::npos;
}

}  // namespace

std::string Replays::KeyOf(const std::vector<std::string>& what) {
  std::string all;
  // with their lengths: two lists never make one text
  for (const auto& part : what) all += fmt::format("{}:{}\n", part.size(), part);
  return Sha256Hex(all).substr(0, kKeyDigits);
}

std::optional<std::string> Replays::KeyIn(const std::string& id) {
  const std::string prefix = IdOf("");
  if (!id.starts_with(prefix)) return std::nullopt;
  std::string key = id.substr(prefix.size());
  return IsKey(key) ? std::optional(std::move(key)) : std::nullopt;
}

bool Replays::Has(const std::string& key, const char* file) const {
  const Path place = folder_ / key;
  std::error_code error;
  return !folder_.empty() && IsKey(key) && !std::filesystem::is_symlink(place, error) &&
         std::filesystem::is_regular_file(place / "plan.json", error) &&
         std::filesystem::is_regular_file(place / file, error);
}

bool Replays::HasEpisode(const std::string& key) const { return Has(key, "dataset.json"); }

Result<Path> Replays::Find(const std::string& key) const {
  if (!Has(key, "plan.json"))
    return Fail(Code::kNotFound, "this attempt was not made again, or that was long ago: make it once more");
  Path place = folder_ / key;
  MarkUsed(place);
  return place;
}

Result<Found> Replays::FindDataset(const std::string& key) const {
  ETUDE_ASSIGN_OR_RETURN(const Path place, Find(key));
  if (!HasEpisode(key)) return Fail(Code::kNotFound, "this attempt ended before anything moved: it has no episode");
  return Found{Kind::kDataset, IdOf(key), "replay", place, place.string(), "", 0};
}

Path Replays::NewPlace(const std::string& key) const { return folder_ / fmt::format(".{}-{}", key, NewId()); }

Status Replays::Keep(const Path& place, const std::string& key) const {
  std::error_code error;
  std::filesystem::rename(place, folder_ / key, error);
  if (!error) return {};
  Discard(place);
  if (Find(key)) return {};
  return Fail(Code::kUnavailable, fmt::format("keep a replay in '{}': {}", folder_.string(), error.message()));
}

void Replays::Discard(const Path& place) {
  std::error_code ignored;
  std::filesystem::remove_all(place, ignored);
}

void Replays::Trim(const std::string& keep) const {
  const auto now = std::filesystem::file_time_type::clock::now();
  TrimFolder(folder_, 0, "", [&](const Path& entry) {
    std::error_code error;
    return entry.filename().string().starts_with('.') &&
           now - std::filesystem::last_write_time(entry, error) > kAbandoned && !error;
  });
  TrimFolder(folder_, most_bytes_, folder_ / keep, [](const Path& entry) { return IsKey(entry.filename().string()); });
}

}  // namespace etude::sources
