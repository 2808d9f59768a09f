// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/sources/files.cc
#include "dashboard/server/sources/files.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>

#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::sources {
namespace files_test {

TEST(OpenBelow, FollowsNoLinkAndLeavesNoFolder) {
  TemporaryFolder folder;
  ASSERT_THAT(WriteFileAtomically(folder / "in" / "sub" / "a.txt", "a"), IsOk());
  ASSERT_THAT(WriteFileAtomically(folder / "secret", "s"), IsOk());
  std::filesystem::create_symlink(folder / "secret", folder / "in" / "link");
  std::filesystem::create_directory_symlink(folder.path(), folder / "in" / "up");

  const auto good = OpenBelow(folder / "in", "sub/a.txt");
  ASSERT_THAT(good, IsOk());
  EXPECT_EQ(good->stamp.size, 1u);
  for (const char* name : {"link", "up/secret", "sub", "none"})
    EXPECT_THAT(OpenBelow(folder / "in", name), HasCode(Code::kNotFound)) << name;
  for (const char* name : {"../secret", "sub/../../secret", "/etc/passwd", "", "."})
    EXPECT_THAT(OpenBelow(folder / "in", name), HasCode(Code::kInvalidArgument)) << name;
}

class JsonLinesTest : public testing::Test {
 protected:
  void Append(const std::string& text) { std::ofstream(file_, std::ios::app) << text; }
  void Refresh() {
    lines_.Refresh([this] { steps_.clear(), ++resets_; },
                   [this](const OrderedJson& line) { steps_.push_back(UnsignedOf(line, "step").value_or(0)); });
  }
  TemporaryFolder folder_;
  Path file_ = folder_ / "metrics.jsonl";
  JsonLines lines_{file_};
  std::vector<std::uint64_t> steps_;
  int resets_ = 0;
};

TEST_F(JsonLinesTest, ATornLastLineWaitsForItsEnd) {
  Append("{\"step\":1}\n{\"step\":2}\n{\"st");
  Refresh();
  EXPECT_EQ(steps_, (std::vector<std::uint64_t>{1, 2}));
  EXPECT_TRUE(lines_.torn());
  Append("ep\":3}\n");
  Refresh();
  EXPECT_EQ(steps_, (std::vector<std::uint64_t>{1, 2, 3}));
  EXPECT_FALSE(lines_.torn());
}

TEST_F(JsonLinesTest, LinesThatAreNoneArePassedOver) {
  Append("{\"step\":1}\nnot json\n[1]\n\n{\"step\":2}\n");
  Refresh();
  EXPECT_EQ(steps_, (std::vector<std::uint64_t>{1, 2}));
}

TEST_F(JsonLinesTest, AReplacedFileIsReadFromItsBegin) {
  Append("{\"step\":1}\n{\"step\":2}\n");
  Refresh();
  ASSERT_THAT(WriteFileAtomically(file_, "{\"step\":9}\n"), IsOk());
  Refresh();
  EXPECT_EQ(steps_, (std::vector<std::uint64_t>{9}));
}

// a folder that is deleted and made anew: the inode is given out again, and nobody looked until the file was longer
TEST_F(JsonLinesTest, AFileThatWasMadeAnewAndHasOutgrownTheOldOneIsReadFromItsBegin) {
  Append("{\"step\":1}\n{\"step\":2}\n");
  Refresh();
  const auto inode = lines_.stamp().inode;
  std::ofstream(file_, std::ios::trunc) << "{\"step\":7}\n{\"step\":8}\n{\"step\":9}\n";
  Refresh();
  EXPECT_EQ(lines_.stamp().inode, inode);
  EXPECT_EQ(steps_, (std::vector<std::uint64_t>{7, 8, 9}));
  const int resets = resets_;
  Append("{\"step\":10}\n");
  Refresh();
  EXPECT_EQ(steps_.size(), 4u);
  EXPECT_EQ(resets_, resets) << "one that grows is read on";
}

TEST(Time, GoesThereAndBack) {
  EXPECT_EQ(Rfc3339(1795368176.25), "2026-11-22T17:22:56.250Z");
  EXPECT_DOUBLE_EQ(ParseTime("2026-11-22T17:22:56.250Z").value(), 1795368176.25);
  EXPECT_DOUBLE_EQ(ParseTime("12.5").value(), 12.5);
  EXPECT_FALSE(ParseTime("yesterday"));
  EXPECT_TRUE(TimeJson(std::nullopt).is_null());
}

}  // namespace files_test
}  // namespace etude::sources
