// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/sources/catalog.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <deque>
#include <functional>
#include <map>
#include <tuple>
#include <utility>

#include "services/core/hash.h"

namespace etude::sources {
namespace {

constexpr int kDeepest = 5;  // folders below a root
constexpr std::size_t kMostFound = 1'000;
constexpr std::chrono::seconds kScanEvery{3};
// what holds many files and nothing that is looked for; and, below what was found, what only holds its own files
constexpr std::array<std::string_view, 4> kClosed{"videos", "quarantine", "objects", "node_modules"};
constexpr std::array<std::string_view, 2> kClosedBelow{"episodes", "checkpoints"};

std::string WithHash(const std::string& id, const std::string& shown) {
  return id + "-" + Sha256Hex(shown).substr(0, 8);
}

// Where a character had to go, "a b" would be called as "a_b" is.
std::string IdOf(const std::string& shown) {
  std::string id;
  bool same = true;
  for (const char c : shown) {
    const bool plain = std::isalnum(static_cast<unsigned char>(c)) || c == '-' || c == '_' || c == '.';
    same = same && (plain || c == '/');
    id += c == '/' ? '.' : plain ? c : '_';
  }
  return same ? id : WithHash(id, shown);
}

// What people call each -> its id. Of "a.b" and "a/b", which would have one, neither has it: with what comes later no
// id goes to another folder.
std::map<std::string, std::string> IdsOf(const std::vector<std::string>& all_shown) {
  std::map<std::string, int> wanted;
  for (const auto& shown : all_shown) ++wanted[IdOf(shown)];
  std::map<std::string, std::string> ids;
  for (const auto& shown : all_shown) {
    const std::string id = IdOf(shown);
    ids[shown] = wanted.at(id) > 1 ? WithHash(id, shown) : id;
  }
  return ids;
}

// `wanted`, else with the first number behind it that `take` takes: "out", "out-2".
template <class Take>
std::string Unique(const std::string& wanted, Take&& take) {
  std::string name = wanted;
  for (int n = 2; !take(name); ++n) name = fmt::format("{}-{}", wanted, n);
  return name;
}

bool Has(const Path& folder, const char* file) {
  std::error_code error;
  return std::filesystem::is_regular_file(folder / file, error);
}

// Of the files that grow or are written anew while something is made, and of the folder of its episodes.
double ChangedOf(const Path& folder) {
  double newest = 0;
  for (const char* name : {"dataset.json", "commits.jsonl", "attempts.jsonl", "episodes", "metrics.jsonl",
                           "checkpoints", "config.yaml", "eval.json", "eval.jsonl"}) {
    struct stat status {};
    if (::stat((folder / name).c_str(), &status) != 0) continue;
    newest = std::max(newest,
                      static_cast<double>(status.st_mtim.tv_sec) + 1e-9 * static_cast<double>(status.st_mtim.tv_nsec));
  }
  return newest;
}

std::optional<Kind> KindOf(const Path& folder) {
  if (Has(folder, "dataset.json")) return Kind::kDataset;
  if (Has(folder, "eval.json") || Has(folder / "rollouts", "dataset.json")) return Kind::kEval;
  std::error_code error;
  if (Has(folder, "metrics.jsonl") || (Has(folder, "config.yaml") && Has(folder, "identity.json")) ||
      (std::filesystem::is_directory(folder / "checkpoints", error) && Has(folder, "config.yaml")))
    return Kind::kRun;
  return std::nullopt;
}

// Looks through one root, folders that lie higher first. Until GiveIds, what people call them stands for ids.
class Search {
 public:
  Search(std::vector<Found>& found, std::vector<Catalog::LogFile>& logs, const Path& left_out, std::size_t most_entries)
      : found_(found), logs_(logs), left_out_(left_out), most_entries_(most_entries) {}

  /// @param name  what people call it; another than the other roots have
  /// @returns false when there was more in it than is looked at
  bool Root(const Path& root, const std::string& name) {
    std::deque<Step> open{{root, name, "", 0}};
    std::size_t entries = 0;
    while (!open.empty() && entries < most_entries_ && found_.size() < kMostFound) {
      const Step step = std::move(open.front());
      open.pop_front();
      const std::size_t before = found_.size();
      const std::string eval = Note(step);
      if (step.depth < kDeepest) entries += Enter(step, eval, found_.size() > before, open);
    }
    return open.empty() && entries < most_entries_;
  }

  /// After the last root.
  void GiveIds() {
    std::vector<std::string> shown;
    for (const auto& item : found_) shown.push_back(item.shown);
    const auto ids = IdsOf(shown);
    for (auto& item : found_) {
      item.id = ids.at(item.shown);
      if (!item.eval.empty()) item.eval = ids.at(item.eval);
    }
    shown.clear();
    for (const auto& log : logs_) shown.push_back(log.id);
    const auto log_ids = IdsOf(shown);
    for (auto& log : logs_) log.id = log_ids.at(log.id);
  }

 private:
  struct Step {
    Path folder;
    std::string shown, eval;  // eval: of which this folder is the rollouts
    int depth = 0;
  };

  // returns what it is called when it is an evaluation
  std::string Note(const Step& step) {
    const auto kind = KindOf(step.folder);
    if (!kind) return "";
    found_.push_back({*kind, "", step.folder.filename().string(), step.folder, step.shown,
                      *kind == Kind::kDataset ? step.eval : "", ChangedOf(step.folder)});
    return *kind == Kind::kEval ? step.shown : "";
  }

  // found: the folder itself is one that was looked for
  std::size_t Enter(const Step& step, const std::string& eval, bool found, std::deque<Step>& open) {
    const bool logs = found || step.folder.filename() == "logs";  // files that end in .log are ours
    std::vector<Path> folders;
    std::size_t entries = 0;
    std::error_code error;
    std::filesystem::directory_iterator it(step.folder, error), end;
    for (; !error && it != end && entries < most_entries_; it.increment(error), ++entries) {
      const std::string name = it->path().filename().string();
      std::error_code ignored;
      if (name.starts_with('.') || it->is_symlink(ignored) || it->path() == left_out_) continue;
      if (it->is_directory(ignored)) {
        const bool closed = std::ranges::find(kClosed, name) != kClosed.end() ||
                            (found && std::ranges::find(kClosedBelow, name) != kClosedBelow.end());
        if (!closed) folders.push_back(it->path());
      } else if (logs && name.ends_with(".log") && logs_.size() < kMostFound) {
        logs_.push_back({step.shown + "/" + name, step.folder, name});
      }
    }
    std::ranges::sort(folders);
    for (auto& folder : folders) {
      const std::string name = folder.filename().string();
      open.push_back({std::move(folder), step.shown + "/" + name, name == "rollouts" ? eval : "", step.depth + 1});
    }
    return entries;
  }

  std::vector<Found>& found_;
  std::vector<Catalog::LogFile>& logs_;
  const Path& left_out_;
  const std::size_t most_entries_;
};

// Of each root its own, by which its folders keep their ids whatever comes to the others: "out", "out-2".
std::vector<std::string> NamesOf(const std::vector<Path>& roots) {
  std::vector<std::string> names;
  for (const auto& root : roots) {
    const Path own = root.filename().empty() ? root.parent_path().filename() : root.filename();
    names.push_back(
        Unique(own.string(), [&](const std::string& name) { return std::ranges::find(names, name) == names.end(); }));
  }
  return names;
}

std::vector<Path> Canonical(const std::vector<Path>& roots) {
  std::vector<Path> canonical;
  for (const auto& root : roots) {
    std::error_code error;
    Path path = std::filesystem::canonical(root, error);
    // one that is not there yet may come
    canonical.push_back(error ? std::filesystem::absolute(root).lexically_normal() : path);
  }
  return canonical;
}

// Also of one that is made later.
Path CanonicalOf(const Path& folder) {
  if (folder.empty()) return folder;
  std::error_code error;
  const Path path = std::filesystem::weakly_canonical(std::filesystem::absolute(folder), error);
  return error ? std::filesystem::absolute(folder).lexically_normal() : path;
}

}  // namespace

std::string ToString(Kind kind) {
  switch (kind) {
    case Kind::kDataset:
      return "dataset";
    case Kind::kRun:
      return "run";
    case Kind::kEval:
      break;
  }
  return "eval";
}

Catalog::Catalog(std::vector<Path> roots, const Path& left_out, std::size_t most_entries)
    : roots_(Canonical(roots)),
      names_(NamesOf(roots_)),
      left_out_(CanonicalOf(left_out)),
      most_entries_(most_entries) {}

void Catalog::Scan() {
  const auto now = MonotonicClock::now();
  if (found_ && now - scanned_ < kScanEvery) return;
  auto found = std::make_shared<std::vector<Found>>();
  auto logs = std::make_shared<std::vector<LogFile>>();
  Search search(*found, *logs, left_out_, most_entries_);
  not_searched_.clear();
  for (std::size_t i = 0; i < roots_.size(); ++i)
    if (!search.Root(roots_[i], names_[i])) not_searched_.push_back(roots_[i]);
  search.GiveIds();
  std::ranges::sort(*found, {}, [](const Found& item) { return std::tie(item.kind, item.id); });
  found_ = std::move(found);
  logs_ = std::move(logs);
  scanned_ = now;
}

std::shared_ptr<const std::vector<Found>> Catalog::List() {
  MutexLock lock(mutex_);
  Scan();
  return found_;
}

Catalog::Newest Catalog::NewestOf(Kind kind, std::size_t most, Role role) {
  const auto all = List();
  Newest newest;
  for (const auto& item : *all)
    if (item.kind == kind && (role == Role::kAny || (role == Role::kDemonstrations) == item.eval.empty()))
      newest.found.push_back(item);
  std::ranges::stable_sort(newest.found, std::greater<>(), &Found::changed);
  if (newest.found.size() > most) {
    newest.more = newest.found.size() - most;
    newest.found.resize(most);
  }
  return newest;
}

std::shared_ptr<const std::vector<Catalog::LogFile>> Catalog::Logs() {
  MutexLock lock(mutex_);
  Scan();
  return logs_;
}

std::vector<Path> Catalog::NotSearched() {
  MutexLock lock(mutex_);
  Scan();
  return not_searched_;
}

Result<Found> Catalog::Find(Kind kind, const std::string& id) {
  const auto found = List();
  for (const auto& item : *found)
    if (item.kind == kind && item.id == id) return item;
  std::string known;
  for (const auto& item : *found)
    if (item.kind == kind && known.size() < 300) known += (known.empty() ? "" : ", ") + item.id;
  return Fail(Code::kNotFound, fmt::format("there is no {} '{:.100}'; there are: {}", ToString(kind), id,
                                           known.empty() ? "none" : known));
}

}  // namespace etude::sources
