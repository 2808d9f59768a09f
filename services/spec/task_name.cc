// SPDX-License-Identifier: Apache-2.0
#include "services/spec/task_name.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "services/core/config.h"
#include "services/core/share.h"
#include "services/core/thread_annotations.h"

namespace etude {
namespace {

using Task = std::shared_ptr<const TaskSpec>;
using Tasks = std::map<std::string, Task>;

Result<Tasks> ReadBuiltIn() {
  ETUDE_ASSIGN_OR_RETURN(const Path folder, FindShared("tasks"));
  Tasks tasks;
  std::error_code error;
  for (std::filesystem::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    const auto& entry = *it;
    if (entry.path().extension() != ".yaml") continue;
    ETUDE_ASSIGN_OR_RETURN(TaskSpec task, LoadTaskSpec(entry.path()));
    const std::string stem = entry.path().stem().string();
    if (task.name != stem)
      return Fail(Code::kInvalidArgument,
                  fmt::format("{}: name: '{}' must be the file's", entry.path().string(), task.name));
    tasks.emplace(stem, std::make_shared<const TaskSpec>(std::move(task)));
  }
  if (error) return Fail(ErrnoError("list", folder, error.value()));
  return tasks;
}

const Result<Tasks>& BuiltIn() {
  static const Result<Tasks> tasks = ReadBuiltIn();
  return tasks;
}

/// Users' files as they were read first: a campaign asks for each of its episodes, and they all mean the same.
class FileTasks {
 public:
  static FileTasks& Get() {
    static FileTasks tasks;
    return tasks;
  }
  Result<Task> Of(const std::string& path) {
    const MutexLock lock(mutex_);
    const auto it = read_.find(path);
    if (it != read_.end()) return it->second;
    ETUDE_ASSIGN_OR_RETURN(TaskSpec task, LoadTaskSpec(path));
    return read_.emplace(path, std::make_shared<const TaskSpec>(std::move(task))).first->second;
  }
  void Forget() {
    const MutexLock lock(mutex_);
    read_.clear();
  }

 private:
  Mutex mutex_;
  Tasks read_ ETUDE_GUARDED_BY(mutex_);
};

Error Unknown(const std::string& name, const std::vector<std::string>& known) {
  return {Code::kInvalidArgument, NotKnown(name, known) + ", or the path of a task file (.yaml)"};
}

}  // namespace

void ForgetTaskFiles() { FileTasks::Get().Forget(); }

bool IsTaskPath(const std::string& base) { return base.ends_with(".yaml"); }

std::vector<std::string> BaseTasks() {
  std::vector<std::string> names;
  if (!BuiltIn()) return names;
  for (const auto& [name, task] : *BuiltIn()) names.push_back(name);
  return names;
}

std::vector<std::string> KnownTasks() {
  std::vector<std::string> names = BaseTasks();
  if (!BuiltIn()) return names;
  for (const auto& [name, task] : *BuiltIn())
    for (const auto& variant : task->avoid) names.push_back(name + "+" + variant);
  return names;
}

Result<TaskName> ParseTask(const std::string& name) {
  const auto plus = name.rfind('+');
  const bool variant = plus != std::string::npos && !IsTaskPath(name);
  TaskName task{name.substr(0, variant ? plus : std::string::npos), variant ? name.substr(plus + 1) : "", nullptr};
  if (IsTaskPath(task.base)) {
    ETUDE_ASSIGN_OR_RETURN(task.spec, FileTasks::Get().Of(task.base));
  } else {
    if (!BuiltIn()) return Fail(BuiltIn().error());
    const auto it = BuiltIn()->find(task.base);
    if (it != BuiltIn()->end()) task.spec = it->second;
  }
  const auto has = [&](const std::string& avoid) { return std::ranges::count(task.spec->avoid, avoid) > 0; };
  if (task.spec && (task.avoid.empty() ? !variant : has(task.avoid))) return task;
  std::vector<std::string> known = KnownTasks();
  if (task.spec && IsTaskPath(task.base)) {
    known = {task.base};
    for (const auto& avoid : task.spec->avoid) known.push_back(task.base + "+" + avoid);
  }
  return Fail(Unknown(name, known));
}

}  // namespace etude
