// SPDX-License-Identifier: Apache-2.0
// What h5py, a reader that is not ours, sees in a file.
#pragma once

#include <gtest/gtest.h>

#include <optional>
#include <string>

#include "services/core/config.h"
#include "services/core/file.h"
#include "tests/support/run_command.h"

namespace etude::store {

/// What read_with_h5py.py prints of a group. Nothing: h5py is not there. Run in the repository's folder.
inline std::optional<Json> ReadWithH5py(const Path& file, const std::string& group) {
  const ShellOutput output =
      RunInShell("/usr/bin/python3 tests/services/store/read_with_h5py.py " + file.string() + " " + group);
  if (output.code == 77) return std::nullopt;
  EXPECT_EQ(output.code, 0) << output.text;
  return Json::parse(output.text, nullptr, false);
}

}  // namespace etude::store
