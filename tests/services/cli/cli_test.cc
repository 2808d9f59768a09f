// SPDX-License-Identifier: Apache-2.0
// Tests services/cli: the program as a user meets it. Exit codes, messages, help.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "services/core/command.h"
#include "services/store/dataset.h"
#include "services/store/safetensors.h"
#include "tests/support/etude_command.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude {
namespace {

using testing::HasSubstr;
using testing::Not;

using Outcome = CommandOutcome;

class Cli : public testing::Test {
 protected:
  Outcome Etude(const std::vector<std::string>& arguments) { return RunEtude(arguments, folder_ / "output.txt"); }
  std::string WriteFile(const std::string& name, const std::string& text) {
    EXPECT_TRUE(WriteFileAtomically(folder_ / name, std::string_view(text)));
    return (folder_ / name).string();
  }
  std::string In(const std::string& name) { return (folder_ / name).string(); }

  TemporaryFolder folder_;
};

TEST_F(Cli, EveryCommandHasHelp) {
  const std::vector<std::vector<std::string>> commands{{},
                                                       {"up"},
                                                       {"collect"},
                                                       {"collector"},
                                                       {"eval"},
                                                       {"dataset"},
                                                       {"dataset", "info"},
                                                       {"dataset", "verify"},
                                                       {"dataset", "hash"},
                                                       {"checkpoint"},
                                                       {"checkpoint", "show"},
                                                       {"checkpoint", "watch"},
                                                       {"doctor"}};
  for (auto arguments : commands) {
    arguments.push_back("--help");
    const Outcome outcome = Etude(arguments);
    EXPECT_EQ(outcome.exit_code, kExitOk) << testing::PrintToString(arguments) << outcome.text;
    EXPECT_THAT(outcome.text, HasSubstr("--help"));
  }
}

TEST_F(Cli, HelpNamesEveryCommand) {
  const Outcome outcome = Etude({"--help"});
  for (const char* command : {"up", "collect", "collector", "worker", "train", "policy", "eval", "dataset",
                              "checkpoint", "config", "language", "doctor"})
    EXPECT_THAT(outcome.text, HasSubstr(std::string("\n  ") + command + " "));
}

TEST_F(Cli, DescribesConfigurations) {
  const Outcome outcome = Etude({"config", "describe", "up"});
  EXPECT_EQ(outcome.exit_code, kExitOk) << outcome.text;
  EXPECT_THAT(outcome.text, HasSubstr("train.minutes  (number, min, default 12.0)\n    how long training lasts"));
  EXPECT_THAT(Etude({"config", "describe", "campaign"}).text,
              HasSubstr("camera.fovy_deg  (number, deg, default 60.0)\n    vertical field of view"));
  EXPECT_EQ(Etude({"config", "describe", "nothing"}).exit_code, kExitUsage);
}

TEST_F(Cli, SaysWhichHeldOutWordsTrainingNeverSaw) {
  const Outcome outcome = Etude({"language", "held-out"});
  EXPECT_EQ(outcome.exit_code, kExitOk) << outcome.text;
  EXPECT_THAT(outcome.text, HasSubstr("grab, loafs"));
  EXPECT_THAT(outcome.text, HasSubstr("of 50 hold a word that training never saw"));
}

TEST_F(Cli, WrongUsageIsExitCode2) {
  EXPECT_EQ(Etude({}).exit_code, kExitUsage);
  EXPECT_EQ(Etude({"collect"}).exit_code, kExitUsage);
  EXPECT_EQ(Etude({"collect", "x.yaml", "--out", In("d"), "--workers", "many"}).exit_code, kExitUsage);
  EXPECT_EQ(Etude({"eval", "--out", In("d")}).exit_code, kExitUsage);
  EXPECT_EQ(Etude({"doctor", "--domain", "999"}).exit_code, kExitUsage);
}

TEST_F(Cli, UnknownCommandNamesTheNearest) {
  const Outcome outcome = Etude({"colect"});
  EXPECT_EQ(outcome.exit_code, kExitUsage);
  EXPECT_THAT(outcome.text, HasSubstr("did you mean 'collect'?"));
}

TEST_F(Cli, UnknownKeyNamesTheNearest) {
  const Outcome outcome = Etude({"collect", WriteFile("c.yaml", "episode: 3\n"), "--out", In("d")});
  EXPECT_EQ(outcome.exit_code, kExitUsage);
  EXPECT_THAT(outcome.text, HasSubstr("unknown key 'episode': did you mean 'episodes'?"));
  EXPECT_FALSE(std::filesystem::exists(In("d"))) << "nothing was made";
}

TEST_F(Cli, UnknownKeyInSetNamesTheNearest) {
  const Outcome outcome =
      Etude({"collect", WriteFile("c.yaml", "name: x\n"), "--out", In("d"), "--set", "camera.widht=84"});
  EXPECT_EQ(outcome.exit_code, kExitUsage);
  EXPECT_THAT(outcome.text, HasSubstr("'camera.widht': did you mean 'width'?"));
}

TEST_F(Cli, BadYamlNamesTheLine) {
  const Outcome outcome = Etude({"collector", WriteFile("c.yaml", "name: [\n"), "--out", In("d")});
  EXPECT_EQ(outcome.exit_code, kExitUsage);
  EXPECT_THAT(outcome.text, HasSubstr("c.yaml:"));
}

TEST_F(Cli, AllProblemsOfASpecAreReportedAtOnce) {
  const Outcome outcome = Etude({"collect", WriteFile("c.yaml", "tasks: [pik]\nimage_stride: 0\n"), "--out", In("d")});
  EXPECT_EQ(outcome.exit_code, kExitUsage);
  EXPECT_THAT(outcome.text, HasSubstr("'pik' is not known, did you mean 'pick'?"));
  EXPECT_THAT(outcome.text, HasSubstr("image_stride: 0"));
}

TEST_F(Cli, MissingCampaignFileIsUsage) {
  const Outcome outcome = Etude({"collect", In("none.yaml"), "--out", In("d")});
  EXPECT_EQ(outcome.exit_code, kExitUsage);
  EXPECT_THAT(outcome.text, HasSubstr("none.yaml"));
}

TEST_F(Cli, UpRefusesAnUnknownKey) {
  const Outcome outcome = Etude({"up", WriteFile("up.yaml", "campaign: c.yaml\ntrain: {minute: 3}\n")});
  EXPECT_EQ(outcome.exit_code, kExitUsage);
  EXPECT_THAT(outcome.text, HasSubstr("'train.minute': did you mean 'minutes'?"));
}

TEST_F(Cli, ShippedFilesAreValid) {
  for (const char* name : {"quickstart", "compact", "paper"}) {
    // a folder below a file cannot be made, so that a valid spec gets as far as the disk
    const std::string blocked = WriteFile("file", "");
    const Outcome outcome = Etude({"collector", std::string("deploy/campaigns/") + name + ".yaml", "--out",
                                   blocked + "/below", "--domain", "81"});
    EXPECT_NE(outcome.exit_code, kExitUsage) << outcome.text;
    EXPECT_NE(outcome.exit_code, kExitOk);
  }
}

TEST_F(Cli, EvalRefusesWhatIsNoCheckpointBeforeAnythingStarts) {
  const Outcome outcome = Etude({"eval", "--checkpoint", WriteFile("a.safetensors", "short"), "--out", In("eval")});
  EXPECT_EQ(outcome.exit_code, kExitFailure);
  EXPECT_THAT(outcome.text, HasSubstr("a.safetensors"));
  EXPECT_THAT(outcome.text, HasSubstr("safetensors: "));
  EXPECT_THAT(outcome.text, Not(HasSubstr("started again")));
}

TEST_F(Cli, EvalOfARunThatIsNotThereSaysSoInsteadOfWaiting) {
  const Outcome outcome = Etude({"eval", "--subscribe", "nobody", "--out", In("eval"), "--domain", "81"});
  EXPECT_EQ(outcome.exit_code, kExitMachine) << outcome.text;
  EXPECT_THAT(outcome.text, HasSubstr("neither a run nor a policy server"));
  EXPECT_EQ(Etude({"eval", "--subscribe", "Nobody@x", "--out", In("eval"), "--domain", "81"}).exit_code, kExitUsage);
}

TEST_F(Cli, AFolderIsEitherACopyOrGoesOn) {
  const std::string spec = WriteFile("c.yaml", "name: x\n");
  const Outcome outcome = Etude({"collect", spec, "--out", In("d"), "--new-id", "--adopt"});
  EXPECT_EQ(outcome.exit_code, kExitUsage) << outcome.text;
  EXPECT_THAT(Etude({"collect", "--help"}).text, HasSubstr("--adopt"));
}

TEST_F(Cli, AFolderWithoutADatasetSaysHowToMakeOne) {
  const Outcome outcome = Etude({"dataset", "info", In("none")});
  EXPECT_EQ(outcome.exit_code, kExitFailure);
  EXPECT_THAT(outcome.text, HasSubstr("`etude collect` makes one"));
}

TEST_F(Cli, CheckpointShowListsTensorsAndMetadata) {
  store::Safetensors content;
  content.metadata = {{"run", "demo"}, {"config", R"({"policy": {"width": 64}})"}};
  content.tensors["TAR3D.register"] = {store::DType::kF32, {2, 3}, std::vector<std::uint8_t>(24)};
  ASSERT_TRUE(store::WriteSafetensors(folder_ / "a.safetensors", content));

  const Outcome outcome = Etude({"checkpoint", "show", In("a.safetensors")});
  EXPECT_EQ(outcome.exit_code, kExitOk) << outcome.text;
  EXPECT_THAT(outcome.text, HasSubstr("TAR3D.register"));
  EXPECT_THAT(outcome.text, HasSubstr("[2, 3]"));
  EXPECT_THAT(outcome.text, HasSubstr("width: 64"));
  EXPECT_THAT(outcome.text, HasSubstr("1 tensors, 6 numbers"));
}

TEST_F(Cli, CheckpointShowRefusesWhatIsNone) {
  const Outcome outcome = Etude({"checkpoint", "show", WriteFile("b.safetensors", "not a checkpoint")});
  EXPECT_EQ(outcome.exit_code, kExitFailure);
  EXPECT_THAT(outcome.text, HasSubstr("b.safetensors"));
}

TEST_F(Cli, DatasetCommandsFindAFlippedBit) {
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

TEST_F(Cli, DatasetThatIsNotThereIsNoUsageError) {
  const Outcome outcome = Etude({"dataset", "info", In("none")});
  EXPECT_EQ(outcome.exit_code, kExitFailure);
  EXPECT_THAT(outcome.text, HasSubstr("none"));
}

}  // namespace
}  // namespace etude
