// SPDX-License-Identifier: Apache-2.0
// Of files that others append to, and that are read while they grow.
#pragma once

#include <cstdint>
#include <string>

namespace etude {

/// The last bytes (64 at most) of what was read up to `offset`; "" where they cannot be read. Where other bytes stand
/// there later, it is another file: an inode is given out again at once, and a file that was made anew has outgrown
/// `offset` already when nobody looked for a while.
std::string BytesBefore(int fd, std::uint64_t offset);

}  // namespace etude
