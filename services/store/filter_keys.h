// SPDX-License-Identifier: Apache-2.0
// Episodes that someone picked, by a name: DATASET/filters.json, {"keep": [1, 5, 9]}. The master file has each as a
// filter key (/mask/<name>), which robomimic's training and our commands take.
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>

#include "services/core/file.h"
#include "services/core/result.h"

namespace etude::store {

/// Name -> indices of episodes.
using FilterKeys = std::map<std::string, std::set<std::uint64_t>>;

/// None where the dataset has no such file. @error kCorrupt with what is wrong; kUnavailable
Result<FilterKeys> ReadFilterKeys(const Path& dataset);

/// Gives a key these episodes (none: removes it), and rewrites the master file. Durable when it returns.
/// @error kInvalidArgument: not a plain name, a name that splits or tasks have, an episode that is not there; kNotFound
/// of the dataset; kUnavailable: another process writes the dataset; kCorrupt
Status WriteFilterKey(const Path& dataset, const std::string& name, const std::set<std::uint64_t>& indices);

}  // namespace etude::store
