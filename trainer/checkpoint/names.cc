// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/names.h"

#include <fmt/format.h>

#include <cctype>

namespace etude::checkpoint {

namespace fs = std::filesystem;

std::string RunNameOf(const Path& folder) {
  std::string name = fs::absolute(folder).lexically_normal().filename().string();
  if (name.empty()) name = fs::absolute(folder).lexically_normal().parent_path().filename().string();
  for (char& c : name) {
    c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    if (!std::isalnum(static_cast<unsigned char>(c)) && c != '_') c = '-';
  }
  name = name.substr(0, 64);
  return name.empty() ? "run" : name;
}

Path FileNameOf(std::uint64_t step) { return fmt::format("{:08}.safetensors", step); }

Path LinkOf(const Path& folder, const std::string& channel) { return folder / (channel + ".safetensors"); }

}  // namespace etude::checkpoint
