// SPDX-License-Identifier: Apache-2.0
// What readers that are not ours see in a Parquet file: hyparquet, and Arrow's own by parquet-wasm.
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <optional>
#include <string>

#include "services/core/config.h"
#include "services/core/file.h"
#include "tests/support/run_command.h"

namespace etude::exports {

inline constexpr const char* kNodeReaders[] = {"hyparquet", "parquet-wasm"};

/// {"rows": [...], "metadata": {...}, "columns": [...]}; whole numbers of 64 bits as texts. Nothing: no node, or no
/// such reader, which is an error where ETUDE_NODE_REQUIRED is set. Run in the repository's folder.
inline std::optional<OrderedJson> ReadWithNode(const std::string& reader, const Path& file) {
  const auto [code, text] =
      RunInShell("node tests/services/export/read_parquet.mjs " + reader + " '" + file.string() + "' 2>&1");
  if (code == 77 || code == 127) {
    EXPECT_EQ(std::getenv("ETUDE_NODE_REQUIRED"), nullptr) << reader << " is not there: npm --prefix dashboard/web ci";
    return std::nullopt;
  }
  EXPECT_EQ(code, 0) << text.substr(0, 2000);
  return OrderedJson::parse(text, nullptr, false);
}

}  // namespace etude::exports
