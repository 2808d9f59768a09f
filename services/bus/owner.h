// SPDX-License-Identifier: Apache-2.0
// Whose traffic it is.
#pragma once

#include <string>

namespace etude::bus {

/// A campaign or a run: its name is for people, the random id of its folder tells it from others of that name.
struct Owner {
  std::string name;
  std::string id;
  /// "NAME/ID": the DDS partition in which everything of it travels.
  std::string partition() const { return name + "/" + id; }
  /// "NAME/ID/relay": what others pass on that the run itself has published.
  std::string relay_partition() const { return partition() + "/relay"; }
};

}  // namespace etude::bus
