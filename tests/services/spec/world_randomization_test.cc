// SPDX-License-Identifier: Apache-2.0
// Tests services/spec/world_randomization.cc and what a campaign says of it
#include "services/spec/world_randomization.h"

#include <gmock/gmock.h>

#include <limits>

#include "services/spec/campaign_spec.h"
#include "services/spec/content_version.h"
#include "services/spec/object_names.h"
#include "tests/support/matchers.h"

namespace etude {
namespace world_randomization_test {

Status Validated(const std::vector<std::string>& overrides) {
  OrderedJson json = ToJson(CampaignSpec());
  for (const auto& text : overrides) ETUDE_RETURN_IF_ERROR(ApplyOverride(json, text));
  ETUDE_ASSIGN_OR_RETURN(const auto spec, FromJson<CampaignSpec>(json, "test.yaml"));
  return spec.Validate();
}

TEST(WorldRandomization, RefusesWhatIsOutOfRange) {
  for (const auto& [key, high] :
       std::initializer_list<std::pair<const char*, const char*>>{{"camera_position", "1"},
                                                                  {"camera_aim", "0.5"},
                                                                  {"camera_roll", "0.8"},
                                                                  {"fovy_deg", "40"},
                                                                  {"light_brightness", "0.9"},
                                                                  {"light_colour", "0.9"},
                                                                  {"light_direction", "1"},
                                                                  {"table_scale", "4"},
                                                                  {"table_colour", "0.9"},
                                                                  {"background", "1"},
                                                                  {"object_colour", "0.9"},
                                                                  {"object_gloss", "1"},
                                                                  {"distractor_balls", "1"}}) {
    const std::string path = std::string("randomization.world.") + key;
    EXPECT_THAT(Validated({path + "=" + high}), IsOk()) << path;
    EXPECT_THAT(Validated({path + "=-0.1"}), MessageHas(path + ": -0.1 not in 0.." + high));
    EXPECT_THAT(Validated({path + "=41"}), MessageHas(path + ": 41 not in 0.." + high));
  }
  CampaignSpec nowhere;
  nowhere.randomization.world.camera_aim = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(nowhere.Validate(), MessageHas("camera_aim: nan not in 0..0.5"));
  EXPECT_THAT(Validated({"randomization.world.tables=[wood, wod]"}), MessageHas("tables: 'wod' is not known, did you"));
}

TEST(WorldRandomization, DistractorsAreOfClassesThatNoSentenceNames) {
  EXPECT_THAT(Validated({"randomization.world.distractors=2"}), IsOk());
  EXPECT_THAT(Validated({"randomization.world.distractors=3"}), MessageHas("3 beside 6 objects, 8 fit in all"));
  EXPECT_THAT(Validated({"randomization.world.distractors=4", "objects_per_scene=4"}), IsOk());
  std::string all = "cube";
  for (const auto& name : GeneratedClasses())
    if (name != "lemon") all += ", " + name + "_00";
  EXPECT_THAT(Validated({"objects=[" + all + "]", "objects_per_scene=2", "randomization.world.distractors=1"}), IsOk());
  EXPECT_THAT(Validated({"objects=[" + all + "]", "objects_per_scene=2", "randomization.world.distractors=2"}),
              MessageHas("distractors: 2 of 1 classes that no sentence names"));
  EXPECT_THAT(Validated({"objects=[cube, distractor_apple_00]"}), MessageHas("'distractor_apple_00' is not known"));
  for (const char* names_it : {"tasks=[pick+obstacle]", "objects=[cube, basketball]"})
    EXPECT_THAT(Validated({names_it, "randomization.world.distractor_balls=0.5"}),
                MessageHas("distractor_balls: 0.5 where sentences name the basketball"));
}

TEST(WorldRandomization, ACameraThatDoesNotSeeTheTableIsNotMoved) {
  EXPECT_THAT(Validated({"camera.fovy_deg=20"}), IsOk()) << "one's own choice";
  EXPECT_THAT(Validated({"camera.fovy_deg=20", "randomization.world.fovy_deg=1"}), MessageHas("does not see all"));
}

TEST(WorldRandomization, SwitchedOffACampaignIsTheOneFromBeforeItExisted) {
  CampaignSpec spec;
  OrderedJson json = ToJson(spec);
  ASSERT_EQ(kContentVersion, 10u) << "another content is another hash: write down the new one";
  EXPECT_EQ(SpecHash(spec), "81bb356b76dd2795268dcd988a37fe0a3e7679d6f48f0ebcc694997dc5f6fd34");
  json["randomization"].erase("world");
  const auto before = FromJson<CampaignSpec>(json, "an old dataset's");
  ASSERT_THAT(before, IsOk());
  EXPECT_EQ(SpecHash(*before), SpecHash(spec));
  spec.randomization.world.fovy_deg = 1e-9;
  EXPECT_NE(SpecHash(*before), SpecHash(spec));
  spec.randomization.world.fovy_deg = 0;
  spec.randomization.world.distractors = 2;
  EXPECT_EQ(SpecHash(spec), "c5d2d62b8d0648aa4065bac5e905cc1a58a50647e8fdde890cce1012fbf7bef9");
  spec.randomization.world.distractor_balls = 0.1;
  EXPECT_NE(SpecHash(spec), "c5d2d62b8d0648aa4065bac5e905cc1a58a50647e8fdde890cce1012fbf7bef9");
}

}  // namespace world_randomization_test
}  // namespace etude
