// SPDX-License-Identifier: Apache-2.0
// Tests trainer/checkpoint/graph_picture.cc
#include "trainer/checkpoint/graph_picture.h"

#include <gmock/gmock.h>

#include "tests/support/matchers.h"
#include "tests/trainer/checkpoint/example_checkpoint.h"
#include "tests/trainer/policy/fixtures.h"

namespace etude::checkpoint {
namespace graph_picture_test {

using ::testing::HasSubstr;
using ::testing::Not;

Metadata Example() {
  Metadata metadata = ExampleCheckpoint(policy::TinyConfig(), 1161).metadata;
  metadata.train_config = {{"init", {{"freeze", {"TAR2D", "image", "attention2"}}}}};
  metadata.modules["TAR3D"].error = 0.0021;
  metadata.modules["LANG"].error = 0.003;
  metadata.modules["DISP"].error.reset();
  return metadata;
}

std::size_t CountOf(const std::string& text, const std::string& part) {
  std::size_t count = 0;
  for (auto at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++count;
  return count;
}

TEST(GraphPicture, SaysWhoReadsWhatAndHowFarItIs) {
  const std::string text = GraphText(Example());

  EXPECT_THAT(text, HasAll({"tiny: 7 modules, width 8, 2 heads; run demo step 1161, robot ur5, 12 demonstrations",
                            "level 2\n  EE2D\n", "  TAR2D  (frozen)\n    query    LANG\n    reads    image, self\n",
                            "attends  image@target", "says     target.displacement, m: difference of EE3D, TAR3D",
                            "trained  1161 steps, 0.21 cm", "trained  1161 steps, 99.70 % right",
                            "trained  1161 steps, never measured", "frozen beside the modules: attention2, image"}));
}

TEST(GraphPicture, DrawsABoxAPartAndAnArrowAReading) {
  const Metadata metadata = Example();
  const std::string svg = GraphSvg(metadata);

  EXPECT_EQ(CountOf(svg, "<rect x="), 3 + metadata.policy.modules.size());
  EXPECT_EQ(CountOf(svg, "url(#frozen)"), 2u);
  EXPECT_EQ(CountOf(svg, "stroke-dasharray"), 1u);  // TAR2D asks with LANG's register
  std::size_t attended = 0;
  for (const auto& module : metadata.policy.modules) attended += module.attend.size();
  EXPECT_EQ(CountOf(svg, "stroke-width=\"2.5\""), attended);
  EXPECT_EQ(CountOf(svg, "<svg"), 1u);
  EXPECT_EQ(CountOf(svg, "</svg>"), 1u);
}

TEST(GraphPicture, AttentionThatWeighsNothingIsNotSupervised) {
  Metadata metadata = Example();
  const std::size_t supervised = CountOf(GraphSvg(metadata), "stroke-width=\"2.5\"");
  policy::ModuleConfig& disp = *policy::FindModule(metadata.policy, "DISP");
  ASSERT_GT(disp.attend.size(), 0u);
  disp.attend_weight = 0;
  EXPECT_EQ(CountOf(GraphSvg(metadata), "stroke-width=\"2.5\""), supervised - disp.attend.size());
}

TEST(GraphPicture, OfAFileSaysNothingOfTraining) {
  Metadata metadata;
  metadata.policy = policy::TinyConfig();
  metadata.policy.name = "<&\">";
  EXPECT_THAT(GraphText(metadata), Not(HasSubstr("trained")));
  EXPECT_THAT(GraphSvg(metadata), HasSubstr("&lt;&amp;&quot;>"));
}

}  // namespace graph_picture_test
}  // namespace etude::checkpoint
