// SPDX-License-Identifier: Apache-2.0
// Tests trainer/policy/policy_file.cc
#include "trainer/policy/policy_file.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include "tests/support/temporary_folder.h"

namespace etude::policy {
namespace policy_file_test {

using testing::HasSubstr;

class PolicyFile : public testing::Test {
 protected:
  void Write(const char* name, const std::string& text) {
    ASSERT_TRUE(MakeFolders((folder_ / name).parent_path()));
    ASSERT_TRUE(WriteFileAtomically(folder_ / name, text));
  }
  TemporaryFolder folder_;
};

TEST_F(PolicyFile, ExtendsTheOneBesideIt) {
  Write("base.yaml", "{width: 1}");
  Write("tiny/base.yaml", "{name: tiny, width: 8, modules: [{name: A}]}");
  Write("tiny/more.yaml", "{extends: base, name: tiny/more, modules: [{name: B, level: 1}]}");
  Write("tiny/most.yaml", "{extends: more, width: 9}");

  const auto most = ReadPolicyMap("tiny/most", {folder_ / ""});

  ASSERT_TRUE(most) << most.error().message;
  EXPECT_EQ(*most, ParseYaml("{name: tiny/more, width: 9, modules: [{name: A}, {name: B, level: 1}]}", "test").value());
}

// each would train for hours what nobody meant
TEST_F(PolicyFile, AModuleThatIsNotThereAndOneThatStandsTwiceAreRefused) {
  Write("base.yaml", "{modules: [{name: TAR3D, level: 3}]}");
  Write("typo.yaml", "{extends: base, modules: [{name: TAR3d, decoder: {readout: ray}}]}");
  Write("twice.yaml", "{extends: base, modules: [{name: A, level: 1}, {name: A, level: 1}]}");
  EXPECT_THAT(ReadPolicyMap("typo", {folder_ / ""}).error().message, HasSubstr("did you mean 'TAR3D'"));
  EXPECT_THAT(ReadPolicyMap("twice", {folder_ / ""}).error().message, HasSubstr("'A' stands twice"));
}

TEST_F(PolicyFile, MaySayTheLanguageInAWord) {
  Write("tiny/base.yaml", "{name: tiny, language: {buckets: 64}}");
  Write("tiny/clip.yaml", "{extends: base, language: clip:/models/clip}");

  const auto clip = ReadPolicyMap("tiny/clip", {folder_ / ""});

  ASSERT_TRUE(clip) << clip.error().message;
  EXPECT_EQ((*clip)["language"], OrderedJson({{"encoder", "clip:/models/clip"}}));
  EXPECT_EQ((*ReadPolicyMap("tiny/base", {folder_ / ""}))["language"], OrderedJson({{"buckets", 64}}));
  OrderedJson odd = "no map";
  WriteOutLanguage(odd);
  EXPECT_EQ(odd, "no map");
}

TEST_F(PolicyFile, SaysWhatIsWrong) {
  Write("loop.yaml", "{extends: loop}");
  Write("list.yaml", "{extends: [loop]}");
  Write("tiny/base.yaml", "{}");
  Write("modules.yaml", "- {name: LANG}");
  const auto message = [&](const char* name) { return ReadPolicyMap(name, {folder_ / ""}).error().message; };
  EXPECT_THAT(message("loop"), HasSubstr("extends itself"));
  EXPECT_THAT(message("list"), HasSubstr("extends: must be the name"));
  EXPECT_THAT(message("tiny/bas"), HasSubstr("did you mean 'tiny/base'"));
  EXPECT_THAT(message("modules"), HasSubstr("modules.yaml: its top level is no map of keys (array)"));
}

TEST_F(PolicyFile, LooksForWhatItExtendsBesideItBeforeElsewhere) {
  Write("a/base.yaml", "{width: 1}");
  Write("b/base.yaml", "{width: 2}");
  Write("b/more.yaml", "{extends: base}");
  Write("c/more.yaml", "{extends: base, heads: 3}");
  const std::vector<Path> folders{folder_ / "a", folder_ / "b"};
  EXPECT_EQ((*ReadPolicyMap("base", folders))["width"], 1) << "the first folder that has it";
  EXPECT_EQ((*ReadPolicyMap("more", folders))["width"], 2) << "its own";
  const auto file = ReadPolicyMap((folder_ / "c/more.yaml").string(), folders);
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_EQ(*file, ParseYaml("{width: 1, heads: 3}", "test").value()) << "beside a file that is named there is none";
}

TEST_F(PolicyFile, ExtendsEightOthersAndNoMore) {
  Write("p0.yaml", "{width: 5}");
  for (int i = 1; i <= 9; ++i)
    Write(fmt::format("p{}.yaml", i).c_str(), fmt::format("{{extends: p{}, heads: {}}}", i - 1, i));
  const auto most = ReadPolicyMap("p8", {folder_ / ""});
  ASSERT_TRUE(most) << most.error().message;
  EXPECT_EQ(*most, ParseYaml("{width: 5, heads: 8}", "test").value());
  EXPECT_THAT(ReadPolicyMap("p9", {folder_ / ""}).error().message, HasSubstr("more than 8 others"));
}

TEST_F(PolicyFile, NamesWhatItExtendsAndIsNotThere) {
  Write("mine.yaml", "{extends: basse}");
  Write("base.yaml", "");
  const auto mine = ReadPolicyMap("mine", {folder_ / ""});
  ASSERT_FALSE(mine);
  EXPECT_EQ(mine.error().code, Code::kInvalidArgument);
  EXPECT_THAT(mine.error().message, HasSubstr("policy 'basse': neither a file nor a name (did you mean 'base'?)"));
  EXPECT_EQ(*ReadPolicyMap("base", {folder_ / ""}), OrderedJson::object()) << "an empty file says nothing";
}

TEST(FindExperiments, LooksAboveTheProgram) {
  const TemporaryFolder folder;
  ASSERT_TRUE(MakeFolders(folder / "trainer/experiments"));
  ASSERT_TRUE(MakeFolders(folder / "build/x/bin"));

  EXPECT_EQ(FindExperiments("", folder / "build/x/bin/etude-trainer").value(), folder / "trainer/experiments");
  EXPECT_EQ(FindExperiments((folder / "trainer").string(), "/x").value(), folder / "trainer/experiments");
  EXPECT_EQ(FindExperiments((folder / "deploy").string(), "/x").value(), folder / "trainer/experiments");
  EXPECT_EQ(FindExperiments((folder / "build/x").string(), "/x").error().code, Code::kNotFound);
}

}  // namespace policy_file_test
}  // namespace etude::policy
