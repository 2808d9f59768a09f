// SPDX-License-Identifier: Apache-2.0
// Links whose target changes while others read them.
#pragma once

#include "services/core/file.h"
#include "services/core/result.h"

namespace etude {

/// Makes `link` a symbolic link to `target`, in place of what was there: a reader sees the old one or the new one.
/// Durable when it returns. @error kUnavailable of the disk
Status PointLink(const Path& link, const Path& target);

}  // namespace etude
