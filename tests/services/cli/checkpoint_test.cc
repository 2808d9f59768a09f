// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/checkpoint.cc: show, watch, promote and export.
#include "services/core/command.h"
#include "services/core/hash.h"
#include "tests/services/cli/cli_fixture.h"

namespace etude {
namespace checkpoint_test {

using testing::HasSubstr;

using Outcome = CommandOutcome;

class CheckpointCli : public CliFixture {};

TEST_F(CheckpointCli, CheckpointShowListsTensorsAndMetadata) {
  store::Safetensors content;
  content.metadata = {
      {"run", "demo"},
      {"step", "12"},
      {"config", R"({"policy": {"width": 64}})"},
      {"embodiment", R"({"robot": "ur5", "joints": 7, "width": 224, "height": 224, "fovy": 1.0472,
       "camera_pose": [0, 1.5, 1, 1, 0, 0, 0]})"},
      {"modules", R"({"TAR3D": {"trained_steps": 1161, "error": 0.0021}, "DISP": {"trained_steps": 3}})"}};
  content.tensors["TAR3D.register"] = {store::DType::kF32, {2, 3}, std::vector<std::uint8_t>(24)};
  ASSERT_TRUE(store::WriteSafetensors(folder_ / "a.safetensors", content));

  const Outcome brief = Etude({"checkpoint", "show", In("a.safetensors")});
  EXPECT_EQ(brief.exit_code, kExitOk) << brief.text;
  EXPECT_THAT(brief.text, HasSubstr("run: demo, step 12"));
  EXPECT_THAT(
      brief.text,
      HasSubstr("trained for: ur5, 7 joints, pictures of 224x224 px, 60.0 degrees, camera at (0.00, 1.50, 1.00) m"));
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

TEST_F(CheckpointCli, CheckpointShowSaysThatACameraMayMove) {
  WriteCheckpoint("moving.safetensors",
                  {{"embodiment", R"({"robot": "ur5", "joints": 7, "width": 224, "height": 224, "fovy": 0})"}});
  EXPECT_THAT(Etude({"checkpoint", "show", In("moving.safetensors")}).text,
              HasSubstr("224x224 px, any field of view, any place of the camera"));
}

TEST_F(CheckpointCli, CheckpointShowRefusesWhatIsNone) {
  const Outcome outcome = Etude({"checkpoint", "show", WriteFile("b.safetensors", "not a checkpoint")});
  EXPECT_EQ(outcome.exit_code, kExitFailure);
  EXPECT_THAT(outcome.text, HasSubstr("b.safetensors"));
}

TEST_F(CheckpointCli, CheckpointShowIsJsonForPrograms) {
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

TEST_F(CheckpointCli, CheckpointShowSaysWhetherItMayDriveARobot) {
  WriteCheckpoint("old.safetensors", {{"run", "demo"}});
  WriteCheckpoint("good.safetensors", {{"refused", ""}});
  WriteCheckpoint("bad.safetensors", {{"refused", "DISP was not trained"}});
  const auto said = [&](const std::string& name) { return Etude({"checkpoint", "show", In(name)}).text; };
  EXPECT_THAT(said("old.safetensors"), HasSubstr("may drive a robot: not said by this older checkpoint"));
  EXPECT_THAT(said("good.safetensors"), HasSubstr("may drive a robot: yes\n"));
  EXPECT_THAT(said("bad.safetensors"), HasSubstr("may drive a robot: NO, the policy server refuses it: DISP was not"));
}

TEST_F(CheckpointCli, CheckpointShowPrintsNothingThatMovesACursor) {
  WriteCheckpoint("a.safetensors", {{"run", "a\x1b[2Jb"},
                                    {"refused", "no\x1b[1A"},
                                    {"embodiment", R"({"robot": "ur5\u001b[1A"})"},
                                    {"modules", R"({"TAR3D\u001b[1A": {"error": 1}})"},
                                    {"metrics", R"({"loss\u001b[1A": 1})"}});
  const Outcome shown = Etude({"checkpoint", "show", "--all", In("a.safetensors")});
  EXPECT_EQ(shown.exit_code, kExitOk) << shown.text;
  EXPECT_THAT(shown.text, HasSubstr("NO, the policy server refuses it: no [1A"));
  EXPECT_THAT(shown.text, testing::Not(HasSubstr("\x1b")));
}

TEST_F(CheckpointCli, WatchingNamesARunAndAChannel) {
  EXPECT_EQ(Etude({"checkpoint", "watch", "--out", In("w")}).exit_code, kExitUsage);
  EXPECT_EQ(Etude({"checkpoint", "watch", "--run", "x", "--out", In("w"), "--channel", "newest"}).exit_code,
            kExitUsage);
  const Outcome outcome = Etude({"checkpoint", "watch", "--run", "Not A Name", "--out", In("w")});
  EXPECT_EQ(outcome.exit_code, kExitUsage);
  EXPECT_THAT(outcome.text, HasSubstr("--run 'Not A Name'"));
  EXPECT_FALSE(std::filesystem::exists(In("w")));
}

TEST_F(CheckpointCli, PromotingPointsBestAtACheckpointOfTheRun) {
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
  std::filesystem::create_symlink("00001500.safetensors", folder_ / "run/checkpoints/latest.safetensors");
  for (const char* name : {"latest.safetensors", "latest"}) {
    ASSERT_EQ(Etude({"checkpoint", "promote", In("run"), "2000"}).exit_code, kExitOk);
    EXPECT_EQ(Etude({"checkpoint", "promote", In("run"), name}).exit_code, kExitOk) << name;
    EXPECT_EQ(std::filesystem::read_symlink(best), "00001500.safetensors") << name << ": what the link names";
  }
  ASSERT_EQ(Etude({"checkpoint", "promote", In("run"), "2000"}).exit_code, kExitOk);
  for (const char* other : {"7", "newest", "../config.yaml", ""}) {
    const Outcome refused = Etude({"checkpoint", "promote", In("run"), other});
    EXPECT_NE(refused.exit_code, kExitOk) << other;
    EXPECT_EQ(std::filesystem::read_symlink(best), "00002000.safetensors") << other;
  }
}

TEST_F(CheckpointCli, PromotingRefusesACheckpointOfAnotherRun) {
  ASSERT_TRUE(MakeFolders(folder_ / "run/checkpoints"));
  ASSERT_TRUE(MakeFolders(folder_ / "other/checkpoints"));
  WriteCheckpoint("run/checkpoints/00001500.safetensors", {{"refused", ""}});
  WriteCheckpoint("other/checkpoints/00001500.safetensors", {{"refused", ""}});
  const Outcome refused = Etude({"checkpoint", "promote", In("run"), In("other/checkpoints/00001500.safetensors")});
  EXPECT_NE(refused.exit_code, kExitOk) << refused.text;
  EXPECT_THAT(refused.text, HasSubstr("other/checkpoints/00001500.safetensors"));
  EXPECT_FALSE(std::filesystem::is_symlink(folder_ / "run/checkpoints/best.safetensors"));
}

TEST_F(CheckpointCli, ExportOfACheckpointThatIsNotThereNamesIt) {
  const Outcome outcome =
      Etude({"checkpoint", "export", In("none.safetensors"), In("out.pt"), "--format", "torchscript"});
  EXPECT_EQ(outcome.exit_code, kExitFailure) << outcome.text;
  EXPECT_THAT(outcome.text, HasSubstr("none.safetensors"));
}

}  // namespace checkpoint_test
}  // namespace etude
