// SPDX-License-Identifier: Apache-2.0
// Tests worker/synthesis/main.cc: `etude object` as a user meets it.
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "services/core/command.h"
#include "tests/support/etude_command.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"
#include "worker/synthesis/picture_file.h"
#include "worker/synthesis/scene_object.h"

namespace etude::synthesis {
namespace object_command_test {

using testing::HasSubstr;

class ObjectCommand : public testing::Test {
 protected:
  CommandOutcome Object(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "object");
    return RunEtude(arguments, folder_ / "output.txt");
  }
  std::string In(const std::string& name) { return (folder_ / name).string(); }
  std::vector<std::uint8_t> Bytes(const std::string& name) {
    const auto bytes = ReadBinaryFile(folder_ / name);
    EXPECT_THAT(bytes, IsOk());
    return bytes.value_or(std::vector<std::uint8_t>{});
  }
  /// A picture of a ball of 40 px in front of nothing, NAME.png and NAME-depth.png in folder "pictures".
  void WriteBall(const std::string& name) {
    Picture picture{.width = 48, .height = 48};
    Texture colors{.width = 48, .height = 48};
    for (int y = 0; y < 48; ++y)
      for (int x = 0; x < 48; ++x) {
        const double off = std::hypot(x - 23.5, y - 23.5) / 20;
        picture.mask.push_back(off < 1);
        picture.depth.push_back(off < 1 ? static_cast<float>(0.05 + 0.95 * std::sqrt(1 - off * off)) : 0.0f);
        for (const int value : {200, 90, 20}) colors.rgb.push_back(static_cast<std::uint8_t>(value));
      }
    ASSERT_THAT(WriteFileAtomically(folder_ / "pictures" / (name + ".png"), EncodePng(colors).value()), IsOk());
    ASSERT_THAT(WriteFileAtomically(folder_ / "pictures" / (name + "-depth.png"), EncodeDepth(picture).value()),
                IsOk());
  }

  TemporaryFolder folder_;
};

constexpr const char* kTetrahedron = R"(v 0 0 0
v 1 0 0
v 0 1 0
v 0 0 1
f 1 3 2
f 1 2 4
f 2 3 4
f 1 4 3
)";

TEST_F(ObjectCommand, EveryCommandHasHelp) {
  for (const std::vector<std::string>& arguments : std::vector<std::vector<std::string>>{
           {"--help"}, {"synthesize", "--help"}, {"import", "--help"}, {"gallery", "--help"}}) {
    const CommandOutcome outcome = Object(arguments);
    EXPECT_EQ(outcome.exit_code, kExitOk) << outcome.text;
    EXPECT_THAT(outcome.text, HasSubstr("Usage: etude object"));
  }
}

TEST_F(ObjectCommand, SynthesizesTheSameObjectsFromOneThreadAndTwo) {
  for (const char* threads : {"1", "2"}) {
    const CommandOutcome outcome = Object({"synthesize", "--classes", "apple,mug", "--per-class", "2", "--threads",
                                           threads, "--out", In(std::string("objects") + threads)});
    ASSERT_EQ(outcome.exit_code, kExitOk) << outcome.text;
    EXPECT_THAT(outcome.text, HasSubstr("4 objects (4 train, 0 test)"));
  }
  for (const std::string name : {"apple_00", "apple_01", "mug_00", "mug_01"})
    for (const std::string& file : {std::string("visual.obj"), std::string("object.yaml"), name + ".xml"})
      EXPECT_EQ(Bytes("objects1/" + name + "/" + file), Bytes("objects2/" + name + "/" + file)) << name << " " << file;
}

TEST_F(ObjectCommand, AnotherSeedGivesAnotherObject) {
  for (const char* seed : {"1", "2"})
    ASSERT_EQ(
        Object({"synthesize", "--classes", "pear", "--per-class", "1", "--seed", seed, "--out", In(seed)}).exit_code,
        kExitOk);
  EXPECT_NE(Bytes("1/pear_00/visual.obj"), Bytes("2/pear_00/visual.obj"));
}

// before, an object that somebody had made, or changed, was made anew without a word
TEST_F(ObjectCommand, ASynthesisKeepsWhatIsAnotherObject) {
  std::vector<std::string> pear{"synthesize", "--classes", "pear", "--per-class", "1", "--out", In("o"), "--seed", "1"};
  ASSERT_EQ(Object(pear).exit_code, kExitOk);
  EXPECT_EQ(Object(pear).exit_code, kExitOk) << "the same again";
  const auto first = Bytes("o/pear_00/visual.obj");
  pear.back() = "2";
  const CommandOutcome taken = Object(pear);
  EXPECT_EQ(taken.exit_code, kExitUsage);
  EXPECT_THAT(taken.text, HasSubstr("is another object already"));
  EXPECT_EQ(Bytes("o/pear_00/visual.obj"), first);
  pear.emplace_back("--overwrite");
  EXPECT_EQ(Object(pear).exit_code, kExitOk);
  EXPECT_NE(Bytes("o/pear_00/visual.obj"), first);
}

TEST_F(ObjectCommand, MakesObjectsOfPicturesWithDepth) {
  WriteBall("ball");
  const CommandOutcome outcome = Object({"synthesize", "--images", In("pictures"), "--size", "0.05", "--relief", "0.42",
                                         "--density", "800", "--out", In("objects")});
  ASSERT_EQ(outcome.exit_code, kExitOk) << outcome.text;
  const auto facts = ReadObjectFacts(folder_ / "objects" / "ball");
  ASSERT_THAT(facts, IsOk());
  EXPECT_EQ(facts->source, "picture");
  EXPECT_NEAR(facts->size_m, 0.05, 1.5e-3) << "less what is pressed flat";
  // a ball of that size, a little flatter
  EXPECT_NEAR(facts->mass_kg, 800 * 4.0 / 3 * 3.14159 * std::pow(0.025, 3), 0.25 * facts->mass_kg);
}

TEST_F(ObjectCommand, ImportsAMeshUnderAName) {
  ASSERT_THAT(WriteFileAtomically(folder_ / "some thing.obj", std::string_view(kTetrahedron)), IsOk());
  const CommandOutcome unnamed = Object({"import", In("some thing.obj"), "--out", In("objects")});
  EXPECT_NE(unnamed.exit_code, kExitOk) << "the file's name is no object's name";

  const CommandOutcome outcome =
      Object({"import", In("some thing.obj"), "--name", "duck", "--size", "0.06", "--out", In("objects")});
  ASSERT_EQ(outcome.exit_code, kExitOk) << outcome.text;
  EXPECT_THAT(outcome.text, HasSubstr("duck"));
  const auto facts = ReadObjectFacts(folder_ / "objects" / "duck");
  ASSERT_THAT(facts, IsOk());
  EXPECT_NEAR(facts->size_m, 0.06, 1e-9);

  std::vector<std::string> larger{"import", In("some thing.obj"), "--name", "duck", "--size", "0.08",
                                  "--out",  In("objects")};
  const CommandOutcome taken = Object(larger);
  EXPECT_EQ(taken.exit_code, kExitUsage) << taken.text;
  EXPECT_THAT(taken.text, HasSubstr("is an object already"));
  EXPECT_NEAR(ReadObjectFacts(folder_ / "objects" / "duck")->size_m, 0.06, 1e-9);
  larger.emplace_back("--overwrite");
  EXPECT_EQ(Object(larger).exit_code, kExitOk);
  EXPECT_NEAR(ReadObjectFacts(folder_ / "objects" / "duck")->size_m, 0.08, 1e-9);
}

TEST_F(ObjectCommand, GalleryIsPngOrJpegByItsName) {
  ASSERT_EQ(Object({"synthesize", "--classes", "lemon", "--per-class", "2", "--out", In("objects")}).exit_code,
            kExitOk);
  for (const std::string name : {"sheet.png", "sheet.jpg"}) {
    const CommandOutcome outcome =
        Object({"gallery", In("objects"), "--tile", "100", "--columns", "2", "--out", In(name)});
    ASSERT_EQ(outcome.exit_code, kExitOk) << outcome.text;
    EXPECT_THAT(outcome.text, HasSubstr("2 objects"));
    const auto sheet = DecodePicture(Bytes(name), name);
    ASSERT_THAT(sheet, IsOk());
    EXPECT_EQ(sheet->width, 200);
    EXPECT_NE(*std::min_element(sheet->rgb.begin(), sheet->rgb.end()), 255) << "not a blank sheet";
  }
  EXPECT_EQ(Bytes("sheet.png")[1], 'P');
  EXPECT_EQ(Bytes("sheet.jpg")[0], 0xff);
}

TEST_F(ObjectCommand, WrongUsageIsExitCode2) {
  EXPECT_EQ(Object({}).exit_code, kExitUsage);
  EXPECT_EQ(Object({"import"}).exit_code, kExitUsage);
  EXPECT_EQ(Object({"synthesize", "--per-class", "0"}).exit_code, kExitUsage);
  EXPECT_EQ(Object({"synthesize", "--relief", "0.3"}).exit_code, kExitUsage) << "needs --images";
  EXPECT_EQ(Object({"gallery", In("objects"), "--tile", "1"}).exit_code, kExitUsage);
  const CommandOutcome gif = Object({"gallery", In("objects"), "--out", In("sheet.gif")});
  EXPECT_EQ(gif.exit_code, kExitUsage);
  EXPECT_THAT(gif.text, HasSubstr("must end with .png or .jpg")) << "before, a PNG of that name";
}

TEST_F(ObjectCommand, SaysWhatIsWrong) {
  const CommandOutcome unknown = Object({"synthesize", "--classes", "aple", "--out", In("objects")});
  EXPECT_EQ(unknown.exit_code, kExitUsage);
  EXPECT_THAT(unknown.text, HasSubstr("apple")) << "the nearest class";
  const CommandOutcome empty = Object({"gallery", In("none")});
  EXPECT_EQ(empty.exit_code, kExitFailure);
  EXPECT_THAT(empty.text, HasSubstr("none"));
  ASSERT_THAT(WriteFileAtomically(folder_ / "not.obj", std::string_view("nonsense")), IsOk());
  const CommandOutcome broken = Object({"import", In("not.obj"), "--out", In("objects")});
  EXPECT_NE(broken.exit_code, kExitOk);
  EXPECT_THAT(broken.text, HasSubstr("not.obj"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "objects")) << "nothing was made";
}

}  // namespace object_command_test
}  // namespace etude::synthesis
