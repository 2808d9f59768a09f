// SPDX-License-Identifier: Apache-2.0
// Tests trainer/data/labels.cc
#include "trainer/data/labels.h"

#include <gmock/gmock.h>

#include <limits>

#include "tests/support/synthetic_episode.h"

namespace etude::data {
namespace labels_test {

using testing::ElementsAre;
using testing::IsEmpty;
using Kind = Entity::Kind;

TEST(ParseEntity, KnowsWhatItSaysItKnows) {
  for (const std::string& name : EntityNames()) EXPECT_TRUE(ParseEntity(name)) << name;
  EXPECT_EQ(ParseEntity("target")->kind, Kind::kTarget);
  EXPECT_EQ(ParseEntity("reference")->kind, Kind::kReference);
  EXPECT_EQ(ParseEntity("obstacle")->kind, Kind::kObstacle);
  EXPECT_EQ(ParseEntity("others")->kind, Kind::kOthers);
  EXPECT_EQ(ParseEntity("ee")->kind, Kind::kEe);
  EXPECT_EQ(ParseEntity("command")->kind, Kind::kCommand);
  const auto object = ParseEntity("object:apple_03");
  ASSERT_TRUE(object);
  EXPECT_EQ(object->kind, Kind::kObject);
  EXPECT_EQ(object->object, "apple_03");
}

TEST(ParseEntity, RefusesEverythingElse) {
  for (const char* text : {"", "Target", "targets", "target ", "object", "object:", "hand", "coke"})
    EXPECT_FALSE(ParseEntity(text)) << text;
}

TEST(Entity, SaysWhatDependsOnTheSentenceAndWhatIsAThing) {
  const auto flags = [](const char* text) {
    const Entity entity = ParseEntity(text).value();
    return std::vector<bool>{entity.per_sentence(), entity.is_set(), entity.is_thing()};
  };
  for (const char* thing : {"target", "reference", "obstacle"})
    EXPECT_THAT(flags(thing), ElementsAre(true, false, true)) << thing;
  for (const char* thing : {"ee", "object:coke"}) EXPECT_THAT(flags(thing), ElementsAre(false, false, true)) << thing;
  EXPECT_THAT(flags("others"), ElementsAre(true, true, false));
  EXPECT_THAT(flags("command"), ElementsAre(true, false, false));
}

/// An episode of ten steps with six objects, and a command about three of them.
class States : public testing::Test {
 protected:
  std::vector<EntityState> Of(const char* entity) const {
    return StatesOf(ParseEntity(entity).value(), {episode_, kStep, command_, classes_, {0, 0, 32, 32}, {}});
  }
  std::vector<std::string> NamesOf(const char* entity) const {
    std::vector<std::string> names;
    for (const auto& state : Of(entity)) names.emplace_back(state.name);
    return names;
  }
  ObjectTrack& Track(const std::string& name) { return *std::ranges::find(episode_.objects, name, &ObjectTrack::name); }

  static constexpr int kStep = 4;
  Episode episode_ = MakeSyntheticEpisode(SyntheticSpec(), 0, 10);
  language::Command command_{.task = "place_left", .target = "coke", .reference = "milk", .obstacle = "bread"};
  std::vector<std::string> classes_;
};

TEST_F(States, AreWhereTheObjectOfTheRoleIsAtThatStep) {
  for (const auto& [entity, name] :
       {std::pair{"target", "coke"}, {"reference", "milk"}, {"obstacle", "bread"}, {"object:pepsi", "pepsi"}}) {
    const auto states = Of(entity);
    ASSERT_EQ(states.size(), 1u) << entity;
    EXPECT_EQ(states[0].name, name);
    const ObjectTrack& track = Track(name);
    EXPECT_THAT(states[0].p, ElementsAre(track.pose.row(kStep)[0], track.pose.row(kStep)[1], track.pose.row(kStep)[2]));
    EXPECT_THAT(states[0].q, ElementsAre(1, 0, 0, 0));
    EXPECT_THAT(states[0].pixel, ElementsAre(track.pixel.row(kStep)[0], track.pixel.row(kStep)[1]));
    EXPECT_EQ(states[0].p.data(), track.pose.row(kStep).data()) << "not copied";
  }
}

TEST_F(States, OfTheHandAreItsOwnAndOfTheCommandItsTask) {
  const auto hand = Of("ee");
  ASSERT_EQ(hand.size(), 1u);
  EXPECT_EQ(hand[0].p.data(), episode_.eef_pos.row(kStep).data());
  EXPECT_EQ(hand[0].q.data(), episode_.eef_quat.row(kStep).data());
  EXPECT_EQ(hand[0].pixel.data(), episode_.eef_pixel.row(kStep).data());
  EXPECT_EQ(hand[0].name, "");
  const auto command = Of("command");
  ASSERT_EQ(command.size(), 1u);
  EXPECT_EQ(command[0].name, "place_left");
  EXPECT_TRUE(command[0].p.empty());
}

TEST_F(States, OfOthersAreAllButTheTargetInTheEpisodesOrder) {
  std::vector<std::string> expected;
  for (const auto& object : episode_.objects)
    if (object.name != "coke") expected.push_back(object.name);
  ASSERT_EQ(expected.size(), 5u);
  EXPECT_EQ(NamesOf("others"), expected);
  while (episode_.objects.size() < 2 * kMaxOthers) {
    episode_.objects.push_back(Track("milk"));
    episode_.objects.back().name = "more";
  }
  EXPECT_EQ(Of("others").size(), static_cast<std::size_t>(kMaxOthers)) << "no more than a label has room for";
}

TEST_F(States, AreNoneWhereSentenceOrSceneHaveNoSuchThing) {
  command_.reference.clear();
  EXPECT_THAT(Of("reference"), IsEmpty());
  command_.obstacle = language::kEverythingElse;
  EXPECT_THAT(Of("obstacle"), IsEmpty()) << "that is no one thing";
  command_.target = "teapot";
  EXPECT_THAT(Of("target"), IsEmpty());
  EXPECT_THAT(Of("object:teapot"), IsEmpty());
}

// Sentences say "apple" of apple_03; where there are two, the one that is named exactly is meant.
TEST_F(States, OfGeneratedObjectsAreFoundByTheirNoun) {
  Track("coke").name = "apple_03";
  Track("pepsi").name = "apple_07";
  command_.target = "apple";
  EXPECT_THAT(NamesOf("target"), ElementsAre(testing::StartsWith("apple_0")));
  for (const char* exact : {"apple_03", "apple_07"}) {
    command_.target = exact;
    EXPECT_THAT(NamesOf("target"), ElementsAre(exact));
  }
  EXPECT_THAT(NamesOf("object:apple_07"), ElementsAre("apple_07"));
}

TEST_F(States, AreFiniteUnlessTheirPoseIsNot) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN(), kInfinity = std::numeric_limits<float>::infinity();
  ASSERT_TRUE(Of("target")[0].finite());
  Track("coke").pixel.values[2 * kStep] = kNan;
  EXPECT_TRUE(Of("target")[0].finite()) << "behind the camera it has a place";
  Track("coke").pose.values[7 * kStep + 6] = kInfinity;
  EXPECT_FALSE(Of("target")[0].finite());
  episode_.eef_pos.values[3 * kStep + 1] = kNan;
  EXPECT_FALSE(HandState(episode_, kStep).finite());
  EXPECT_TRUE(HandState(episode_, kStep - 1).finite());
}

}  // namespace labels_test
}  // namespace etude::data
