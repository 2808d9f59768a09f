// SPDX-License-Identifier: Apache-2.0
#include "services/episode/task_name.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "services/core/config.h"

namespace etude {

const std::vector<std::string>& BaseTasks() {
  static const std::vector<std::string> tasks{"pick",       "push",        "put_down",    "rotate",
                                              "place_left", "place_right", "place_front", "place_behind"};
  return tasks;
}

const std::vector<std::string>& KnownTasks() {
  static const std::vector<std::string> known = [] {
    std::vector<std::string> names;
    for (const char* suffix : {"", "+obstacle", "+others"})
      for (const auto& base : BaseTasks())
        if (*suffix == '\0' || !TaskName{base, ""}.relation()) names.push_back(base + suffix);
    return names;
  }();
  return known;
}

Result<TaskName> ParseTask(const std::string& name) {
  const auto& known = KnownTasks();
  if (std::find(known.begin(), known.end(), name) == known.end()) {
    const std::string nearest = NearestMatch(name, known);
    return Fail(Code::kInvalidArgument, fmt::format("'{}' is not known{}; known: {}", name,
                                                    nearest.empty() ? "" : fmt::format(", did you mean '{}'?", nearest),
                                                    fmt::join(known, ", ")));
  }
  const auto plus = name.find('+');
  if (plus == std::string::npos) return TaskName{name, ""};
  return TaskName{name.substr(0, plus), name.substr(plus + 1)};
}

}  // namespace etude
