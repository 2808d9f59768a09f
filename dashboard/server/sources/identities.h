// SPDX-License-Identifier: Apache-2.0
// Ids of folders, each read when its file has changed.
#pragma once

#include <map>
#include <string>

#include "dashboard/server/sources/files.h"
#include "services/core/thread_annotations.h"

namespace etude::sources {

/// Thread-safe. A page that looks for the folder of an id asks all that were found; opening a thousand files for each
/// request costs more than asking the file system when they were written.
class Identities {
 public:
  /// Of `folder`; "": it has none, or one that is not understood.
  std::string Of(const Path& folder) ETUDE_EXCLUDES(mutex_);

 private:
  struct Known {
    FileStamp stamp;
    std::string id;
  };
  static constexpr std::size_t kMost = 4096;  // folders; more than a catalog finds

  Mutex mutex_;
  std::map<Path, Known> known_ ETUDE_GUARDED_BY(mutex_);
};

}  // namespace etude::sources
