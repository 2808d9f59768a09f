// SPDX-License-Identifier: Apache-2.0
#include "services/core/growing_file.h"

#include <unistd.h>

#include <algorithm>

namespace etude {

std::string BytesBefore(int fd, std::uint64_t offset) {
  constexpr std::uint64_t kEnough = 64;
  std::string bytes(std::min(offset, kEnough), '\0');
  const ssize_t got = ::pread(fd, bytes.data(), bytes.size(), static_cast<off_t>(offset - bytes.size()));
  bytes.resize(static_cast<std::size_t>(std::max<ssize_t>(got, 0)));
  return bytes;
}

}  // namespace etude
