// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/policy_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <set>

#include "services/core/share.h"
#include "trainer/policy/compose.h"

namespace etude::policy {
namespace {

namespace fs = std::filesystem;

constexpr int kMostExtensions = 8;  // of one policy's file by another

// "compact", "compact/obstacle"
std::vector<std::string> NamesIn(const Path& folder) {
  std::vector<std::string> names;
  std::error_code ignored;
  for (auto item = fs::recursive_directory_iterator(folder, ignored); item != fs::recursive_directory_iterator();
       item.increment(ignored)) {
    if (item->path().filename() == "policies") item.disable_recursion_pending();
    if (item->path().extension() == ".yaml")
      names.push_back(item->path().lexically_relative(folder).replace_extension());
  }
  std::sort(names.begin(), names.end());
  return names;
}

// A name that is misspelt would make one module more, which says nothing; two entries of a name would be one module.
Status CheckEntries(const OrderedJson& base, const OrderedJson& json, const Path& path) {
  std::vector<std::string> there;
  for (const auto& entry : ModuleEntries(base)) there.push_back(EntryName(entry));
  std::set<std::string> seen;
  for (const auto& entry : ModuleEntries(json)) {
    const std::string name = EntryName(entry);
    if (name.empty()) continue;  // whoever reads the graph says what is wrong
    if (!seen.insert(name).second)
      return Fail(Code::kInvalidArgument, fmt::format("{}: modules: '{}' stands twice", path.string(), name));
    if (!entry.contains("level") && std::ranges::find(there, name) == there.end())
      return Fail(Code::kInvalidArgument, fmt::format("{}: what it extends has no module '{}' to give more to, and "
                                                      "without a level it makes none{}",
                                                      path.string(), name, Suggestion(name, there)));
  }
  return {};
}

Result<OrderedJson> ReadExtended(const std::string& name, const std::vector<Path>& folders, int depth) {
  if (depth > kMostExtensions)
    return Fail(Code::kInvalidArgument,
                fmt::format("policy '{}': extends itself, or more than {} others", name, kMostExtensions));
  ETUDE_ASSIGN_OR_RETURN(const Path path, FindNamedFile(name, folders, "policy"));
  ETUDE_ASSIGN_OR_RETURN(auto json, ReadYamlMap(path));
  if (!json.is_object() || !json.contains("extends")) return json;
  if (!json["extends"].is_string())
    return Fail(Code::kInvalidArgument, fmt::format("{}: extends: must be the name of a policy", path.string()));
  std::vector<Path> nearest{path.parent_path()};
  nearest.insert(nearest.end(), folders.begin(), folders.end());
  ETUDE_ASSIGN_OR_RETURN(const auto base, ReadExtended(json["extends"].get<std::string>(), nearest, depth + 1));
  json.erase("extends");
  ETUDE_RETURN_IF_ERROR(CheckEntries(base, json, path));
  return Compose(base, json);
}

}  // namespace

Result<Path> FindExperiments(const std::string& share, const Path& executable) {
  std::error_code ignored;
  if (!share.empty()) {
    // of a source tree it is deploy/, beside which trainer/ lies
    for (const char* name : {"experiments", "../trainer/experiments"})
      if (const Path folder = (Path(share) / name).lexically_normal(); fs::is_directory(folder, ignored)) return folder;
    return Fail(Code::kNotFound, fmt::format("ETUDE_SHARE is '{}', which has no folder 'experiments'", share));
  }
  for (Path folder = fs::absolute(executable, ignored).parent_path();; folder = folder.parent_path()) {
    for (const char* name : {"trainer/experiments", "share/etude/experiments"})
      if (fs::is_directory(folder / name, ignored)) return folder / name;
    if (folder == folder.parent_path()) break;
  }
  return Fail(Code::kNotFound,
              fmt::format("no trainer/experiments above '{}': set ETUDE_SHARE to the folder that has 'experiments'",
                          executable.string()));
}

Result<Path> FindExperiments() {
  const char* share = std::getenv("ETUDE_SHARE");
  return FindExperiments(share ? share : "", ProgramFile());
}

Result<Path> FindNamedFile(const std::string& name_or_file, const std::vector<Path>& folders, const std::string& what) {
  std::error_code ignored;
  if (fs::is_regular_file(name_or_file, ignored)) return Path(name_or_file);
  for (const auto& folder : folders) {
    const Path path = folder / (name_or_file + ".yaml");
    if (fs::is_regular_file(path, ignored)) return path;
  }
  // only to say so: a user's folder may have datasets in it
  std::vector<std::string> known;
  for (const auto& folder : folders)
    for (auto& name : NamesIn(folder)) known.push_back(std::move(name));
  const std::string nearest = NearestMatch(name_or_file, known);
  return Fail(Code::kInvalidArgument, fmt::format("{} '{}': neither a file nor a name{}; names: {}", what, name_or_file,
                                                  nearest.empty() ? "" : fmt::format(" (did you mean '{}'?)", nearest),
                                                  fmt::join(known, ", ")));
}

Result<OrderedJson> ReadYamlMap(const Path& path) {
  ETUDE_ASSIGN_OR_RETURN(const std::string text, ReadTextFile(path, 1 << 20));
  ETUDE_ASSIGN_OR_RETURN(auto json, ParseYaml(text, path.string()));
  if (json.is_null()) json = OrderedJson::object();
  if (!json.is_object())
    return Fail(Code::kInvalidArgument,
                fmt::format("{}: its top level is no map of keys ({})", path.string(), json.type_name()));
  return json;
}

void WriteOutLanguage(OrderedJson& policy) {
  if (!policy.is_object() || !policy.contains("language") || !policy["language"].is_string()) return;
  policy["language"] = {{"encoder", policy["language"]}};
}

Result<OrderedJson> ReadPolicyMap(const std::string& name_or_file, const std::vector<Path>& folders) {
  ETUDE_ASSIGN_OR_RETURN(auto json, ReadExtended(name_or_file, folders, 0));
  WriteOutLanguage(json);
  return json;
}

}  // namespace etude::policy
