// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/sources/replays.cc, bounded_folder.cc and what sources.h and catalog.cc make of them
#include "dashboard/server/sources/replays.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "dashboard/server/sources/sources.h"
#include "tests/dashboard/server/example_folders.h"
#include "tests/support/matchers.h"

namespace etude::sources {
namespace replays_test {

using namespace std::chrono_literals;

class ReplaysTest : public testing::Test {
 protected:
  static std::string Key(int n) { return Replays::KeyOf({"dataset", std::to_string(n)}); }
  // One of `bytes` and little more, as its command leaves it.
  Path Make(const Replays& replays, int n, std::size_t bytes = 10) {
    const Path place = replays.NewPlace(Key(n));
    EXPECT_THAT(WriteFileAtomically(place / "plan.json", std::string_view("{}")), IsOk());
    EXPECT_THAT(WriteFileAtomically(place / "videos" / "video.mp4", std::string(bytes, 'x')), IsOk());
    return place;
  }
  static void SetAge(const Path& entry, std::chrono::hours age) {
    std::filesystem::last_write_time(entry, std::filesystem::file_time_type::clock::now() - age);
  }
  std::vector<std::string> Entries() const {
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(cache_))
      names.push_back(entry.path().filename().string());
    return names;
  }

  TemporaryFolder folder_;
  Path cache_ = folder_ / "cache";
};

TEST_F(ReplaysTest, KeysAreOfEachPartAlone) {
  EXPECT_EQ(Replays::KeyOf({"a", "b"}).size(), 32u);
  EXPECT_EQ(Replays::KeyOf({"a", "b"}), Replays::KeyOf({"a", "b"}));
  EXPECT_NE(Replays::KeyOf({"a", "b"}), Replays::KeyOf({"ab"}));
  EXPECT_NE(Replays::KeyOf({"a", "bc"}), Replays::KeyOf({"ab", "c"}));
  EXPECT_EQ(Replays::KeyIn(Replays::IdOf(Key(1))), Key(1));
  for (const char* id : {"replay", "replay.", "replay.data", "replay.../../../etc/passwd", "lab.data"})
    EXPECT_FALSE(Replays::KeyIn(id)) << id;
}

TEST_F(ReplaysTest, OneIsThereWhenItIsWhole) {
  const Replays replays(cache_);
  const Path place = Make(replays, 1);
  EXPECT_THAT(replays.Find(Key(1)), HasCode(Code::kNotFound)) << "it is being made";
  ASSERT_THAT(replays.Keep(place, Key(1)), IsOk());
  EXPECT_EQ(replays.Find(Key(1)).value(), cache_ / Key(1));
  EXPECT_THAT(replays.FindDataset(Key(1)), HasCode(Code::kNotFound)) << "nothing moved";

  const Path again = Make(replays, 1);
  EXPECT_THAT(replays.Keep(again, Key(1)), IsOk()) << "another gateway was quicker";
  EXPECT_THAT(Entries(), testing::ElementsAre(Key(1)));

  std::filesystem::create_directory_symlink(cache_ / Key(1), cache_ / Key(2));
  EXPECT_THAT(replays.Find(Key(2)), HasCode(Code::kNotFound)) << "a link leads anywhere";
  EXPECT_THAT(Replays("").Find(Key(1)), HasCode(Code::kNotFound));
}

TEST_F(ReplaysTest, TheOnesThatWereLookedAtLongestAgoGoFirst) {
  const Replays replays(cache_, 250);
  for (int n = 0; n < 3; ++n) {
    ASSERT_THAT(replays.Keep(Make(replays, n, 100), Key(n)), IsOk());
    SetAge(cache_ / Key(n), std::chrono::hours(10 - n));
  }
  EXPECT_THAT(replays.Find(Key(0)), IsOk()) << "looked at: the next one is the oldest now";
  const Path left = Make(replays, 7), under_way = Make(replays, 8);
  SetAge(left, 2h);
  replays.Trim();
  EXPECT_THAT(Entries(), testing::UnorderedElementsAre(Key(0), Key(2), under_way.filename().string()));

  const Replays poor(cache_, 1);
  poor.Trim(Key(2));
  EXPECT_THAT(Entries(), testing::UnorderedElementsAre(Key(2), under_way.filename().string()))
      << "what was just made stays, however little may";
}

// before, a replay lay beside its dataset: listed with it, or out of the folders given
TEST_F(ReplaysTest, ItsDatasetIsOpenedByItsIdAndInNoList) {
  ExampleFolders lab;
  const Path replays = lab.root() / "cache" / "replays";
  WriteExampleDataset(replays / Key(1), 1);
  ASSERT_THAT(WriteFileAtomically(replays / Key(1) / "plan.json", std::string_view("{}")), IsOk());

  Sources sources({lab.root()}, replays);
  for (const auto& item : *sources.catalog().List()) EXPECT_EQ(item.folder.string().find("replays"), std::string::npos);
  const auto hidden = sources.Dataset(Replays::IdOf(Key(1)));
  ASSERT_THAT(hidden, IsOk());
  EXPECT_EQ((*hidden)->View().value()->rows.size(), 1u);
  EXPECT_THAT(sources.Dataset(Replays::IdOf(Key(2))), HasCode(Code::kNotFound));
  EXPECT_THAT(sources.Dataset("lab.data"), IsOk());
}

}  // namespace replays_test
}  // namespace etude::sources
