// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/names.h"

#include <fmt/format.h>

namespace etude::checkpoint {

Path FileNameOf(std::uint64_t step) { return fmt::format("{:08}.safetensors", step); }

bool IsFileName(const Path& name) {
  const std::string step = name.stem().string();
  return name.extension() == ".safetensors" && step.size() >= 8 &&
         step.find_first_not_of("0123456789") == std::string::npos;
}

Path LinkOf(const Path& folder, const std::string& channel) { return folder / (channel + ".safetensors"); }

}  // namespace etude::checkpoint
