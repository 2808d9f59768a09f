// SPDX-License-Identifier: Apache-2.0
// Tests services/store/link.cc
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <map>

#include "services/spec/content_version.h"
#include "services/store/commit_journal.h"
#include "services/store/edit.h"
#include "services/store/filter_keys.h"
#include "tests/support/matchers.h"
#include "tests/support/replace_in_file.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude::store {
namespace link_test {

using testing::ElementsAre;
using testing::HasSubstr;

struct stat InfoOf(const Path& path) {
  struct stat info {};
  EXPECT_EQ(::stat(path.c_str(), &info), 0) << path;
  return info;
}

class Link : public testing::Test {
 protected:
  // As a collector leaves it: every index of `indices`, and an attempt that failed before each odd one.
  Path Write(const Path& path, const CampaignSpec& spec, const std::vector<std::uint64_t>& indices, int steps = 10) {
    auto writer = DatasetWriter::Open(path, spec);
    EXPECT_THAT(writer, IsOk());
    for (const std::uint64_t i : indices) {
      if (i % 2 == 1) {
        EXPECT_THAT(writer->RecordFailure(i, 0, "slip", "{}"), IsOk());
      }
      EXPECT_THAT(writer->Commit(MakeSyntheticEpisode(spec, i, steps), {.host = path.filename().string()}), IsOk());
    }
    EXPECT_THAT(writer->WriteMaster(), IsOk());
    return path;
  }
  Path WriteShard(const std::string& name, const CampaignSpec& spec, const std::vector<std::uint64_t>& indices) {
    return Write(folder_ / name, spec, indices);
  }

  TemporaryFolder folder_;
  CampaignSpec spec_ = SyntheticSpec();
  Path out_ = folder_ / "linked";
};

TEST_F(Link, IsTheDatasetThatOneCollectorWouldHaveMade) {
  const Path a = WriteShard("a", spec_, {0, 2, 4}), b = WriteShard("b", spec_, {1, 3, 5});
  const Path all = WriteShard("all", spec_, {0, 1, 2, 3, 4, 5});
  ASSERT_THAT(WriteFilterKey(b, "keep", {1, 5}), IsOk());

  const auto report = LinkDatasets({a, b}, out_, Leftover::kRefuse);

  ASSERT_THAT(report, IsOk());
  EXPECT_EQ(report->episodes, 6u);
  EXPECT_EQ(report->planned, spec_.episodes);
  EXPECT_EQ(*HashDataset(out_), *HashDataset(all));
  EXPECT_EQ(*ReadTextFile(out_ / "dataset.json"), *ReadTextFile(all / "dataset.json")) << "statistics, too";
  EXPECT_EQ(*DatasetInfo(out_), *DatasetInfo(all));
  const auto verified = Verify(out_, Quarantine::kNo);
  ASSERT_THAT(verified, IsOk());
  EXPECT_EQ(verified->good, 6u);
  EXPECT_EQ(*ReadFilterKeys(out_), (FilterKeys{{"keep", {1, 5}}}));
  EXPECT_TRUE(std::filesystem::exists(out_ / "dataset.hdf5"));
}

TEST_F(Link, OfWhatWasChosenOfOthersNoCampaignGoesOn) {
  const Path a = WriteShard("a", spec_, {0, 2}), b = WriteShard("b", spec_, {1});
  ASSERT_THAT(MarkDerived(b), IsOk());
  ASSERT_THAT(LinkDatasets({a, b}, out_, Leftover::kRefuse), IsOk());
  EXPECT_TRUE(IsDerived(out_));
  EXPECT_FALSE(CanBeMadeAgain(out_));
}

TEST_F(Link, TakesNoRoomAndOutlivesItsShards) {
  const Path a = WriteShard("a", spec_, {0}), b = WriteShard("b", spec_, {1});
  const auto inode = InfoOf(EpisodePath(b, 1)).st_ino;
  ASSERT_THAT(LinkDatasets({a, b}, out_, Leftover::kRefuse), IsOk());

  EXPECT_EQ(InfoOf(EpisodePath(out_, 1)).st_ino, inode);
  EXPECT_EQ(InfoOf(EpisodePath(out_, 1)).st_nlink, 2u);
  std::filesystem::remove_all(a);
  std::filesystem::remove_all(b);
  EXPECT_EQ(Verify(out_, Quarantine::kNo)->good, 2u);
}

TEST_F(Link, LinksWhatASymbolicLinkLeadsTo) {
  const Path a = WriteShard("a", spec_, {0}), b = WriteShard("b", spec_, {1});
  const Path elsewhere = folder_ / "elsewhere.hdf5";
  std::filesystem::rename(EpisodePath(b, 1), elsewhere);
  std::filesystem::create_symlink(elsewhere, EpisodePath(b, 1));

  ASSERT_THAT(LinkDatasets({a, b}, out_, Leftover::kRefuse), IsOk());

  EXPECT_FALSE(std::filesystem::is_symlink(EpisodePath(out_, 1)));
  EXPECT_EQ(InfoOf(EpisodePath(out_, 1)).st_ino, InfoOf(elsewhere).st_ino);
}

TEST_F(Link, KnowsWhoMadeEachEpisodeAndWhatFailed) {
  const Path a = WriteShard("a", spec_, {0, 2}), b = WriteShard("b", spec_, {1});
  {
    auto writer = DatasetWriter::Open(b, spec_);
    ASSERT_THAT(writer, IsOk());
    ASSERT_THAT(writer->RecordFailure(3, 0, "dropped", "{}"), IsOk());  // and given up
  }
  ASSERT_THAT(LinkDatasets({a, b}, out_, Leftover::kRefuse), IsOk());

  std::map<std::uint64_t, std::string> hosts;
  ASSERT_THAT(CommitTail(out_).Refresh([] {}, [&](const CommitRow& row) { hosts[row.index] = row.facts.host; }),
              IsOk());
  ASSERT_EQ(hosts.size(), 3u);
  EXPECT_EQ(hosts.at(2), "a");
  EXPECT_EQ(hosts.at(1), "b");
  const std::string attempts = *ReadTextFile(out_ / "attempts.jsonl");
  EXPECT_THAT(attempts, HasSubstr("slip"));
  EXPECT_THAT(attempts, HasSubstr("dropped"));
}

// what a journal lacks, because an older program or a crash left it so, the episodes say
TEST_F(Link, ReadsEpisodesWhereAJournalLacksThem) {
  const Path a = WriteShard("a", spec_, {0, 2}), b = WriteShard("b", spec_, {1});
  const Path all = WriteShard("all", spec_, {0, 1, 2});
  ASSERT_THAT(WriteFileAtomically(b / "commits.jsonl", std::string_view("{\"index\": 1, \"by")), IsOk());

  ASSERT_THAT(LinkDatasets({a, b}, out_, Leftover::kRefuse), IsOk());

  EXPECT_EQ(*ReadTextFile(out_ / "dataset.json"), *ReadTextFile(all / "dataset.json"));
}

TEST_F(Link, ACampaignGoesOnInIt) {
  CampaignSpec longer = spec_;
  longer.episodes = spec_.episodes + 7;  // one shard was told of more
  ASSERT_THAT(LinkDatasets({WriteShard("a", spec_, {0}), WriteShard("b", longer, {1})}, out_, Leftover::kRefuse),
              IsOk());

  EXPECT_EQ(DatasetReader::Open(out_)->spec().episodes, longer.episodes);
  auto writer = DatasetWriter::Open(out_, longer);
  ASSERT_THAT(writer, IsOk());
  EXPECT_THAT(writer->Commit(MakeSyntheticEpisode(longer, 2, 10)), IsOk());
  EXPECT_THAT(writer->committed(), ElementsAre(0, 1, 2));
}

TEST_F(Link, RefusesWhatIsNoShardOfOneCampaign) {
  const Path a = WriteShard("a", spec_, {0, 2});
  CampaignSpec other = spec_;
  other.seed = spec_.seed + 1;
  EXPECT_THAT(LinkDatasets({a, WriteShard("seed", other, {1})}, out_, Leftover::kRefuse), MessageHas("seed ("));
  other = spec_;
  other.name = "second";
  EXPECT_THAT(LinkDatasets({a, WriteShard("name", other, {1})}, out_, Leftover::kRefuse), MessageHas("name ("));
  other = spec_;
  other.split.test = 0.5;
  EXPECT_THAT(LinkDatasets({a, WriteShard("split", other, {1})}, out_, Leftover::kRefuse), MessageHas("split ("));
  EXPECT_THAT(LinkDatasets({a, WriteShard("twice", spec_, {1, 2})}, out_, Leftover::kRefuse),
              MessageHas("both have episode 2"));
  EXPECT_THAT(LinkDatasets({a, a}, out_, Leftover::kRefuse), MessageHas("both have episode 0"));
  EXPECT_THAT(LinkDatasets({a}, out_, Leftover::kRefuse), MessageHas("at least two"));
  const Path older = WriteShard("older", spec_, {3});
  ReplaceInFile(older / "dataset.json", fmt::format("\"content\": {}", kContentVersion), "\"content\": 1");
  EXPECT_THAT(LinkDatasets({a, older}, out_, Leftover::kRefuse), MessageHas("it was made with content version 1"));
  EXPECT_THAT(LinkDatasets({a, folder_ / "none"}, out_, Leftover::kRefuse), HasCode(Code::kNotFound));
  EXPECT_FALSE(std::filesystem::exists(out_));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "linked.partial")) << "nothing is left to be removed";
}

TEST_F(Link, RefusesJournalsThatSayDifferentThings) {
  spec_.adaptive_sampling.share = 0.5;
  const Path a = WriteShard("a", spec_, {0}), b = WriteShard("b", spec_, {1});
  ASSERT_THAT(WriteFileAtomically(b / "sampling.jsonl", std::string_view("{}\n")), IsOk());
  EXPECT_THAT(LinkDatasets({a, b}, out_, Leftover::kRefuse), MessageHas("sampling journals"));
}

TEST_F(Link, SaysWhatToDoWhereTheFilesystemsDiffer) {
  const Path memory = "/dev/shm";
  std::error_code error;
  if (!std::filesystem::is_directory(memory, error) || InfoOf(memory).st_dev == InfoOf(folder_.path()).st_dev)
    GTEST_SKIP() << "this machine has no second filesystem to write to";
  const Path elsewhere = memory / folder_.path().filename();
  const Path a = WriteShard("a", spec_, {0}), b = Write(elsewhere / "b", spec_, {1});

  const auto refused = LinkDatasets({a, b}, out_, Leftover::kRefuse);
  std::filesystem::remove_all(elsewhere);

  EXPECT_THAT(refused, HasCode(Code::kInvalidArgument));
  EXPECT_THAT(refused, MessageHas("different filesystems"));
  EXPECT_THAT(refused, MessageHas("etude dataset merge"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "linked.partial"));
}

}  // namespace link_test
}  // namespace etude::store
