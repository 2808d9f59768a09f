// SPDX-License-Identifier: Apache-2.0
// What hyparquet, a reader that is not ours, sees in a Parquet file.
#pragma once

#include <gtest/gtest.h>
#include <sys/wait.h>

#include <array>
#include <cstdio>
#include <optional>
#include <string>

#include "services/core/config.h"
#include "services/core/file.h"

namespace etude::exports {

/// {"rows": [...], "metadata": {...}, "columns": [...]}; whole numbers of 64 bits as texts. Nothing: no node, or no
/// hyparquet. Run in the repository's folder.
inline std::optional<OrderedJson> ReadWithNode(const Path& file) {
  const std::string command = "node tests/services/export/read_parquet.mjs '" + file.string() + "' 2>&1";
  FILE* pipe = ::popen(command.c_str(), "r");
  if (pipe == nullptr) return std::nullopt;
  std::string text;
  std::array<char, 4096> buffer;
  for (std::size_t got; (got = std::fread(buffer.data(), 1, buffer.size(), pipe)) > 0;) text.append(buffer.data(), got);
  const int status = ::pclose(pipe);
  const int code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  if (code == 77 || code == 127) return std::nullopt;
  EXPECT_EQ(code, 0) << text.substr(0, 2000);
  return OrderedJson::parse(text, nullptr, false);
}

}  // namespace etude::exports
