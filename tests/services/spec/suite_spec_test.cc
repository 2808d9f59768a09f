// SPDX-License-Identifier: Apache-2.0
// Tests services/spec/suite_spec.cc
#include "services/spec/suite_spec.h"

#include <gmock/gmock.h>

#include "services/spec/campaign_spec.h"
#include "tests/support/matchers.h"

namespace etude {
namespace suite_spec_test {

std::vector<std::string> Problems(const TargetPushSpec& pushes) {
  std::vector<std::string> errors;
  pushes.Check(errors);
  return errors;
}

TEST(TargetPushSpec, NamesTheKeyThatIsOutOfRange) {
  EXPECT_THAT(Problems({}), testing::IsEmpty());
  EXPECT_FALSE(TargetPushSpec{}.on());
  EXPECT_TRUE(TargetPushSpec{.count = 1}.on());
  for (const auto& [pushes, says] :
       {std::pair{TargetPushSpec{.count = -1}, "rollout.pushes.count: -1 not in 0..10"},
        {TargetPushSpec{.least = 0.07}, "rollout.pushes.least: 0.07 not in 0.005..0.06"},
        {TargetPushSpec{.most = 0.2}, "rollout.pushes.most: 0.2 not in 0.005..0.15"},
        {TargetPushSpec{.earliest = 101}, "rollout.pushes.earliest: 101 not in 0..100"},
        {TargetPushSpec{.earliest = 0, .latest = -1}, "rollout.pushes.latest: -1 not in 0..100000"}})
    EXPECT_THAT(Problems(pushes), testing::Contains(says));
}

TEST(SentenceSpec, AnObjectIsMeantByItsNameOrByItsClass) {
  EXPECT_TRUE(IsNamed("coke", "coke"));
  EXPECT_TRUE(IsNamed("apple_03", "apple"));
  EXPECT_TRUE(IsNamed("apple_03", "apple_03"));
  EXPECT_TRUE(IsNamed("objects/duck", "duck"));
  EXPECT_FALSE(IsNamed("apple_03", "apple_04"));
  EXPECT_FALSE(IsNamed("coke", ""));
}

Status Spoken(const SentenceSpec& sentence) {
  CampaignSpec spec;
  spec.mode = "rollout";
  spec.rollout.run = "demo";
  spec.tasks = {"pick", "place_left", "stack"};
  spec.objects = {"cube", "coke", "milk", "bread", "apple_00", "apple_01"};
  spec.objects_per_scene = 3;
  spec.rollout.sentences = {{"pick cube", "pick", "cube", ""}, sentence};
  return spec.Validate();
}

TEST(SentenceSpec, SaysWhichSentenceCannotBeSpokenAndWhy) {
  EXPECT_THAT(Spoken({"fetch the fruit", "pick", "apple", ""}), IsOk());
  EXPECT_THAT(Spoken({"milk left of the fruit", "place_left", "milk", "apple"}), IsOk());
  for (const auto& [sentence, says] :
       {std::pair{SentenceSpec{"", "pick", "cube", ""}, "rollout.sentences[1] '': text: one line of 1 to 500 bytes"},
        {{std::string(501, 'a'), "pick", "cube", ""}, "text: one line"},
        {{"two\nlines", "pick", "cube", ""}, "text: one line"},
        {{"hit it", "pusch", "cube", ""}, "task: 'pusch' is not known"},
        {{"fetch it", "pick", "cokke", ""}, "object: 'cokke' is not known, did you mean 'coke'?"},
        {{"fetch it", "pick", "coke", "milk"}, "task 'pick' has no reference"},
        {{"move it", "place_left", "coke", ""}, "task 'place_left' needs a reference"},
        {{"move it", "place_left", "coke", "mlik"}, "reference: 'mlik' is not known"},
        {{"move it", "place_left", "apple_00", "apple"}, "'apple' cannot be the reference of 'apple_00'"},
        {{"pile it up", "stack", "cube", "bread"}, "'bread' cannot be the reference of 'cube'"}}) {
    EXPECT_THAT(Spoken(sentence), HasCode(Code::kInvalidArgument)) << says;
    EXPECT_THAT(Spoken(sentence), MessageHas(says));
  }
}

}  // namespace suite_spec_test
}  // namespace etude
