// SPDX-License-Identifier: Apache-2.0
// A disk that loses power: replays the operations that the shim recorded, and says what may be left of them. Data of a
// file is safe once the file was fsynced, a name (created, renamed, made) once its folder was: as they were when the
// call began, for what another thread does meanwhile may come too late for it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "services/core/rng.h"
#include "tests/faults/scanner.h"

namespace etude::faults {

struct DiskOperation {
  char kind =
      0;  ///< Create, Write, Truncate, Sync, D: folder synced, Rename, Unlink, Make folder, Link; s, d: it begins
  std::uint64_t inode = 0;
  std::uint64_t number = 0;        ///< offset of a write, size of a truncation, 1: created empty, thread of a sync
  std::string path;                ///< below the traced folder; where a rename went
  std::vector<std::uint8_t> data;  ///< of a write; where a rename came from; where a link points
};

std::vector<DiskOperation> ReadTrace(const std::filesystem::path& file);

/// What survives of that which was not synced.
enum class Survives {
  kNothing,
  kNames,  ///< every name, but no data: a rename that overtakes the bytes
  kSome,   ///< each name and each file's data by chance
  kAll,    ///< a process was killed, the machine went on
};

class DiskModel {
 public:
  void Apply(const DiskOperation& operation);
  /// What is there after the power comes back. `rng` is asked only for kSome.
  Files AfterLoss(Survives survives, Rng& rng) const;
  /// As the programs see it now.
  std::string TextOf(const std::string& path) const;

 private:
  struct Inode {
    std::vector<std::uint8_t> seen, safe;
    std::uint64_t safe_since = 0;  // when the sync that `safe` is of began
  };
  using Names = std::map<std::string, std::uint64_t>;  // 0: a folder
  // What a call that has begun will have made safe.
  struct Sync {
    std::uint64_t begun = 0;
    std::uint64_t file = 0;
    std::vector<std::uint8_t> bytes;
    Names names;
  };
  static std::string FolderOf(const std::string& path);
  void Begin(const DiskOperation& operation);
  void End(const DiskOperation& operation);

  std::map<std::uint64_t, Inode> inodes_;
  std::map<std::uint64_t, std::uint64_t> number_of_;  // the file system gives inode numbers again
  std::uint64_t next_ = 1;
  Names seen_, safe_;
  std::map<std::string, std::uint64_t> folder_safe_since_;
  std::map<std::uint64_t, Sync> syncs_;  // by thread
  std::uint64_t now_ = 0;
};

}  // namespace etude::faults
