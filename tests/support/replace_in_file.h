// SPDX-License-Identifier: Apache-2.0
// Breaks a copy of a file, for tests of what is then said.
#pragma once

#include <gtest/gtest.h>

#include <string>

#include "services/core/file.h"

namespace etude {

/// The first `from` in the text becomes `to`; it must be there.
inline void ReplaceInFile(const Path& file, const std::string& from, const std::string& to) {
  std::string text = *ReadTextFile(file);
  const auto at = text.find(from);
  ASSERT_NE(at, std::string::npos) << from;
  text.replace(at, from.size(), to);
  ASSERT_TRUE(WriteFileAtomically(file, text));
}

}  // namespace etude
