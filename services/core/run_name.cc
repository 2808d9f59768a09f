// SPDX-License-Identifier: Apache-2.0
#include "services/core/run_name.h"

#include <cctype>
#include <filesystem>

#include "services/core/check.h"
#include "services/core/log.h"

namespace etude {
namespace {

namespace fs = std::filesystem;

Path NameFileOf(const Path& folder) { return folder / "name"; }

}  // namespace

std::string PlainNameOf(const Path& folder) {
  std::string name = fs::absolute(folder).lexically_normal().filename().string();
  if (name.empty()) name = fs::absolute(folder).lexically_normal().parent_path().filename().string();
  for (char& c : name) {
    c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    if (!std::isalnum(static_cast<unsigned char>(c)) && c != '_') c = '-';
  }
  name = name.substr(0, 64);
  return name.empty() ? "run" : name;
}

std::string RunNameOf(const Path& folder) {
  auto kept = ReadTextFile(NameFileOf(folder), 1 << 10);
  if (!kept) return PlainNameOf(folder);
  while (!kept->empty() && std::isspace(static_cast<unsigned char>(kept->back()))) kept->pop_back();
  return IsPlainName(*kept) ? *kept : PlainNameOf(folder);
}

Status KeepRunName(const Path& folder, const std::string& name) {
  ETUDE_CHECK(IsPlainName(name), "'{}'", name);
  const std::string text = name + "\n";
  if (const auto kept = ReadTextFile(NameFileOf(folder), 1 << 10); kept && *kept == text) return {};
  return WriteFileAtomically(NameFileOf(folder), text);
}

Result<Selector> ParseRun(const std::string& text, std::string_view what) {
  auto selector = ParseSelector(text, what);
  std::error_code error;
  if (!fs::is_directory(text, error)) return selector;
  const auto identity = ReadIdentity(text);
  if (!selector) {
    if (!identity) return Fail(identity.error());
    return Selector{RunNameOf(text), identity->id};
  }
  // "run" may be a name, and the folder of a run that is called otherwise
  const std::string name = RunNameOf(text);
  if (!identity || name == text || text.find('@') != std::string::npos) return selector;
  Log().info("{} '{}': the folder of run '{}', which is meant", what, text, name);
  return Selector{name, identity->id};
}

std::string CheckpointFile(const std::string& text) {
  const Path newest = Path(text) / "checkpoints" / "latest.safetensors";
  std::error_code error;
  return fs::is_directory(text, error) && fs::exists(newest, error) ? newest.string() : text;
}

}  // namespace etude
