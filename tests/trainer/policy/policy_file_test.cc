// SPDX-License-Identifier: Apache-2.0
// Tests trainer/policy/policy_file.cc
#include "trainer/policy/policy_file.h"

#include <gmock/gmock.h>

#include "tests/support/temporary_folder.h"

namespace etude::policy {
namespace {

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
  Write("tiny/more.yaml", "{extends: base, name: tiny/more, modules: [{name: B}]}");
  Write("tiny/most.yaml", "{extends: more, width: 9}");

  const auto most = ReadPolicyMap("tiny/most", {folder_ / ""});

  ASSERT_TRUE(most) << most.error().message;
  EXPECT_EQ(*most, ParseYaml("{name: tiny/more, width: 9, modules: [{name: A}, {name: B}]}", "test").value());
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
  const auto message = [&](const char* name) { return ReadPolicyMap(name, {folder_ / ""}).error().message; };
  EXPECT_THAT(message("loop"), HasSubstr("extends itself"));
  EXPECT_THAT(message("list"), HasSubstr("extends: must be the name"));
  EXPECT_THAT(message("tiny/bas"), HasSubstr("did you mean 'tiny/base'"));
}

TEST(FindExperiments, LooksAboveTheProgram) {
  const TemporaryFolder folder;
  ASSERT_TRUE(MakeFolders(folder / "trainer/experiments"));
  ASSERT_TRUE(MakeFolders(folder / "build/x/bin"));

  EXPECT_EQ(FindExperiments("", folder / "build/x/bin/etude-trainer").value(), folder / "trainer/experiments");
  EXPECT_EQ(FindExperiments((folder / "trainer").string(), "/x").value(), folder / "trainer/experiments");
  EXPECT_EQ(FindExperiments((folder / "build").string(), "/x").error().code, Code::kNotFound);
}

}  // namespace
}  // namespace etude::policy
