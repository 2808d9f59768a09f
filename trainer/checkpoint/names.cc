// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/names.h"

#include <fmt/format.h>

namespace etude::checkpoint {

Path FileNameOf(std::uint64_t step) { return fmt::format("{:08}.safetensors", step); }

Path LinkOf(const Path& folder, const std::string& channel) { return folder / (channel + ".safetensors"); }

}  // namespace etude::checkpoint
