// SPDX-License-Identifier: Apache-2.0
// The number of a checkpoint's layout. It grows when a reader of the number before would read a file wrongly; a new
// key of a policy whose default means what was before does not. Older files become today's here and nowhere else.
//   1  the first one: the whole configuration and its hash; rotations as sines and cosines of Euler angles
//   2  the configuration as far as it differs from the defaults; modules' records, embodiment
#pragma once

#include <map>
#include <string>

#include "services/core/config.h"
#include "services/core/result.h"
#include "trainer/policy/torch.h"

namespace etude::checkpoint {

inline constexpr int kSchema = 2;

/// "etude checkpoint 2".
std::string FormatOf(int schema);

/// @error kCorrupt: not a checkpoint; kInvalidArgument: a schema newer than kSchema.
Result<int> SchemaOf(const std::map<std::string, std::string>& text);

/// The map that metadata `text` has under `key`. @error kCorrupt: there is none, no JSON map, or one nested too deeply.
Result<OrderedJson> ReadMap(const std::map<std::string, std::string>& text, const char* key);

/// Makes metadata and tensors of `schema` those of kSchema. @error kCorrupt: by key.
Status Upgrade(int schema, std::map<std::string, std::string>& text, std::map<std::string, torch::Tensor>& tensors);

}  // namespace etude::checkpoint
