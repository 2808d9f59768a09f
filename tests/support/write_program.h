// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <string_view>

#include "services/core/file.h"

namespace etude {

/// Writes a shell script that can be started; returns its `path`.
inline Path WriteProgram(const Path& path, std::string_view script) {
  const Status written = WriteFileAtomically(path, script);
  EXPECT_TRUE(written) << (written ? "" : written.error().message);
  std::filesystem::permissions(path, std::filesystem::perms::owner_all);
  return path;
}

}  // namespace etude
