// SPDX-License-Identifier: Apache-2.0
// The web pages: files of one folder, found by the list of what lies there, never by joining a path.
#pragma once

#include <map>
#include <memory>
#include <string>

#include "dashboard/server/http/message.h"
#include "services/core/clock.h"
#include "services/core/thread_annotations.h"

namespace etude::http {

/// Thread-safe.
class StaticFiles {
 public:
  /// @param folder  the built bundle; where it is missing, pages say how to build it
  explicit StaticFiles(Path folder) : folder_(std::move(folder)) {}

  /// A file of the folder; index.html for the address of a page, that is one whose last segment has no dot.
  Result<Answer> Serve(const Request& request);

 private:
  struct File {
    Path path;
    std::string tag;  // of size and time, so that a bundle built anew is taken up
    std::shared_ptr<const std::string> content;
  };
  void Scan() ETUDE_REQUIRES(mutex_);
  const File* Load(const std::string& name) ETUDE_REQUIRES(mutex_);

  const Path folder_;
  Mutex mutex_;
  std::map<std::string, File> files_ ETUDE_GUARDED_BY(mutex_);
  MonotonicClock::time_point scanned_ ETUDE_GUARDED_BY(mutex_){};
};

/// "text/html; charset=utf-8" of a name's ending; "application/octet-stream" of others.
std::string ContentTypeOf(const std::string& name);

}  // namespace etude::http
