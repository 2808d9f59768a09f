// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "services/core/file.h"

namespace etude {

/// A new empty folder under the system's temporary folder; removed with all its content.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  const Path& path() const { return path_; }
  Path operator/(const Path& name) const { return path_ / name; }

 private:
  Path path_;
};

/// Removes what tests and their scripts left in the system's temporary folder: what is named etude-test-nsNS-PID-*,
/// where NS is this process's namespace of process ids, and whose process is no more; and what scripts named
/// etude-test-PID-* more than a day ago. Called once by each program that makes a TemporaryFolder.
void RemoveFoldersOfTheDead();

}  // namespace etude
