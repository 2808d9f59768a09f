// SPDX-License-Identifier: Apache-2.0
// Episodes that someone picked, by a name: DATASET/filters.json, {"keep": [1, 5, 9]}. The master file has each as a
// filter key (/mask/<name>), which robomimic's training and our commands take.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <string_view>

#include "services/core/file.h"
#include "services/core/result.h"
#include "services/spec/campaign_spec.h"

namespace etude::store {

/// Name -> indices of episodes.
using FilterKeys = std::map<std::string, std::set<std::uint64_t>>;

/// None where the dataset has no such file. @error kCorrupt with what is wrong; kUnavailable
Result<FilterKeys> ReadFilterKeys(const Path& dataset);

/// Gives a key these episodes (none: removes it), and rewrites the master file. Durable when it returns.
/// @error kInvalidArgument: not a plain name, a name that splits or tasks have, an episode that is not there; kNotFound
/// of the dataset; kUnavailable: another process writes the dataset (DatasetWriter::WriteFilterKey is for that one);
/// kCorrupt
Status WriteFilterKey(const Path& dataset, const std::string& name, const std::set<std::uint64_t>& indices);

inline constexpr std::uint64_t kMostIndices = 10'000'000;

/// Adds "7" or "4-9". @error kInvalidArgument: it is neither, or there would be more than `most`
Status AddIndices(std::string_view span, std::set<std::uint64_t>& indices, std::uint64_t most = kMostIndices);
/// "0-3,7": indices as messages and command lines have them. Its inverse takes spans in any order.
std::string IndicesText(const std::set<std::uint64_t>& indices);
/// @error as AddIndices
Result<std::set<std::uint64_t>> ParseIndices(std::string_view text, std::uint64_t most = kMostIndices);

namespace internal {

/// @error kInvalidArgument: not a plain name, a name that splits or tasks of the spec have
Status CheckKeyName(const CampaignSpec& spec, const std::string& name);
/// filters.json, whole. Durable. @pre the dataset's lock is held, or the folder is nobody else's
Status WriteFilterKeys(const Path& dataset, const FilterKeys& keys);
/// What WriteFilterKey does to filters.json; the master file is the caller's to rewrite. @pre the dataset's lock is
/// held
/// @param there  whether the dataset has an episode   @error as WriteFilterKey
Status SetFilterKey(const Path& dataset, const CampaignSpec& spec, const std::string& name,
                    const std::set<std::uint64_t>& indices, const std::function<bool(std::uint64_t)>& there);

}  // namespace internal

}  // namespace etude::store
