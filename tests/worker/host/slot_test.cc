// SPDX-License-Identifier: Apache-2.0
// Tests worker/host/slot.cc and child.cc with children that crash, hang and say garbage.
#include "worker/host/slot.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "services/core/clock.h"
#include "services/core/file.h"
#include "services/core/share.h"
#include "services/spec/attempt_outcome.h"
#include "services/spec/task_name.h"
#include "tests/support/programs_folder.h"
#include "tests/support/temporary_folder.h"

namespace etude::host {
namespace slot_test {

using namespace std::chrono_literals;
using testing::HasSubstr;

class SlotTest : public testing::Test {
 protected:
  SlotTest()
      : slot_({.argv = {(ProgramFolder() / "scripted_child").string(), (folder_ / "state").string()},
               .name = "s0",
               .stall = 5000ms}) {}
  void SetUp() override { ASSERT_TRUE(slot_.Begin(Hasty({"ab", {}, ""}))); }
  // Not more patient than the slot.
  static campaign::JoinedCampaign Hasty(campaign::JoinedCampaign joined) {
    joined.spec.stall_timeout_s = 1;
    return joined;
  }

  Result<campaign::WorkResult> Do(std::uint64_t index) {
    return slot_.Do({.index = index, .attempt = 4, .weights = {}, .progress = progress_},
                    [](const policy::Question& question) -> Result<policy::Answer> {
                      if (question.instruction != "which" || question.rgb.size() != 12)
                        return Fail(Code::kCorrupt, "another question");
                      return policy::Answer{.waypoints = {}, .modules = OrderedJson::object(), .checkpoint_step = 77};
                    });
  }
  // The first try is lost for `reason`, the second one, by another child, is as if nothing had been.
  void ExpectReplaced(std::uint64_t index, const char* reason, const char* ended_by, bool by_attempt = true) {
    const auto before = slot_.pid();
    const auto lost = Do(index);
    ASSERT_TRUE(lost) << lost.error().message;
    EXPECT_EQ(lost->outcome, kReleased) << "the attempt is anybody's again";
    EXPECT_TRUE(lost->episode.empty());
    const auto details = OrderedJson::parse(lost->details_json);
    EXPECT_EQ(details["reason"], reason);
    EXPECT_EQ(details[kByAttempt], by_attempt);
    EXPECT_THAT(details["ended_by"].get<std::string>(), HasSubstr(ended_by));
    last_words_ = details["last_words"].get<std::string>();
    const auto made = Do(index);
    ASSERT_TRUE(made) << made.error().message;
    EXPECT_EQ(made->episode, (std::vector<std::uint8_t>{1, 2, 3}));
    EXPECT_NE(slot_.pid(), before);
  }

  TemporaryFolder folder_;
  campaign::ProgressFunction progress_;
  std::string last_words_;
  Slot slot_;
};

TEST_F(SlotTest, MakesResultsAndTellsOfProgress) {
  std::vector<std::string> heard;
  progress_ = [&](std::string_view stage, std::uint32_t step) {
    heard.push_back(std::string(stage) + std::to_string(step));
  };
  const auto made = Do(0);
  ASSERT_TRUE(made) << made.error().message;
  EXPECT_EQ(made->outcome, "success");
  EXPECT_EQ(made->steps, 4u);
  EXPECT_EQ(heard, std::vector<std::string>{"reach3"});
}

TEST_F(SlotTest, ReplacesAChildThatCrashesAndKeepsItsLastWords) {
  ExpectReplaced(1, kChildCrashed, "SIGSEGV");
  EXPECT_THAT(last_words_, HasSubstr("out of luck"));
}

TEST_F(SlotTest, ReplacesAChildThatHangs) {
  const Stopwatch watch;
  ExpectReplaced(2, kChildHung, "without a word");
  EXPECT_LT(watch.Seconds(), 60);
}

TEST_F(SlotTest, ReplacesAChildThatSaysTheSameForEver) { ExpectReplaced(7, kChildHung, "without progress"); }

// A campaign may be more patient than a host.
TEST_F(SlotTest, IsAsPatientAsItsCampaign) {
  Slot hasty({.argv = {(ProgramFolder() / "scripted_child").string(), (folder_ / "state").string()},
              .name = "s1",
              .stall = 100ms});
  campaign::JoinedCampaign patient{"ef", {}, ""};
  patient.spec.stall_timeout_s = 3;
  ASSERT_TRUE(hasty.Begin(patient));
  const Stopwatch watch;
  const auto lost = hasty.Do({.index = 2, .attempt = 0, .weights = {}, .progress = {}}, {});
  ASSERT_TRUE(lost) << lost.error().message;
  EXPECT_GE(watch.Seconds(), 2.7);
  EXPECT_THAT(lost->details_json, HasSubstr("SIGKILL after 2.7 s"));
}

// Libraries were replaced while the host ran: what a new child makes is not what its host said that it makes.
TEST_F(SlotTest, AChildThatMakesOtherBytesThanItsHostSaidDoesNotWork) {
  Slot real({.argv = {(ProgramsFolder() / "etude-worker").string(), "--child"}, .name = "s2"});
  campaign::JoinedCampaign joined{"ab", {}, ""};
  joined.fingerprint = {{"libm", "other"}};
  const Status begun = real.Begin(joined);
  ASSERT_FALSE(begun);
  EXPECT_THAT(begun.error().message, HasSubstr("start the worker again"));
}

TEST_F(SlotTest, ReplacesAChildThatSaysGarbage) { ExpectReplaced(3, kChildCrashed, "frame", false); }

class TaskFileTest : public SlotTest {
 protected:
  // A campaign of a task that is done when the target has risen by so much.
  campaign::JoinedCampaign Campaign(const std::string& rise) {
    campaign::JoinedCampaign joined{"cd", {}, ""};
    joined.spec.tasks = {(folder_ / "own.yaml").string()};
    Say(rise);
    ForgetTaskFiles();
    joined.spec_sha256 = SpecHash(joined.spec);
    return joined;
  }
  void Say(const std::string& rise) {
    EXPECT_TRUE(WriteFileAtomically(folder_ / "own.yaml",
                                    "name: own\nwords: {verbs: [take]}\nstages: [approach, reach, "
                                    "grasp, lift, hold]\nsuccess: {risen: {by: " +
                                        rise + "}}\n"));
  }
};

TEST_F(TaskFileTest, AChildReadsTheTaskFilesOfTheNextCampaign) {
  ASSERT_TRUE(slot_.Begin(Campaign("3 cm")));
  const auto child = slot_.pid();
  const Status next = slot_.Begin(Campaign("5 cm"));
  EXPECT_TRUE(next) << next.error().message;
  EXPECT_EQ(slot_.pid(), child);
}

TEST_F(TaskFileTest, AChildThatFindsAnotherTaskThanTheCampaignsDoesNotWork) {
  ASSERT_TRUE(slot_.Begin(Campaign("3 cm")));
  Say("5 cm");
  EXPECT_TRUE(Do(0)) << "what was read counts";
  ASSERT_TRUE(Do(1)) << "its child crashes";
  const auto refused = Do(1);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, Code::kUnavailable);
  EXPECT_THAT(refused.error().message, HasSubstr("own.yaml' is not what it was then"));
}

TEST_F(SlotTest, AsksThePolicyForItsChild) {
  const auto made = Do(4);
  ASSERT_TRUE(made) << made.error().message;
  EXPECT_EQ(made->steps, 77u);
}

TEST_F(SlotTest, PassesAnErrorOfTheWorkOnAndKeepsTheChild) {
  const auto before = slot_.pid();
  const auto failed = Do(5);
  ASSERT_FALSE(failed);
  EXPECT_EQ(failed.error().code, Code::kUnavailable);
  EXPECT_EQ(failed.error().message, "no GL here");
  EXPECT_EQ(slot_.pid(), before);
}

TEST_F(SlotTest, GivesUpWhenChildrenDieWithoutOneResult) {
  for (int k = 0; k < 5; ++k) {
    const auto lost = Do(6);
    ASSERT_TRUE(lost) << k << lost.error().message;
    EXPECT_EQ(lost->outcome, kReleased);
  }
  const auto given_up = Do(6);
  ASSERT_FALSE(given_up);
  EXPECT_EQ(given_up.error().code, Code::kUnavailable);
  EXPECT_THAT(given_up.error().message, HasSubstr("SIGSEGV"));
  EXPECT_THAT(given_up.error().message, HasSubstr("out of luck"));
}

}  // namespace slot_test
}  // namespace etude::host
