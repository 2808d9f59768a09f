// SPDX-License-Identifier: Apache-2.0
// Tests services/export/modattn.cc
#include "services/export/modattn.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "services/episode/frame_cursor.h"
#include "services/store/dataset.h"
#include "services/store/edit.h"
#include "tests/support/matchers.h"
#include "tests/support/replace_in_file.h"
#include "tests/support/temporary_folder.h"

namespace etude::exports {
namespace modattn_test {

constexpr int kSteps = 6;

OrderedJson Tracked(double x) {
  return {{"xyz", OrderedJson::array({x, 0.3, 0.05})}, {"rpy", OrderedJson::array({0.0, 0.0, 0.1})}};
}

OrderedJson Step(int t) {
  OrderedJson q = OrderedJson::array(), dq = OrderedJson::array();
  for (int i = 0; i < 7; ++i) {
    q.push_back(i == 6 ? (t < 3 ? 0.0 : 0.5) : 0.1 * i + 0.01 * t);
    dq.push_back(0.01 * i);
  }
  return {{"q", q},
          {"dq", dq},
          {"target", OrderedJson::array({0.1, 0.2, 0.3, 3.14, 0.0, 1.57})},
          {"objects_to_track",
           {{"EE", {{"xyz", OrderedJson::array({0.01 * t, 0.1, 0.2})}, {"rpy", OrderedJson::array({3.14, 0.0, 1.57})}}},
            {"target2", Tracked(-0.1)},
            {"coke", Tracked(0.2)}}},
          {"stage", t / 3},
          {"step_in_stage", t % 3},
          {"goal_object", "target2"},
          {"action_inst", "pick"}};
}

class Modattn : public testing::Test {
 protected:
  void WriteRecording(const std::string& name, int width = 32) {
    const Path folder = in_ / name;
    ASSERT_TRUE(MakeFolders(folder));
    OrderedJson states = OrderedJson::array();
    for (int t = 0; t < kSteps; ++t) {
      states.push_back(Step(t));
      cv::Mat picture(24, width, CV_8UC4, cv::Scalar(10, 20, 30 + t, 255));  // blue, green, red, opaque
      ASSERT_TRUE(cv::imwrite((folder / fmt::format("{}.png", t)).string(), picture));
    }
    ASSERT_TRUE(WriteFileAtomically(folder / "states.json", states.dump()));
  }

  TemporaryFolder folder_;
  Path in_ = folder_ / "published", out_ = folder_ / "data";
};

TEST_F(Modattn, BecomesADatasetThatVerifies) {
  for (const char* name : {"10", "2"}) WriteRecording(name);

  const auto report = ImportModattn(in_, out_, {});

  ASSERT_THAT(report, IsOk());
  EXPECT_EQ(report->episodes, 2u);
  const auto verified = store::Verify(out_, store::Quarantine::kNo);
  ASSERT_THAT(verified, IsOk());
  EXPECT_EQ(verified->good, 2u);
  EXPECT_TRUE(verified->bad.empty());
  const auto reader = store::DatasetReader::Open(out_);
  ASSERT_THAT(reader, IsOk());
  EXPECT_EQ(reader->ReadWhole(0)->details["folder"], "2");  // numbers in their order
  EXPECT_EQ(reader->ReadWhole(1)->details["folder"], "10");
}

// before, the spec had pick, push and put_down whatever was recorded, and the first recording's objects
TEST_F(Modattn, TheSpecHasWhatAllRecordingsSay) {
  for (const char* name : {"0", "1"}) WriteRecording(name);
  for (int t = 0; t < kSteps; ++t) {
    ReplaceInFile(in_ / "1/states.json", "pick", "push");
    ReplaceInFile(in_ / "1/states.json", "coke", "milk");
  }
  ASSERT_THAT(ImportModattn(in_, out_, {}), IsOk());
  const auto reader = store::DatasetReader::Open(out_);
  ASSERT_THAT(reader, IsOk());
  EXPECT_THAT(reader->spec().tasks, testing::ElementsAre("pick", "push"));
  EXPECT_THAT(reader->spec().objects, testing::ElementsAre("cube", "coke", "milk"));
  EXPECT_EQ(reader->spec().objects_per_scene, 2);
}

// of one spec they could not be merged, and their good episodes were called damaged
TEST_F(Modattn, OtherRecordingsAreOfAnotherSpecAndTheSameOfTheSame) {
  WriteRecording("0");
  ASSERT_THAT(ImportModattn(in_, folder_ / "a", {}), IsOk());
  ASSERT_THAT(ImportModattn(in_, folder_ / "again", {}), IsOk());
  WriteRecording("1");
  ASSERT_THAT(ImportModattn(in_, folder_ / "b", {}), IsOk());
  const auto spec_of = [&](const char* name) {
    return store::DatasetReader::Open(folder_ / name).value().spec_sha256();
  };
  EXPECT_EQ(spec_of("a"), spec_of("again"));
  EXPECT_NE(spec_of("a"), spec_of("b"));
  const auto merged = store::MergeDatasets({folder_ / "a", folder_ / "b"}, out_, Leftover::kRefuse);
  ASSERT_THAT(merged, IsOk());
  EXPECT_EQ(merged->episodes, 3u);
}

TEST_F(Modattn, KeepsWhatWasRecorded) {
  WriteRecording("0");
  ASSERT_THAT(ImportModattn(in_, out_, {}), IsOk());

  const auto reader = store::DatasetReader::Open(out_);
  ASSERT_THAT(reader, IsOk());
  const auto episode = reader->ReadWhole(0);
  ASSERT_THAT(episode, IsOk());
  EXPECT_EQ(episode->steps(), kSteps);
  EXPECT_EQ(episode->task, "pick");
  EXPECT_EQ(episode->target, "cube");  // the authors' "target2"
  EXPECT_FALSE(episode->instruction.empty());
  EXPECT_EQ(episode->image_stride, 1);
  EXPECT_FLOAT_EQ(episode->joint_pos.row(2)[3], 0.32f);
  EXPECT_FLOAT_EQ(episode->gripper_qpos.row(5)[0], 0.5f);
  EXPECT_FLOAT_EQ(episode->eef_pos.row(4)[0], 0.04f);
  EXPECT_EQ(episode->actions_abs.row(2)[9], 0);
  EXPECT_EQ(episode->actions_abs.row(3)[9], 1);  // the finger is beyond 0.3 rad
  EXPECT_FLOAT_EQ(episode->actions_abs.row(0)[1], 0.2f);
  EXPECT_EQ(episode->phase, (std::vector<std::uint8_t>{0, 0, 0, 1, 1, 1}));
  EXPECT_EQ(episode->details["judged"], false);
  ASSERT_NE(episode->FindObject("coke"), nullptr);
  EXPECT_FLOAT_EQ(episode->FindObject("coke")->pose.row(0)[0], 0.2f);
  FrameCursor frames(*episode);
  const auto rgb = frames.Frame(5);
  ASSERT_THAT(rgb, IsOk());
  EXPECT_EQ((*rgb)[0], 35);
  EXPECT_EQ((*rgb)[2], 10);
}

TEST_F(Modattn, SaysWhatIsWrongWithWhichEpisode) {
  const auto broken = [&](const std::string& from, const std::string& to) {
    std::filesystem::remove_all(in_);
    WriteRecording("7");
    ReplaceInFile(in_ / "7/states.json", from, to);
    return ImportModattn(in_, out_, {.leftover = Leftover::kRemove});
  };
  EXPECT_FALSE(ImportModattn(in_, out_, {}));  // there is no such folder
  EXPECT_THAT(broken("\"pick\"", "\"juggle\""), MessageHas("published/7"));
  EXPECT_THAT(broken("\"target2\":{", "\"unknown thing\":{"), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(broken("\"stage\":1", "\"stage\":1000000000000"), MessageHas("'stage'"));
  EXPECT_THAT(broken("\"xyz\":[", "\"xyz\":[1e300,"), MessageHas("'xyz'"));
  EXPECT_THAT(broken("\"dq\"", "\"qd\""), MessageHas("'dq'"));
  EXPECT_THAT(broken("[{", "[[{"), MessageHas("states.json"));
  EXPECT_THAT(ImportModattn(in_, out_, {.robot = "sawyer", .leftover = Leftover::kRemove}), MessageHas("sawyer"));
}

TEST_F(Modattn, LeavesOutWhatIsBadWhenAskedTo) {
  for (const char* name : {"0", "1", "2"}) WriteRecording(name);
  std::filesystem::remove(in_ / "0/3.png");
  ASSERT_TRUE(WriteFileAtomically(in_ / "2/3.png", std::string_view("no picture")));

  const auto report = ImportModattn(in_, out_, {.skip_bad = true});

  ASSERT_THAT(report, IsOk());
  EXPECT_EQ(report->episodes, 1u);
  ASSERT_EQ(report->skipped.size(), 2u);
  EXPECT_THAT(report->skipped[0], testing::StartsWith("0: "));
  EXPECT_THAT(report->skipped[1], testing::HasSubstr("3.png"));
}

// one of few bytes may say that it needs gigabytes
TEST_F(Modattn, LooksAtAPicturesSizeBeforeItIsDecoded) {
  WriteRecording("0");
  auto png = ReadBinaryFile(in_ / "0/3.png").value();
  for (const std::size_t side : {16, 20}) png[side + 2] = 0x75;  // 30,000 px
  ASSERT_TRUE(WriteFileAtomically(in_ / "0/3.png", png));
  EXPECT_THAT(ImportModattn(in_, out_, {}), MessageHas("3.png is no PNG of at most 4096 px a side"));
}

TEST_F(Modattn, ABadFirstEpisodeDoesNotSettleTheSizeOfAll) {
  WriteRecording("0", 48);
  for (const char* name : {"1", "2"}) WriteRecording(name);
  ReplaceInFile(in_ / "0/states.json", "\"dq\"", "\"qd\"");  // seen after its pictures

  const auto report = ImportModattn(in_, out_, {.skip_bad = true});

  ASSERT_THAT(report, IsOk());
  EXPECT_EQ(report->episodes, 2u);
  EXPECT_EQ(report->skipped.size(), 1u);
  const auto reader = store::DatasetReader::Open(out_);
  ASSERT_THAT(reader, IsOk());
  EXPECT_EQ(reader->spec().camera.width, 32);
  EXPECT_EQ(reader->spec().episodes, 3u) << "that there were to import";
  const auto description = OrderedJson::parse(*ReadTextFile(out_ / "dataset.json"));
  EXPECT_EQ(description.value("derived", false), true) << "the one that was left out will not come";
}

}  // namespace modattn_test
}  // namespace etude::exports
