// SPDX-License-Identifier: Apache-2.0
// What hyparquet, a reader that is not ours, sees in a Parquet file.
#pragma once

#include <gtest/gtest.h>

#include <optional>
#include <string>

#include "services/core/config.h"
#include "services/core/file.h"
#include "tests/support/run_command.h"

namespace etude::exports {

/// {"rows": [...], "metadata": {...}, "columns": [...]}; whole numbers of 64 bits as texts. Nothing: no node, or no
/// hyparquet. Run in the repository's folder.
inline std::optional<OrderedJson> ReadWithNode(const Path& file) {
  const std::string command = "node tests/services/export/read_parquet.mjs '" + file.string() + "' 2>&1";
  const auto [code, text] = RunInShell(command);
  if (code == 77 || code == 127) return std::nullopt;
  EXPECT_EQ(code, 0) << text.substr(0, 2000);
  return OrderedJson::parse(text, nullptr, false);
}

}  // namespace etude::exports
