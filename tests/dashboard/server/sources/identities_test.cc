// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/sources/identities.cc
#include "dashboard/server/sources/identities.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "services/core/identity.h"
#include "tests/support/temporary_folder.h"

namespace etude::sources {
namespace identities_test {

TEST(Identities, AFileIsReadAgainWhenItHasChanged) {
  const TemporaryFolder folder;
  const Path file = folder / "identity.json";
  Identities identities;
  EXPECT_EQ(identities.Of(folder.path()), "") << "it has none";
  const std::string id = OpenIdentity(folder.path()).value().id;
  EXPECT_EQ(identities.Of(folder.path()), id);

  // another id in the same file, as long, of the same time: only who opens it sees that
  std::string text = ReadTextFile(file).value();
  const std::string other(16, id == std::string(16, 'a') ? 'b' : 'a');
  text.replace(text.find(id), id.size(), other);
  const auto written = std::filesystem::last_write_time(file);
  std::ofstream(file) << text;
  std::filesystem::last_write_time(file, written);
  EXPECT_EQ(identities.Of(folder.path()), id);

  std::filesystem::last_write_time(file, written + std::chrono::seconds(1));
  EXPECT_EQ(identities.Of(folder.path()), other);
  std::filesystem::remove(file);
  EXPECT_EQ(identities.Of(folder.path()), "");
}

TEST(Identities, WhatIsNotUnderstoodIsNoId) {
  const TemporaryFolder folder;
  ASSERT_TRUE(WriteFileAtomically(folder / "identity.json", std::string_view("{}")));
  Identities identities;
  EXPECT_EQ(identities.Of(folder.path()), "");
}

}  // namespace identities_test
}  // namespace etude::sources
