// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/sources/identities.h"

#include "services/core/identity.h"

namespace etude::sources {

std::string Identities::Of(const Path& folder) {
  // before it is read: what is written meanwhile has another stamp, and is read the next time
  const FileStamp stamp = StampOf(folder / "identity.json");
  if (!stamp.exists()) return "";
  const MutexLock lock(mutex_);
  const auto it = known_.find(folder);
  if (it != known_.end() && it->second.stamp == stamp) return it->second.id;
  const auto identity = ReadIdentity(folder);
  if (known_.size() >= kMost) known_.clear();
  return (known_[folder] = {stamp, identity ? identity->id : ""}).id;
}

}  // namespace etude::sources
