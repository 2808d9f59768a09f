// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/dataset_edit.cc: what each command takes, and that a refusal changes nothing.
#include <set>

#include "tests/services/cli/cli_fixture.h"

namespace etude {
namespace dataset_commands_test {

using testing::HasSubstr;

class DatasetCommands : public CliFixture {
 protected:
  void SetUp() override { WriteDataset("data", {0, 1, 2, 3, 4, 5, 6, 7, 8}); }

  std::vector<std::uint64_t> List(const std::string& name) {
    const auto reader = store::DatasetReader::Open(folder_ / name);
    EXPECT_TRUE(reader) << name;
    return reader ? reader->List().value_or(std::vector<std::uint64_t>{}) : std::vector<std::uint64_t>{};
  }
  // The indices in `data` of one task.
  std::vector<std::uint64_t> OfTask(const std::string& task) {
    std::vector<std::uint64_t> indices;
    const auto reader = store::DatasetReader::Open(folder_ / "data").value();
    for (const std::uint64_t index : List("data"))
      if (reader.Read(index).value().episode.task == task) indices.push_back(index);
    return indices;
  }
  void ExpectUsage(const std::vector<std::string>& arguments, const std::string& says) {
    const CommandOutcome outcome = Etude(arguments);
    EXPECT_EQ(outcome.exit_code, kExitUsage) << outcome.text;
    EXPECT_THAT(outcome.text, HasSubstr(says));
  }
};

TEST_F(DatasetCommands, AFilterIsOneOfADatasetAndAKey) {
  ExpectUsage({"dataset", "filter", In("data"), "--task", "pick"}, "say one of: OUT");
  ExpectUsage({"dataset", "filter", In("data"), In("out"), "--as", "keep", "--task", "pick"}, "say one of: OUT");
  ExpectUsage({"dataset", "filter", In("data"), "--as", "pick", "--index", "1"}, "choose another");
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out"));
}

TEST_F(DatasetCommands, AFilterTakesWhatFitsAllThatIsAsked) {
  const auto picks = OfTask("pick");
  ASSERT_GE(picks.size(), 2u);
  ASSERT_EQ(Etude({"dataset", "filter", In("data"), In("picks"), "--task", "pick"}).exit_code, kExitOk);
  EXPECT_EQ(List("picks"), picks);
  ASSERT_EQ(Etude({"dataset", "filter", In("data"), In("two"), "--task", "pick", "--index", "0-8", "--min-steps", "10",
                   "--max-steps", "10", "--outcome", "success"})
                .exit_code,
            kExitOk);
  EXPECT_EQ(List("two"), picks);
  const CommandOutcome none = Etude({"dataset", "filter", In("data"), In("none"), "--min-steps", "11"});
  EXPECT_EQ(none.exit_code, kExitFailure);
  EXPECT_THAT(none.text, HasSubstr("no episode"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "none"));
  ExpectUsage({"dataset", "filter", In("data"), In("none"), "--index", "-3"}, "");
  ExpectUsage({"dataset", "filter", In("data"), In("none"), "--index", "1;2"}, "give numbers of episodes");
  ExpectUsage({"dataset", "filter", In("data"), In("none"), "--index", ""}, "");
  ASSERT_EQ(Etude({"dataset", "filter", In("data"), In("commas"), "--index", "1,3-4"}).exit_code, kExitOk);
  EXPECT_EQ(List("commas").size(), 3u) << "as `filter --as` writes them";
}

TEST_F(DatasetCommands, ASplitByTaskHasAFolderForEachWithItsEpisodes) {
  const CommandOutcome split = Etude({"dataset", "split", In("data"), In("parts"), "--by", "task"});
  ASSERT_EQ(split.exit_code, kExitOk) << split.text;
  std::size_t all = 0;
  for (const char* task : {"pick", "push", "put_down"}) {
    EXPECT_EQ(List(std::string("parts/") + task), OfTask(task));
    EXPECT_THAT(split.text, HasSubstr(task));
    all += OfTask(task).size();
  }
  EXPECT_EQ(all, 9u);
}

TEST_F(DatasetCommands, SharesThatAreNoneAreRefusedBeforeAnythingIsMade) {
  for (const char* part :
       {"train", "train=", "train=x", "train=0.5x", "train=0", "train=-1", "train=nan", "train=inf", "../x=1", "=1"})
    EXPECT_EQ(Etude({"dataset", "split", In("data"), In("parts"), "--parts", part}).exit_code, kExitUsage) << part;
  ExpectUsage({"dataset", "split", In("data"), In("parts"), "--parts", "a=1", "a=2"}, "different");
  ExpectUsage({"dataset", "split", In("data"), In("parts"), "--by", "colour"}, "colour");
  ExpectUsage({"dataset", "split", In("data"), In("parts"), "--by", "task", "--parts", "a=1"}, "");
  ExpectUsage({"dataset", "split", In("data"), In("parts")}, "say robot, task, target, split or outcome");
  EXPECT_FALSE(std::filesystem::exists(folder_ / "parts"));
}

TEST_F(DatasetCommands, SharesAreRelativeAndEveryEpisodeIsInOnePart) {
  ASSERT_EQ(Etude({"dataset", "split", In("data"), In("parts"), "--parts", "a=2", "b=1"}).exit_code, kExitOk);
  const auto a = List("parts/a"), b = List("parts/b");
  EXPECT_EQ(a.size(), 6u);
  EXPECT_EQ(b.size(), 3u);
  std::set<std::uint64_t> all(a.begin(), a.end());
  all.insert(b.begin(), b.end());
  EXPECT_EQ(all.size(), 9u);
}

// before, it was said to have been made
TEST_F(DatasetCommands, APartWithoutEpisodesIsRefused) {
  ExpectUsage({"dataset", "split", In("data"), In("parts"), "--parts", "train=0.99", "valid=0.01"},
              "'valid' would have no episode");
  EXPECT_FALSE(std::filesystem::exists(folder_ / "parts"));
}

TEST_F(DatasetCommands, AFilterKeySaysWhatItReplacesAndCanGo) {
  ASSERT_EQ(Etude({"dataset", "filter", In("data"), "--as", "keep", "--index", "1-3", "5"}).exit_code, kExitOk);
  const CommandOutcome again = Etude({"dataset", "filter", In("data"), "--as", "keep", "--index", "7"});
  EXPECT_EQ(again.exit_code, kExitOk);
  EXPECT_THAT(again.text, HasSubstr("in place of the 4 that it had: 1-3,5"));
  ExpectUsage({"dataset", "filter", In("data"), "--remove-key", "keep", "--index", "7"}, "alone");
  EXPECT_EQ(Etude({"dataset", "filter", In("data"), "--remove-key", "keep"}).exit_code, kExitOk);
  EXPECT_EQ(Etude({"dataset", "filter", In("data"), "--remove-key", "keep"}).exit_code, kExitFailure) << "gone";
  EXPECT_EQ(List("data").size(), 9u);
}

TEST_F(DatasetCommands, NothingIsWrittenOverWhatIsThere) {
  WriteFile("parts/mine.txt", "mine");
  ExpectUsage({"dataset", "split", In("data"), In("parts"), "--by", "task"}, "is there already");
  ExpectUsage({"dataset", "filter", In("data"), In("parts"), "--task", "pick"}, "is there already");
  ExpectUsage({"dataset", "merge", In("data"), In("data"), "--out", In("parts")}, "is there already");
  EXPECT_EQ(ReadTextFile(folder_ / "parts/mine.txt").value_or(""), "mine");
}

TEST_F(DatasetCommands, AnUnknownEpisodeDeletesNone) {
  EXPECT_NE(Etude({"dataset", "delete", In("data"), "--index", "3", "77", "--yes"}).exit_code, kExitOk);
  EXPECT_EQ(List("data").size(), 9u);
  EXPECT_NE(Etude({"dataset", "delete", In("data"), "--key", "none", "--yes"}).exit_code, kExitOk);
  EXPECT_EQ(List("data").size(), 9u);
  ASSERT_EQ(Etude({"dataset", "delete", In("data"), "--index", "3", "--yes"}).exit_code, kExitOk);
  EXPECT_EQ(List("data").size(), 8u);
}

TEST_F(DatasetCommands, ExportsAreOfTheVersionAndTheEpisodesThatAreAskedFor) {
  const CommandOutcome old =
      Etude({"dataset", "export", In("data"), In("old"), "--format", "lerobot", "--version", "2.1", "--task", "pick"});
  ASSERT_EQ(old.exit_code, kExitOk) << old.text;
  const auto info = OrderedJson::parse(ReadTextFile(folder_ / "old/meta/info.json").value_or(""), nullptr, false);
  EXPECT_EQ(info["codebase_version"], "v2.1");
  EXPECT_EQ(info["total_episodes"], OfTask("pick").size());
  EXPECT_THAT(old.text, HasSubstr("LeRobot 2.1"));
  ExpectUsage({"dataset", "export", In("data"), In("x"), "--format", "lerobot", "--version", "2.0"}, "2.0");
  ExpectUsage({"dataset", "export", In("data"), In("x")}, "--format");
  ExpectUsage({"dataset", "export", In("data"), In("x"), "--format", "robomimic", "--version", "2.1"}, "LeRobot");
  ASSERT_TRUE(std::filesystem::create_directory(folder_ / "folder"));
  ExpectUsage({"dataset", "export", In("data"), In("folder"), "--format", "robomimic"}, "name the file");

  ASSERT_EQ(
      Etude({"dataset", "export", In("data"), In("some.hdf5"), "--format", "robomimic", "--index", "2", "5"}).exit_code,
      kExitOk);
  EXPECT_TRUE(std::filesystem::exists(folder_ / "some.hdf5"));
}

}  // namespace dataset_commands_test
}  // namespace etude
