// SPDX-License-Identifier: Apache-2.0
// Tests services/core/config_reference.cc
#include "services/core/config_reference.h"

#include <gmock/gmock.h>

namespace etude {
namespace config_reference_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

struct Lens {
  double fovy = 60;
  int width = 224;
  void Visit(auto& v) {
    v("fovy", fovy, "deg", "vertical field of view");
    v("width", width, "px", "columns of a picture");
  }
};

struct Tree {
  std::string name;
  std::vector<Tree> children;
  void Visit(auto& v) {
    v("name", name, "", "what it is called");
    v("children", children, "", "what hangs on it");
  }
};

struct Rig {
  bool on = true;
  Lens lens;
  std::vector<Lens> spare;
  std::map<std::string, double> gains{{"red", 2}};
  std::vector<std::vector<std::string>> groups;
  void Visit(auto& v) {
    v("on", on, "", "whether it runs");
    v("lens", lens, "", "that it looks through");
    v("spare", spare, "", "lenses to change to");
    v("gains", gains, "-", "factor of each colour");
    v("groups", groups, "", "who stands together");
  }
};

struct Bare {
  double speed = 1;
  std::string name;
  Lens lens;
  void Visit(auto& v) {
    v("speed", speed, "", "how fast");
    v("name", name);
    v("lens", lens);
  }
};

std::vector<std::string> Paths(const std::vector<ConfigKey>& keys) {
  std::vector<std::string> paths;
  for (const auto& key : keys) paths.push_back(key.path);
  return paths;
}

TEST(ConfigReference, NamesEveryKeyWithTypeUnitDefaultAndMeaning) {
  const auto keys = ConfigReference<Rig>();
  ASSERT_THAT(Paths(keys), ElementsAre("on", "lens", "lens.fovy", "lens.width", "spare", "spare[].fovy",
                                       "spare[].width", "gains", "groups"));
  EXPECT_EQ(keys[0].type, "true or false");
  EXPECT_EQ(keys[0].default_value, "true");
  EXPECT_EQ(keys[1].type, "section");
  EXPECT_EQ(keys[2].type, "number");
  EXPECT_EQ(keys[2].unit, "deg");
  EXPECT_EQ(keys[2].meaning, "vertical field of view");
  EXPECT_EQ(keys[4].type, "list of sections");
  EXPECT_EQ(keys[7].type, "map of numbers");
  EXPECT_EQ(keys[7].default_value, "{\"red\":2.0}");
  EXPECT_EQ(keys[8].type, "list of lists of texts");
}

TEST(ConfigReference, SaysWhatIsMissing) {
  EXPECT_TRUE(MissingFromReference(ConfigReference<Rig>()).empty());
  EXPECT_THAT(MissingFromReference(ConfigReference<Bare>()),
              ElementsAre("speed: no unit", "name: no meaning", "lens: no meaning"));
}

TEST(ConfigReference, EndsWithAConfigThatHoldsItsOwnKind) { EXPECT_LT(ConfigReference<Tree>().size(), 40u); }

TEST(ConfigReference, ReadersAndWritersDoNotMindUnitsAndMeanings) {
  const auto json = ParseYaml("fovy: 40", "test.yaml");
  const auto lens = FromJson<Lens>(*json, "test.yaml");
  ASSERT_TRUE(lens) << lens.error().message;
  EXPECT_EQ(ToJson(*lens).dump(), "{\"fovy\":40.0,\"width\":224}");
}

TEST(ConfigReference, ReadsAsText) {
  const std::string text = FormatReference(ConfigReference<Rig>());
  EXPECT_THAT(text, HasSubstr("lens.fovy  (number, deg, default 60.0)\n    vertical field of view\n"));
  EXPECT_THAT(text, HasSubstr("gains  (map of numbers, default {\"red\":2.0})"));
}

}  // namespace config_reference_test
}  // namespace etude
