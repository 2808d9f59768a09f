// SPDX-License-Identifier: Apache-2.0
#include "tests/faults/disk_model.h"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string_view>
#include <utility>

namespace etude::faults {

std::vector<DiskOperation> ReadTrace(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  std::vector<DiskOperation> operations;
  for (std::string line; std::getline(stream, line);) {
    std::istringstream words(line);
    DiskOperation operation;
    std::size_t size = 0;
    words >> operation.kind >> operation.inode >> operation.number >> size;
    words.get();
    std::getline(words, operation.path);
    operation.data.resize(size);
    stream.read(reinterpret_cast<char*>(operation.data.data()), static_cast<std::streamsize>(size));
    if (!stream) break;  // cut off
    operations.push_back(std::move(operation));
  }
  return operations;
}

std::string DiskModel::FolderOf(const std::string& path) {
  const auto slash = path.rfind('/');
  return slash == std::string::npos ? "" : path.substr(0, slash);
}

void DiskModel::Begin(const DiskOperation& operation) {
  Sync& sync = syncs_[operation.number] = {.begun = now_, .file = 0, .bytes = {}, .names = {}};
  if (operation.kind == 's') {
    sync.file = number_of_[operation.inode];
    sync.bytes = inodes_[sync.file].seen;
    return;
  }
  for (const auto& [path, inode] : seen_)
    if (FolderOf(path) == operation.path) sync.names[path] = inode;
}

// A call that began earlier than one that has ended takes nothing of it back.
void DiskModel::End(const DiskOperation& operation) {
  const auto found = syncs_.find(operation.number);
  if (found == syncs_.end()) return;
  Sync sync = std::move(found->second);
  syncs_.erase(found);
  auto& since = operation.kind == 'S' ? inodes_[sync.file].safe_since : folder_safe_since_[operation.path];
  if (sync.begun < since) return;
  since = sync.begun;
  if (operation.kind == 'S') {
    inodes_[sync.file].safe = std::move(sync.bytes);
    return;
  }
  std::erase_if(safe_, [&](const auto& item) { return FolderOf(item.first) == operation.path; });
  safe_.merge(sync.names);
}

void DiskModel::Apply(const DiskOperation& operation) {
  const auto& path = operation.path;
  ++now_;
  if (operation.kind == 'C') {
    // a name that is there already keeps its file; any other is a new one, whatever its number was before
    if (!seen_.contains(path)) seen_[path] = number_of_[operation.inode] = next_++;
    number_of_[operation.inode] = seen_[path];
    if (operation.number == 1) inodes_[seen_[path]].seen.clear();
    return;
  }
  if (operation.kind == 'R') {
    const std::string from(operation.data.begin(), operation.data.end());
    if (const auto found = seen_.find(from); found != seen_.end()) {
      seen_[path] = found->second;
      seen_.erase(from);
    }
    return;
  }
  if (operation.kind == 'L') {
    // where it points is in its inode, and comes and goes with its name
    inodes_[next_] = {.seen = operation.data, .safe = operation.data, .safe_since = now_};
    seen_[path] = next_++;
    return;
  }
  if (operation.kind == 'U') return void(seen_.erase(path));
  if (operation.kind == 'M') return void(seen_[path] = 0);
  if (operation.kind == 's' || operation.kind == 'd') return Begin(operation);
  if (operation.kind == 'S' || operation.kind == 'D') return End(operation);
  Inode& file = inodes_[number_of_[operation.inode]];
  if (operation.kind == 'T') file.seen.resize(operation.number);
  if (operation.kind != 'W') return;
  file.seen.resize(std::max(file.seen.size(), operation.number + operation.data.size()));
  std::copy(operation.data.begin(), operation.data.end(),
            file.seen.begin() + static_cast<std::ptrdiff_t>(operation.number));
}

Files DiskModel::AfterLoss(Survives survives, Rng& rng) const {
  const auto chance = [&] { return survives == Survives::kSome && rng.Below(2) == 0; };
  Names names = survives == Survives::kNothing ? safe_ : seen_;
  if (survives == Survives::kSome) {
    names = safe_;
    for (const auto& [path, inode] : seen_)
      if (rng.Below(2) == 0) names[path] = inode;
    std::erase_if(names, [&](const auto& item) { return !seen_.contains(item.first) && rng.Below(2) == 0; });
  }
  Files files;
  for (const auto& [path, inode] : names) {
    if (inode == 0) continue;
    bool reachable = true;
    for (std::string folder = FolderOf(path); !folder.empty(); folder = FolderOf(folder))
      reachable = reachable && names.contains(folder);
    if (!reachable) continue;
    const auto found = inodes_.find(inode);
    if (found == inodes_.end()) {
      files[path] = {};
      continue;
    }
    files[path] = survives == Survives::kAll || chance() ? found->second.seen : found->second.safe;
  }
  return files;
}

std::string DiskModel::TextOf(const std::string& path) const {
  const auto name = seen_.find(path);
  if (name == seen_.end() || !inodes_.contains(name->second)) return "";
  const auto& bytes = inodes_.at(name->second).seen;
  return {bytes.begin(), bytes.end()};
}

}  // namespace etude::faults
