// SPDX-License-Identifier: Apache-2.0
#include "services/episode/episode.h"

#include <algorithm>

namespace etude {

const ObjectTrack* Episode::FindObject(const std::string& name) const {
  const auto it =
      std::find_if(objects.begin(), objects.end(), [&](const ObjectTrack& object) { return object.name == name; });
  return it == objects.end() ? nullptr : &*it;
}

}  // namespace etude
