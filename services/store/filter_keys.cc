// SPDX-License-Identifier: Apache-2.0
#include "services/store/filter_keys.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>

#include "services/episode/bounded_json.h"
#include "services/store/edit.h"
#include "services/store/layout.h"
#include "services/store/master_file.h"

namespace etude::store {
namespace {

constexpr std::uint64_t kMaxKeysFile = 64 << 20;

bool ParseNumber(std::string_view text, std::uint64_t& number) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  return error == std::errc() && end == text.data() + text.size() && !text.empty();
}

}  // namespace

Result<FilterKeys> ReadFilterKeys(const Path& dataset) {
  const Path path = dataset / internal::kFilters;
  ETUDE_ASSIGN_OR_RETURN(const auto text, ReadTextFileIfThere(path, kMaxKeysFile));
  if (!text) return FilterKeys();
  const auto bad = [&](const std::string& what) {
    return Fail(Code::kCorrupt, fmt::format("read '{}': {}; mend it or remove it", path.string(), what));
  };
  const auto json = ParseBoundedJson(*text);
  if (!json || !json->is_object()) return bad("not a map of names");
  FilterKeys keys;
  for (const auto& [name, indices] : json->items()) {
    if (!IsPlainName(name) || !indices.is_array()) return bad(fmt::format("'{:.64}' is no key with a list", name));
    for (const auto& index : indices) {
      if (!index.is_number_unsigned()) return bad(fmt::format("key '{}' lists what is no episode", name));
      keys[name].insert(index.get<std::uint64_t>());
    }
  }
  return keys;
}

Status WriteFilterKey(const Path& dataset, const std::string& name, const std::set<std::uint64_t>& indices) {
  ETUDE_ASSIGN_OR_RETURN(const auto reader, DatasetReader::Open(dataset));
  if (!indices.empty()) ETUDE_RETURN_IF_ERROR(internal::CheckKeyName(reader.spec(), name));
  ETUDE_ASSIGN_OR_RETURN(const auto lock, internal::LockDataset(dataset));
  ETUDE_RETURN_IF_ERROR(internal::FinishDeletion(dataset));
  ETUDE_ASSIGN_OR_RETURN(const auto listed, reader.List());
  ETUDE_RETURN_IF_ERROR(internal::SetFilterKey(dataset, reader.spec(), name, indices, [&](std::uint64_t index) {
    return std::ranges::binary_search(listed, index);
  }));
  return internal::RefreshDerived(dataset);
}

Status AddIndices(std::string_view span, std::set<std::uint64_t>& indices, std::uint64_t most) {
  const auto dash = span.find('-');
  std::uint64_t first = 0, last = 0;
  const bool good = ParseNumber(span.substr(0, dash), first) &&
                    ParseNumber(span.substr(dash == std::string_view::npos ? 0 : dash + 1), last);
  if (!good || last < first || indices.size() > most || last - first >= most - indices.size())
    return Fail(Code::kInvalidArgument,
                fmt::format("'{:.60}': give numbers of episodes, 7 or 4-9, at most {} in all", span, most));
  // counted from the first: the last may be the largest number that there is
  for (std::uint64_t n = 0; n <= last - first; ++n) indices.insert(first + n);
  return {};
}

std::string IndicesText(const std::set<std::uint64_t>& indices) {
  std::string text;
  for (auto at = indices.begin(); at != indices.end();) {
    const std::uint64_t first = *at;
    std::uint64_t last = first;
    for (++at; at != indices.end() && *at == last + 1; ++at) last = *at;
    if (!text.empty()) text += ',';
    text += first == last ? std::to_string(first) : fmt::format("{}-{}", first, last);
  }
  return text;
}

Result<std::set<std::uint64_t>> ParseIndices(std::string_view text, std::uint64_t most) {
  std::set<std::uint64_t> indices;
  while (!text.empty()) {
    const auto comma = text.find(',');
    ETUDE_RETURN_IF_ERROR(AddIndices(text.substr(0, comma), indices, most));
    if (comma == std::string_view::npos) break;
    text.remove_prefix(comma + 1);
  }
  return indices;
}

namespace internal {

Status CheckKeyName(const CampaignSpec& spec, const std::string& name) {
  if (!IsPlainName(name))
    return Fail(Code::kInvalidArgument,
                fmt::format("filter key '{}': a name has only a-z, 0-9, _ and -, at most 64 of them", name));
  if (IsLanguageMask(name))
    return Fail(
        Code::kInvalidArgument,
        fmt::format("filter key '{}': sentences of an exported file have keys of such names; choose another", name));
  bool taken = name == "train" || name == "valid" || name == "test";
  for (const auto& task : spec.tasks) taken = taken || MaskOfTask(task) == name;
  if (taken)
    return Fail(Code::kInvalidArgument,
                fmt::format("filter key '{}': splits and tasks have keys of their own names; choose another", name));
  return {};
}

Status WriteFilterKeys(const Path& dataset, const FilterKeys& keys) {
  OrderedJson json = OrderedJson::object();
  for (const auto& [name, indices] : keys) json[name] = indices;
  return WriteFileAtomically(dataset / kFilters, json.dump() + "\n");
}

Status SetFilterKey(const Path& dataset, const CampaignSpec& spec, const std::string& name,
                    const std::set<std::uint64_t>& indices, const std::function<bool(std::uint64_t)>& there) {
  if (!indices.empty()) ETUDE_RETURN_IF_ERROR(CheckKeyName(spec, name));
  for (const std::uint64_t index : indices)
    if (!there(index))
      return Fail(Code::kInvalidArgument,
                  fmt::format("filter key '{}': dataset '{}' has no episode {}", name, dataset.string(), index));
  ETUDE_ASSIGN_OR_RETURN(auto keys, ReadFilterKeys(dataset));
  keys.erase(name);
  if (!indices.empty()) keys[name] = indices;
  return WriteFilterKeys(dataset, keys);
}

Status ForgetEpisodes(const Path& dataset, const std::set<std::uint64_t>& indices) {
  ETUDE_ASSIGN_OR_RETURN(auto keys, ReadFilterKeys(dataset));
  if (keys.empty()) return {};
  for (auto& [name, chosen] : keys) std::erase_if(chosen, [&](std::uint64_t index) { return indices.contains(index); });
  std::erase_if(keys, [](const auto& key) { return key.second.empty(); });
  return WriteFilterKeys(dataset, keys);
}

}  // namespace internal

}  // namespace etude::store
