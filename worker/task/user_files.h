// SPDX-License-Identifier: Apache-2.0
// The files of the user that a campaign names by their paths: robots, imported objects and tasks.
#pragma once

#include <string>
#include <vector>

#include "services/core/file.h"
#include "services/core/result.h"
#include "services/core/thread_annotations.h"
#include "services/spec/campaign_spec.h"

namespace etude::task {

/// SHA-256 over what stands in them now, with all that they refer to (MJCF, meshes, textures); "" when `spec` names
/// none. Equal on two hosts that make the same episodes.
/// @error of the files: kNotFound, kInvalidArgument.  Cost: builds a scene for each robot file.
Result<std::string> UserFilesSha256(const CampaignSpec& spec);

/// The same for who asks again and again: what was found holds while the files are as they were written, and only what
/// was written since is read. Thread-safe.
class UserFiles {
 public:
  /// @error as UserFilesSha256.  Cost: looks at each file's time and size.
  Result<std::string> Sha256(const CampaignSpec& spec) ETUDE_EXCLUDES(mutex_);

 private:
  Mutex mutex_;
  std::string spec_sha256_ ETUDE_GUARDED_BY(mutex_);  ///< of the spec that was asked for last
  std::vector<Path> files_ ETUDE_GUARDED_BY(mutex_);  ///< of its robots and objects
  std::string stamp_ ETUDE_GUARDED_BY(mutex_), sha256_ ETUDE_GUARDED_BY(mutex_);
};

}  // namespace etude::task
