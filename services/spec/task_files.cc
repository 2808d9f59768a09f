// SPDX-License-Identifier: Apache-2.0
#include "services/spec/task_files.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "services/spec/task_name.h"

namespace etude {

std::vector<std::string> TaskFilesOf(const CampaignSpec& spec) {
  std::vector<std::string> files;
  for (const auto& name : spec.tasks) {
    const std::string base = name.substr(0, IsTaskPath(name) ? std::string::npos : name.rfind('+'));
    if (IsTaskPath(base) && std::ranges::find(files, base) == files.end()) files.push_back(base);
  }
  return files;
}

std::string WhyHashDiffers(const CampaignSpec& spec) {
  const auto files = TaskFilesOf(spec);
  if (files.empty()) return "its spec has another hash in this version, which knows other keys";
  return fmt::format("its spec has another hash here: '{}' {} not what {} then (or this version knows other keys)",
                     fmt::join(files, "', '"), files.size() > 1 ? "are" : "is",
                     files.size() > 1 ? "they were" : "it was");
}

}  // namespace etude
