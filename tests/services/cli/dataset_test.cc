// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/dataset.cc and dataset_edit.cc over datasets that are whole, damaged or not there.
#include <fmt/format.h>

#include "services/campaign/history.h"
#include "services/core/command.h"
#include "tests/services/cli/cli_fixture.h"

namespace etude {
namespace dataset_test {

using testing::HasSubstr;

using Outcome = CommandOutcome;

class DatasetCli : public CliFixture {};

TEST_F(DatasetCli, AFolderIsEitherACopyOrGoesOn) {
  const std::string spec = WriteFile("c.yaml", "name: x\n");
  const Outcome outcome = Etude({"collect", spec, "--out", In("d"), "--new-id", "--adopt"});
  EXPECT_EQ(outcome.exit_code, kExitUsage) << outcome.text;
  EXPECT_THAT(Etude({"collect", "--help"}).text, HasSubstr("--adopt"));
}

TEST_F(DatasetCli, AFolderWithoutADatasetSaysHowToMakeOne) {
  const Outcome outcome = Etude({"dataset", "info", In("none")});
  EXPECT_EQ(outcome.exit_code, kExitFailure);
  EXPECT_THAT(outcome.text, HasSubstr("`etude collect` makes one"));
}

TEST_F(DatasetCli, DatasetCommandsFindAFlippedBit) {
  const CampaignSpec spec = SyntheticSpec();
  {
    auto writer = store::DatasetWriter::Open(folder_ / "data", spec);
    ASSERT_TRUE(writer) << writer.error().message;
    for (std::uint64_t i = 0; i < 3; ++i) ASSERT_TRUE(writer->Commit(MakeSyntheticEpisode(spec, i, 10)));
    ASSERT_TRUE(writer->WriteMaster());
  }
  const Outcome hash = Etude({"dataset", "hash", In("data")});
  EXPECT_EQ(hash.exit_code, kExitOk) << hash.text;
  EXPECT_EQ(hash.text.size(), 65u) << hash.text;
  EXPECT_EQ(Etude({"dataset", "info", In("data")}).exit_code, kExitOk);
  EXPECT_THAT(Etude({"dataset", "verify", In("data")}).text, HasSubstr("3 good, 0 bad"));

  const Path file = store::EpisodePath(folder_ / "data", 1);
  auto bytes = ReadBinaryFile(file).value();
  bytes[bytes.size() / 2] ^= 0x10;
  ASSERT_TRUE(WriteFileAtomically(file, bytes));

  EXPECT_EQ(Etude({"dataset", "verify", "--keep", In("data")}).exit_code, kExitFailure);
  EXPECT_TRUE(std::filesystem::exists(file));
  const Outcome verify = Etude({"dataset", "verify", In("data")});
  EXPECT_EQ(verify.exit_code, kExitFailure);
  EXPECT_THAT(verify.text, HasSubstr("2 good, 1 bad"));
  EXPECT_THAT(verify.text, HasSubstr("000001.hdf5"));
  EXPECT_FALSE(std::filesystem::exists(file)) << "quarantined";
  EXPECT_EQ(Etude({"dataset", "verify", In("data")}).exit_code, kExitOk);
}

TEST_F(DatasetCli, AReplayOfWhatAnotherVersionMadeSaysSo) {
  WriteDataset("data", {0});
  // refused for its --out, which comes after what is said of the dataset
  const std::vector<std::string> replay{"attempt", "replay", In("data"), "--index", "0", "--out", In("data")};
  const Outcome same = Etude(replay);
  EXPECT_NE(same.exit_code, kExitOk);
  EXPECT_THAT(same.text, testing::Not(HasSubstr("another version")));

  const Path file = folder_ / "data/dataset.json";
  auto description = OrderedJson::parse(ReadTextFile(file).value());
  description["content"] = 1;
  ASSERT_TRUE(WriteFileAtomically(file, std::string_view(description.dump())));
  EXPECT_THAT(Etude(replay).text, HasSubstr("another version (content 1, here"));
}

TEST_F(DatasetCli, DatasetInfoCountsWhatIsThere) {
  WriteDataset("data", {0, 1, 2, 3});
  const OrderedJson info = JsonOf({"dataset", "info", In("data")});
  ASSERT_TRUE(info.is_object());
  const OrderedJson& statistics = info["statistics"];
  EXPECT_EQ(statistics["episodes"], 4);
  EXPECT_EQ(statistics["successes"], 4);
  EXPECT_EQ(statistics["steps"], 40);
  EXPECT_NEAR(statistics["seconds"].get<double>(), 40 * 0.008, 1e-12);
  EXPECT_EQ(statistics["frames"], 4 * 2) << "each fifth of ten steps";
  EXPECT_EQ(statistics["tasks"], (OrderedJson{{"pick", 2}, {"push", 1}, {"put_down", 1}})) << "they take turns";
  std::uint64_t bytes = 0, split = 0;
  for (std::uint64_t i = 0; i < 4; ++i) bytes += std::filesystem::file_size(store::EpisodePath(folder_ / "data", i));
  EXPECT_EQ(statistics["bytes"], bytes);
  for (const auto& [name, count] : statistics["splits"].items()) split += count.get<std::uint64_t>();
  EXPECT_EQ(split, 4u);
  EXPECT_EQ(info["failed_attempts"], (OrderedJson{{"plan_failed", 2}}));
  EXPECT_THAT(info.dump(), HasSubstr("\"shape\":[\"N\",32,32,3]")) << "what its pictures are";

  const Outcome text = Etude({"dataset", "info", In("data")});
  EXPECT_EQ(text.exit_code, kExitOk);
  const auto yaml = ParseYaml(text.text, "info");
  ASSERT_TRUE(yaml) << text.text;
  EXPECT_EQ((*yaml)["statistics"]["frames"], 8) << "the same as YAML";
}

TEST_F(DatasetCli, DatasetHashIsOfTheContentNotOfHowItCameThere) {
  WriteDataset("a", {0, 1, 2});
  WriteDataset("b", {2, 0, 1});
  WriteDataset("c", {0, 1, 3});
  const auto hash = [&](const std::string& name) { return Etude({"dataset", "hash", In(name)}).text; };
  EXPECT_EQ(hash("a"), hash("b"));
  EXPECT_NE(hash("a"), hash("c"));
}

TEST_F(DatasetCli, DatasetSheetIsWrittenWhereItIsAskedFor) {
  WriteDataset("data", {0, 1});
  const Outcome outcome =
      Etude({"dataset", "sheet", In("data"), "--out", In("sheet.jpg"), "--index", "1", "--frames", "2"});
  EXPECT_EQ(outcome.exit_code, kExitOk) << outcome.text;
  EXPECT_EQ(outcome.text, In("sheet.jpg") + "\n");
  EXPECT_GT(std::filesystem::file_size(In("sheet.jpg")), 500u);
  EXPECT_EQ(Etude({"dataset", "sheet", In("data"), "--out", In("none.png"), "--frames", "0"}).exit_code, kExitUsage);
  EXPECT_EQ(Etude({"dataset", "sheet", In("data"), "--out", In("none.png"), "--index", "7"}).exit_code, kExitFailure);
  EXPECT_FALSE(std::filesystem::exists(In("none.png")));
}

TEST_F(DatasetCli, DatasetThatIsNotThereIsNoUsageError) {
  const Outcome outcome = Etude({"dataset", "info", In("none")});
  EXPECT_EQ(outcome.exit_code, kExitFailure);
  EXPECT_THAT(outcome.text, HasSubstr("none"));
}

TEST_F(DatasetCli, TakesDatasetsApartAndTogether) {
  WriteDataset("data", {0, 1, 2, 3, 4, 5});
  EXPECT_THAT(Etude({"dataset", "filter", In("data"), In("a"), "--index", "0-2", "5"}).text, HasSubstr("4 episodes"));
  EXPECT_THAT(Etude({"dataset", "filter", In("data"), In("b"), "--index", "3", "4"}).text, HasSubstr("2 episodes"));
  EXPECT_EQ(Etude({"dataset", "merge", In("a"), In("b"), "--out", In("all")}).exit_code, kExitOk);
  EXPECT_EQ(Etude({"dataset", "hash", In("all")}).text, Etude({"dataset", "hash", In("data")}).text);

  EXPECT_EQ(Etude({"dataset", "filter", In("all"), "--as", "keep", "--index", "1", "4"}).exit_code, kExitOk);
  const Outcome asked = Etude({"dataset", "delete", In("all"), "--key", "keep"});
  EXPECT_EQ(asked.exit_code, kExitUsage);
  EXPECT_THAT(asked.text, HasSubstr("would delete 2 episodes for good: 1, 4; --yes does"));
  EXPECT_EQ(Etude({"dataset", "delete", In("all"), "--key", "keep", "--yes"}).exit_code, kExitOk);
  EXPECT_THAT(Etude({"dataset", "verify", In("all")}).text, HasSubstr("4 good, 0 bad"));
  EXPECT_EQ(Etude({"dataset", "delete", In("all"), "--yes"}).exit_code, kExitUsage);  // everything is never meant

  const Outcome split = Etude({"dataset", "split", In("data"), In("parts"), "--parts", "train=0.5", "valid=0.5"});
  EXPECT_EQ(split.exit_code, kExitOk) << split.text;
  EXPECT_THAT(Etude({"dataset", "verify", In("parts/valid")}).text, HasSubstr("3 good, 0 bad"));
  EXPECT_EQ(Etude({"dataset", "filter", In("data"), In("c"), "--index", "9-3"}).exit_code, kExitUsage);
  EXPECT_EQ(Etude({"dataset", "filter", In("data"), In("c"), "--robot", "panda"}).exit_code, kExitFailure);
}

// made with other files of robots or objects, say: one spec, and not one dataset
TEST_F(DatasetCli, MergesOnlyShardsOfHostsThatAgree) {
  WriteDataset("a", {0, 2});
  WriteDataset("b", {1});
  for (const char* name : {"a", "b"}) {
    ASSERT_TRUE(campaign::RememberEpoch(folder_ / name, 1));
    ASSERT_TRUE(campaign::RememberFiles(folder_ / name, std::string(64, name[0])));
  }
  const Outcome other = Etude({"dataset", "merge", In("a"), In("b"), "--out", In("all")});
  EXPECT_EQ(other.exit_code, kExitUsage) << other.text;
  EXPECT_THAT(other.text, HasSubstr("hosts that differ"));
  ASSERT_TRUE(campaign::RememberFiles(folder_ / "b", std::string(64, 'a')));
  const Outcome same = Etude({"dataset", "merge", In("a"), In("b"), "--out", In("all")});
  EXPECT_EQ(same.exit_code, kExitOk) << same.text;
  EXPECT_EQ(campaign::KnownFiles(folder_ / "all"), std::string(64, 'a')) << "who collects there is held to them";
  // nor does a copy forget them
  ASSERT_EQ(Etude({"dataset", "filter", In("a"), In("some"), "--index", "2"}).exit_code, kExitOk);
  EXPECT_EQ(campaign::KnownFiles(folder_ / "some"), std::string(64, 'a'));
  ASSERT_EQ(Etude({"dataset", "split", In("a"), In("parts"), "--parts", "x=1", "y=1"}).exit_code, kExitOk);
  EXPECT_EQ(campaign::KnownFiles(folder_ / "parts/y"), std::string(64, 'a'));
}

TEST_F(DatasetCli, LinksShards) {
  WriteDataset("data", {0, 1, 2});
  WriteDataset("a", {0, 2});
  WriteDataset("b", {1});
  const Outcome linked = Etude({"dataset", "link", In("a"), In("b"), "--out", In("all")});
  EXPECT_EQ(linked.exit_code, kExitOk) << linked.text;
  EXPECT_THAT(linked.text, HasSubstr(fmt::format("3 of {} episodes", SyntheticSpec().episodes)));
  EXPECT_EQ(Etude({"dataset", "hash", In("all")}).text, Etude({"dataset", "hash", In("data")}).text);
  EXPECT_THAT(Etude({"dataset", "verify", In("all")}).text, HasSubstr("3 good, 0 bad"));
  const Outcome twice = Etude({"dataset", "link", In("data"), In("b"), "--out", In("more")});
  EXPECT_EQ(twice.exit_code, kExitUsage);
  EXPECT_THAT(twice.text, HasSubstr("both have episode 1"));
}

TEST_F(DatasetCli, NumbersOfEpisodesEndAtTheLargestThereIs) {
  WriteDataset("data", {0, 1});
  const auto filter = [&](const std::vector<std::string>& indices) {
    std::vector<std::string> arguments{"dataset", "filter", In("data"), In("c"), "--index"};
    arguments.insert(arguments.end(), indices.begin(), indices.end());
    return Etude(arguments);
  };
  const Outcome last = filter({"18446744073709551614-18446744073709551615"});
  EXPECT_EQ(last.exit_code, kExitFailure) << last.text;
  EXPECT_THAT(last.text, HasSubstr("has no episode 18446744073709551614"));
  const Outcome many = filter({"0-10000000"});
  EXPECT_EQ(many.exit_code, kExitUsage) << many.text;
  EXPECT_THAT(many.text, HasSubstr("at most 10000000 in all"));
}

TEST_F(DatasetCli, ExportsForOthers) {
  WriteDataset("data", {0, 1});
  const Outcome lerobot = Etude({"dataset", "export", In("data"), In("lerobot"), "--format", "lerobot"});
  EXPECT_EQ(lerobot.exit_code, kExitOk) << lerobot.text;
  EXPECT_TRUE(std::filesystem::exists(folder_ / "lerobot/meta/info.json"));
  EXPECT_EQ(Etude({"dataset", "export", In("data"), In("lerobot"), "--format", "lerobot"}).exit_code, kExitUsage);
  EXPECT_EQ(Etude({"dataset", "export", In("data"), In("r.hdf5"), "--format", "robomimic"}).exit_code, kExitOk);
  EXPECT_TRUE(std::filesystem::exists(folder_ / "r.hdf5.train_data.json"));
  EXPECT_EQ(Etude({"dataset", "export", In("data"), In("x"), "--format", "rlds"}).exit_code, kExitUsage);
  EXPECT_EQ(Etude({"dataset", "import", In("none"), In("x"), "--format", "modattn"}).exit_code, kExitFailure);
}

}  // namespace dataset_test
}  // namespace etude
