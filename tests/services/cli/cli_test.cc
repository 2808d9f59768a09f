// SPDX-License-Identifier: Apache-2.0
// Tests services/cli: the program as a user meets it. Exit codes, messages, help.
#include "services/core/hash.h"
#include "tests/services/cli/cli_fixture.h"

namespace etude {
namespace cli_test {

using testing::HasSubstr;
using testing::Not;

using Outcome = CommandOutcome;

class Cli : public CliFixture {};

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
                                                       {"dataset", "filter"},
                                                       {"dataset", "split"},
                                                       {"dataset", "merge"},
                                                       {"dataset", "delete"},
                                                       {"dataset", "export"},
                                                       {"dataset", "import"},
                                                       {"checkpoint"},
                                                       {"checkpoint", "show"},
                                                       {"checkpoint", "promote"},
                                                       {"checkpoint", "watch"},
                                                       {"top"},
                                                       {"campaign"},
                                                       {"campaign", "list"},
                                                       {"campaign", "status"},
                                                       {"campaign", "drain"},
                                                       {"topic", "list"},
                                                       {"topic", "echo"},
                                                       {"topic", "hz"},
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
  EXPECT_THAT(Etude({"config", "describe", "results"}).text,
              HasSubstr("rows[].train.minutes  (number, min, default 0.0)\n    of training"));
  EXPECT_EQ(Etude({"config", "describe", "nothing"}).exit_code, kExitUsage);
}

// The shell of a user: `etude … | head`, but that the reader has gone for certain before etude prints.
TEST_F(Cli, IsEndedQuietlyByAReaderThatHasGone) {
  const std::string pipeline =
      R"(mkfifo "$1" && { read -r gone <"$1"; "$2" config describe campaign; echo "status $?" >&2; } |
         { exec <&-; echo gone >"$1"; })";
  auto process = campaign::Process::Start(
      {.argv = {"/bin/sh", "-c", pipeline, "sh", In("gone"), (ProgramsFolder() / "etude").string()},
       .log = folder_ / "output.txt"});
  ASSERT_TRUE(process) << process.error().message;
  ASSERT_TRUE(process->Wait(std::chrono::seconds(60)));
  EXPECT_EQ(ReadTextFile(folder_ / "output.txt").value_or(""), "status 141\n");
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

TEST_F(Cli, EvalSaysWhatIsWrongWithItsSuites) {
  const std::string checkpoint = WriteFile("a.safetensors", "short");
  for (const auto& [wrong, says] : std::vector<std::pair<std::vector<std::string>, std::string>>{
           {{"--occlude", "1.5"}, "--occlude"},
           {{"--pushes", "11"}, "--pushes"},
           {{"--scenes-each", "3"}, "--sentences"},
           {{"--sentences", "table11", "--tasks", "pick"}, "--tasks"},
           {{"--sentences", "table11", "--episodes", "9"}, "--episodes"}}) {
    std::vector<std::string> arguments{"eval", "--checkpoint", checkpoint, "--out", In("e")};
    arguments.insert(arguments.end(), wrong.begin(), wrong.end());
    const Outcome outcome = Etude(arguments);
    EXPECT_EQ(outcome.exit_code, kExitUsage) << wrong[0];
    EXPECT_THAT(outcome.text, HasSubstr(says));
  }
  const Outcome none = Etude({"eval", "--out", In("e"), "--compare", In("nothing")});
  EXPECT_NE(none.exit_code, kExitOk);
  EXPECT_THAT(none.text, HasSubstr("is no evaluation of `etude eval`"));
}

TEST_F(Cli, EvalSaysWhatAnOverlayNeeds) {
  const std::string checkpoint = WriteFile("a.safetensors", "short");
  const Outcome no_videos = Etude({"eval", "--checkpoint", checkpoint, "--out", In("e"), "--overlay", "--videos", "0"});
  EXPECT_EQ(no_videos.exit_code, kExitUsage) << no_videos.text;
  EXPECT_THAT(no_videos.text, HasSubstr("--videos must be at least 1"));
  const Outcome no_policy = Etude({"eval", "--out", In("e"), "--compare", In("other"), "--overlay"});
  EXPECT_EQ(no_policy.exit_code, kExitUsage) << no_policy.text;
  EXPECT_THAT(no_policy.text, HasSubstr("--overlay asks the policy"));
  WriteCheckpoint("b.safetensors", {{"run", "demo"}});
  const Outcome no_pictures = Etude({"eval", "--checkpoint", In("b.safetensors"), "--out", In("e"), "--overlay",
                                     "--set", "rollout.record=false", "--domain", "81"});
  EXPECT_EQ(no_pictures.exit_code, kExitUsage) << no_pictures.text;
  EXPECT_THAT(no_pictures.text, HasSubstr("rollout.record must be true"));
}

// the seed of --seed is mixed so that no scene is one that a collection drew; one from --set would not be
TEST_F(Cli, EvalRefusesASeedThatIsNotMixed) {
  WriteCheckpoint("b.safetensors", {{"run", "demo"}});
  const Outcome outcome =
      Etude({"eval", "--checkpoint", In("b.safetensors"), "--out", In("e"), "--set", "seed=7", "--domain", "81"});
  EXPECT_EQ(outcome.exit_code, kExitUsage) << outcome.text;
  EXPECT_THAT(outcome.text, HasSubstr("--set seed: say --seed, which never meets a collection's"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "e/rollouts"));
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
  content.metadata = {
      {"run", "demo"},
      {"step", "12"},
      {"config", R"({"policy": {"width": 64}})"},
      {"embodiment", R"({"robot": "ur5", "joints": 7, "width": 224, "height": 224, "fovy": 1.0472})"},
      {"modules", R"({"TAR3D": {"trained_steps": 1161, "error": 0.0021}, "DISP": {"trained_steps": 3}})"}};
  content.tensors["TAR3D.register"] = {store::DType::kF32, {2, 3}, std::vector<std::uint8_t>(24)};
  ASSERT_TRUE(store::WriteSafetensors(folder_ / "a.safetensors", content));

  const Outcome brief = Etude({"checkpoint", "show", In("a.safetensors")});
  EXPECT_EQ(brief.exit_code, kExitOk) << brief.text;
  EXPECT_THAT(brief.text, HasSubstr("run: demo, step 12"));
  EXPECT_THAT(brief.text, HasSubstr("trained for: ur5, 7 joints, pictures of 224x224 px, 60.0 degrees"));
  EXPECT_THAT(brief.text, HasSubstr("TAR3D            1161 steps   error 0.0021"));
  EXPECT_THAT(brief.text, HasSubstr("DISP                3 steps   error -"));
  EXPECT_THAT(brief.text, testing::Not(HasSubstr("width: 64")));

  const Outcome outcome = Etude({"checkpoint", "show", "--all", In("a.safetensors")});
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

TEST_F(Cli, DatasetInfoCountsWhatIsThere) {
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

TEST_F(Cli, DatasetHashIsOfTheContentNotOfHowItCameThere) {
  WriteDataset("a", {0, 1, 2});
  WriteDataset("b", {2, 0, 1});
  WriteDataset("c", {0, 1, 3});
  const auto hash = [&](const std::string& name) { return Etude({"dataset", "hash", In(name)}).text; };
  EXPECT_EQ(hash("a"), hash("b"));
  EXPECT_NE(hash("a"), hash("c"));
}

TEST_F(Cli, DatasetSheetIsWrittenWhereItIsAskedFor) {
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

TEST_F(Cli, CheckpointShowIsJsonForPrograms) {
  WriteCheckpoint("a.safetensors", {{"run", "demo"}, {"config", R"({"width": 64})"}, {"step", "12"}});
  const OrderedJson shown = JsonOf({"checkpoint", "show", In("a.safetensors")});
  ASSERT_TRUE(shown.is_object());
  EXPECT_EQ(shown["sha256"], Sha256Hex(ReadBinaryFile(In("a.safetensors")).value()));
  EXPECT_EQ(shown["metadata"]["config"]["width"], 64) << "what has a structure is shown with it";
  EXPECT_EQ(shown["metadata"]["step"], "12") << "and text as text";
  EXPECT_EQ(shown["tensors"]["TAR3D.register"]["shape"], (OrderedJson{2, 3}));
  EXPECT_EQ(shown["tensors"]["step"]["shape"], OrderedJson::array());
  EXPECT_THAT(Etude({"checkpoint", "show", In("a.safetensors")}).text, HasSubstr("2 tensors, 7 numbers"));
}

TEST_F(Cli, CheckpointShowSaysWhetherItMayDriveARobot) {
  WriteCheckpoint("old.safetensors", {{"run", "demo"}});
  WriteCheckpoint("good.safetensors", {{"refused", ""}});
  WriteCheckpoint("bad.safetensors", {{"refused", "DISP was not trained"}});
  const auto said = [&](const std::string& name) { return Etude({"checkpoint", "show", In(name)}).text; };
  EXPECT_THAT(said("old.safetensors"), HasSubstr("may drive a robot: not said by this older checkpoint"));
  EXPECT_THAT(said("good.safetensors"), HasSubstr("may drive a robot: yes\n"));
  EXPECT_THAT(said("bad.safetensors"), HasSubstr("may drive a robot: NO, the policy server refuses it: DISP was not"));
}

TEST_F(Cli, WatchingNamesARunAndAChannel) {
  EXPECT_EQ(Etude({"checkpoint", "watch", "--out", In("w")}).exit_code, kExitUsage);
  EXPECT_EQ(Etude({"checkpoint", "watch", "--run", "x", "--out", In("w"), "--channel", "newest"}).exit_code,
            kExitUsage);
  const Outcome outcome = Etude({"checkpoint", "watch", "--run", "Not A Name", "--out", In("w")});
  EXPECT_EQ(outcome.exit_code, kExitUsage);
  EXPECT_THAT(outcome.text, HasSubstr("--run 'Not A Name'"));
  EXPECT_FALSE(std::filesystem::exists(In("w")));
}

TEST_F(Cli, EveryDescribedKeyIsOneThatCampaignsTake) {
  const OrderedJson keys = JsonOf({"config", "describe", "campaign"});
  ASSERT_GT(keys.size(), 40u);
  std::vector<std::string> arguments{
      "collect", WriteFile("c.yaml", ""), "--out", WriteFile("file", "") + "/below", "--domain", "81"};
  for (const auto& key : keys) {
    EXPECT_FALSE(key["meaning"].get<std::string>().empty() && key["type"] != "section") << key["key"];
    // keys of a list's items have no path of their own
    if (key["type"] == "section" || key["key"].get<std::string>().find("[]") != std::string::npos) continue;
    arguments.insert(arguments.end(),
                     {"--set", key["key"].get<std::string>() + "=" + key["default"].get<std::string>()});
  }
  // all keys at their defaults are the default campaign, which gets as far as the folder that cannot be made
  const Outcome outcome = Etude(arguments);
  EXPECT_NE(outcome.exit_code, kExitUsage) << outcome.text;
  EXPECT_NE(outcome.exit_code, kExitOk);
  EXPECT_THAT(outcome.text, HasSubstr("file"));
}

TEST_F(Cli, HeldOutWordsDependOnWhatIsTrained) {
  const OrderedJson three = JsonOf({"language", "held-out"});
  const OrderedJson one = JsonOf({"language", "held-out", "--tasks", "push", "--objects", "cube", "coke"});
  ASSERT_TRUE(three.is_object() && one.is_object());
  EXPECT_EQ(three["table_11"].size(), 30u);
  EXPECT_EQ(three["table_8"].size(), 50u);
  EXPECT_LT(one["seen"].size(), three["seen"].size());
  EXPECT_THAT(three["seen"].dump(), HasSubstr("\"raise\""));
  EXPECT_THAT(one["seen"].dump(), Not(HasSubstr("\"raise\""))) << "only pushing was said";
  const Outcome unknown = Etude({"language", "held-out", "--tasks", "pussh"});
  EXPECT_EQ(unknown.exit_code, kExitUsage);
  EXPECT_THAT(unknown.text, HasSubstr("did you mean 'push'?"));
}

TEST_F(Cli, UpNamesWhatIsMissingInItsFile) {
  for (const auto& [text, says] : std::initializer_list<std::pair<const char*, const char*>>{
           {"", "campaign: name a campaign file"},
           {"campaign: c.yaml\ntrain: {run: My Run}\n", "train.run: 'My Run' must match"},
           {"campaign: none.yaml\n", "none.yaml"},
           {"campaign: bad.yaml\n", "did you mean 'pick'?"},
           {"campaign: c.yaml\ncampaign_set: [episodes=0]\n", "episodes: 0 not in"}}) {
    WriteFile("c.yaml", "name: x\n");
    WriteFile("bad.yaml", "tasks: [pik]\n");
    const Outcome outcome = Etude({"up", WriteFile("up.yaml", text), "--out", In("out")});
    EXPECT_EQ(outcome.exit_code, kExitUsage) << text << outcome.text;
    EXPECT_THAT(outcome.text, HasSubstr(says)) << text;
  }
  EXPECT_EQ(Etude({"up", In("none.yaml")}).exit_code, kExitFailure);
  EXPECT_EQ(Etude({"up", In("up.yaml"), "--workers", "0"}).exit_code, kExitUsage);
  EXPECT_FALSE(std::filesystem::exists(In("out"))) << "nothing was made";
}

TEST_F(Cli, UpSaysWhatIsWrongWithItsEvaluationBeforeItStarts) {
  WriteFile("c.yaml", "name: x\n");
  for (const auto& [text, says] :
       std::initializer_list<std::pair<const char*, const char*>>{{"eval: {tasks: [pik]}", "eval: campaign 'eval-"},
                                                                  {"eval: {tasks: [pik]}", "did you mean 'pick'?"},
                                                                  {"eval: {episodes: 0}", "episodes: 0 not in"},
                                                                  {"workers: -1", "workers: -1 not in 0..100"},
                                                                  {"workers: 101", "workers: 101 not in 0..100"}}) {
    const std::string file = WriteFile("up.yaml", std::string("campaign: c.yaml\n") + text + "\n");
    const Outcome outcome = Etude({"up", file, "--out", In("out"), "--domain", "81"});
    EXPECT_EQ(outcome.exit_code, kExitUsage) << text << outcome.text;
    EXPECT_THAT(outcome.text, HasSubstr(says)) << text;
  }
  EXPECT_FALSE(std::filesystem::exists(In("out"))) << "nothing was made";
}

TEST_F(Cli, CollectionsOptionsAreChecked) {
  const std::string spec = WriteFile("c.yaml", "name: x\n");
  for (const std::vector<std::string>& wrong : std::vector<std::vector<std::string>>{{"--workers", "101"},
                                                                                     {"--workers", "-1"},
                                                                                     {"--episodes", "0"},
                                                                                     {"--seed", "one"},
                                                                                     {"--domain", "231"},
                                                                                     {"--set", "seed"},
                                                                                     {"--frobnicate"}}) {
    std::vector<std::string> arguments{"collect", spec, "--out", In("d")};
    arguments.insert(arguments.end(), wrong.begin(), wrong.end());
    EXPECT_EQ(Etude(arguments).exit_code, kExitUsage) << wrong[0];
  }
  EXPECT_EQ(Etude({"collector", spec, "--out", In("d"), "--lease", "0.1"}).exit_code, kExitUsage);
  EXPECT_FALSE(std::filesystem::exists(In("d")));
}

TEST_F(Cli, SecurityShowIsJsonForPrograms) {
  const std::string keys = In("keys");
  ASSERT_EQ(Etude({"security", "init", keys}).exit_code, kExitOk);
  for (const char* name : {"bench-1", "bench-2"})
    ASSERT_EQ(Etude({"security", "issue", keys, "--role", "worker", "--name", name}).exit_code, kExitOk);
  ASSERT_EQ(Etude({"security", "revoke", keys, "bench-2"}).exit_code, kExitOk);
  const OrderedJson issued = JsonOf({"security", "show", keys});
  ASSERT_EQ(issued.size(), 2u) << issued.dump(1);
  EXPECT_EQ(issued[0]["name"], "bench-1");
  EXPECT_EQ(issued[0]["roles"], OrderedJson::array({"worker"}));
  EXPECT_EQ(issued[0]["state"], "valid");
  EXPECT_EQ(issued[1]["state"], "revoked");
  EXPECT_GE(issued[1]["revoked"], issued[1]["not_before"]);
}

TEST_F(Cli, SaysItsVersion) {
  const Outcome outcome = Etude({"--version"});
  EXPECT_EQ(outcome.exit_code, kExitOk);
  EXPECT_EQ(outcome.text, Version() + "\n");
}

TEST_F(Cli, DatasetThatIsNotThereIsNoUsageError) {
  const Outcome outcome = Etude({"dataset", "info", In("none")});
  EXPECT_EQ(outcome.exit_code, kExitFailure);
  EXPECT_THAT(outcome.text, HasSubstr("none"));
}

TEST_F(Cli, TakesDatasetsApartAndTogether) {
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

TEST_F(Cli, NumbersOfEpisodesEndAtTheLargestThereIs) {
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

TEST_F(Cli, ExportsForOthers) {
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

TEST_F(Cli, PromotingPointsBestAtACheckpointOfTheRun) {
  ASSERT_TRUE(MakeFolders(folder_ / "run/checkpoints"));
  WriteCheckpoint("run/checkpoints/00001500.safetensors", {{"refused", ""}});
  WriteCheckpoint("run/checkpoints/00002000.safetensors", {{"refused", "TAR3D is not trained"}});
  const Path best = folder_ / "run/checkpoints/best.safetensors";
  const Outcome first = Etude({"checkpoint", "promote", In("run"), "1500"});
  EXPECT_EQ(first.exit_code, kExitOk) << first.text;
  EXPECT_EQ(std::filesystem::read_symlink(best), "00001500.safetensors");
  const Outcome second = Etude({"checkpoint", "promote", In("run"), In("run/checkpoints/00002000.safetensors")});
  EXPECT_EQ(std::filesystem::read_symlink(best), "00002000.safetensors");
  EXPECT_THAT(second.text, HasSubstr("was 00001500.safetensors"));
  EXPECT_THAT(second.text, HasSubstr("TAR3D is not trained")) << "it says what it may not do";
  for (const char* other : {"7", "best.safetensors", "../config.yaml", ""}) {
    const Outcome refused = Etude({"checkpoint", "promote", In("run"), other});
    EXPECT_NE(refused.exit_code, kExitOk) << other;
    EXPECT_EQ(std::filesystem::read_symlink(best), "00002000.safetensors") << other;
  }
}

TEST_F(Cli, PromotingRefusesACheckpointOfAnotherRun) {
  ASSERT_TRUE(MakeFolders(folder_ / "run/checkpoints"));
  ASSERT_TRUE(MakeFolders(folder_ / "other/checkpoints"));
  WriteCheckpoint("run/checkpoints/00001500.safetensors", {{"refused", ""}});
  WriteCheckpoint("other/checkpoints/00001500.safetensors", {{"refused", ""}});
  const Outcome refused = Etude({"checkpoint", "promote", In("run"), In("other/checkpoints/00001500.safetensors")});
  EXPECT_NE(refused.exit_code, kExitOk) << refused.text;
  EXPECT_THAT(refused.text, HasSubstr("other/checkpoints/00001500.safetensors"));
  EXPECT_FALSE(std::filesystem::is_symlink(folder_ / "run/checkpoints/best.safetensors"));
}

TEST_F(Cli, ExportOfACheckpointThatIsNotThereNamesIt) {
  const Outcome outcome =
      Etude({"checkpoint", "export", In("none.safetensors"), In("out.pt"), "--format", "torchscript"});
  EXPECT_EQ(outcome.exit_code, kExitFailure) << outcome.text;
  EXPECT_THAT(outcome.text, HasSubstr("none.safetensors"));
}

}  // namespace cli_test
}  // namespace etude
