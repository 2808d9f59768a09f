// SPDX-License-Identifier: Apache-2.0
// Tests trainer/checkpoint/metadata.cc: what a checkpoint says of itself, from a file that anybody may have written.
#include "trainer/checkpoint/metadata.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <string>

#include "tests/support/matchers.h"
#include "tests/trainer/checkpoint/example_checkpoint.h"
#include "tests/trainer/policy/fixtures.h"
#include "trainer/checkpoint/sizes.h"

namespace etude::checkpoint {
namespace metadata_test {

Metadata Example() {
  Metadata metadata;
  metadata.run = "demo";
  metadata.step = std::numeric_limits<std::uint64_t>::max();
  metadata.stage = 2;
  metadata.stages = 5;
  metadata.stage_name = "TAR3D";
  metadata.best = true;
  metadata.train_episodes = 600;
  metadata.dataset = "fingerprint";
  metadata.words = "can push red the";
  metadata.embodiment = ExampleEmbodiment();
  metadata.policy = policy::TinyConfig();
  for (const auto& module : metadata.policy.modules) metadata.modules[module.name] = {7, 0.01};
  metadata.modules["CTRL"] = {};
  metadata.metrics = {{"TAR3D.cm", 0.25}, {"CTRL.cm", std::nan("")}};
  metadata.train_config = {{"name", "example"}, {"checkpoint", {{"keep", 2}}}};
  return metadata;
}

// Of a file whose metadata says something else under one key.
Result<Metadata> With(const char* key, const std::string& value) {
  auto text = ToText(Example());
  text[key] = value;
  return FromText(text);
}

Result<Metadata> WithEmbodiment(const std::function<void(Embodiment&)>& change) {
  Metadata metadata = Example();
  change(metadata.embodiment);
  return FromText(ToText(metadata));
}

TEST(Metadata, ReadsBackWhatItSays) {
  const Metadata said = Example();
  const auto read = FromText(ToText(said));
  ASSERT_THAT(read, IsOk());
  EXPECT_EQ(read->run, said.run);
  EXPECT_EQ(read->step, said.step) << "also what no double holds";
  EXPECT_EQ(read->stage, said.stage);
  EXPECT_EQ(read->stages, said.stages);
  EXPECT_EQ(read->stage_name, said.stage_name);
  EXPECT_TRUE(read->best);
  EXPECT_EQ(read->train_episodes, said.train_episodes);
  EXPECT_EQ(read->dataset, said.dataset);
  EXPECT_EQ(read->words, said.words);
  EXPECT_THAT(Differences(read->embodiment, said.embodiment), testing::IsEmpty());
  EXPECT_EQ(read->modules.at("DISP").trained_steps, 7u);
  EXPECT_EQ(read->modules.at("DISP").error, 0.01);
  EXPECT_EQ(read->modules.at("CTRL").error, std::nullopt) << "never measured";
  EXPECT_EQ(read->metrics.at("TAR3D.cm"), 0.25);
  EXPECT_TRUE(std::isnan(read->metrics.at("CTRL.cm")));
  EXPECT_EQ(read->train_config, said.train_config);
  EXPECT_EQ(ToText(*read), ToText(said));
}

TEST(Metadata, NamesTheKeyThatIsMissing) {
  for (const char* key :
       {"run", "version", "stage_name", "dataset", "step", "stage", "stages", "best", "train_episodes", "embodiment",
        "modules", "metrics", "train_config", "policy_config", "architecture"}) {
    auto text = ToText(Example());
    ASSERT_EQ(text.erase(key), 1u) << key;
    const auto read = FromText(text);
    EXPECT_THAT(read, HasCode(Code::kCorrupt)) << key;
    EXPECT_THAT(read, MessageHas("metadata has no '" + std::string(key) + "'"));
  }
  auto text = ToText(Example());
  text.erase("words");
  const auto old = FromText(text);
  ASSERT_THAT(old, IsOk()) << "a file from before it";
  EXPECT_EQ(old->words, "");
}

TEST(Metadata, TakesWholeNumbersOnly) {
  for (const char* value : {"", " 12", "12 ", "1e3", "0x10", "-1", "18446744073709551616", "12\n"}) {
    EXPECT_THAT(With("step", value), HasCode(Code::kCorrupt)) << value;
    EXPECT_THAT(With("train_episodes", value), MessageHas("'train_episodes'")) << value;
  }
  EXPECT_THAT(With("stage", "2147483648"), MessageHas("'stage'"));
  EXPECT_THAT(With("best", "yes"), MessageHas("'best'"));
}

TEST(Metadata, NamesTheModuleThatIsNoRecord) {
  for (const char* value : {R"({"CTRL": 3})", R"({"CTRL": {}})", R"({"CTRL": {"trained_steps": -1}})",
                            R"({"CTRL": {"trained_steps": 1.5}})", R"({"CTRL": {"trained_steps": "many"}})",
                            R"({"CTRL": {"trained_steps": 1, "error": "small"}})"}) {
    EXPECT_THAT(With("modules", value), HasCode(Code::kCorrupt)) << value;
    EXPECT_THAT(With("modules", value), MessageHas("'CTRL' is not {trained_steps, error}")) << value;
  }
  EXPECT_THAT(With("modules", "[1]"), MessageHas("'modules' is not a JSON map"));
  EXPECT_THAT(ModulesFromJson(OrderedJson::array()), MessageHas("modules is not a map"));
  const auto unmeasured = With("modules", R"({"CTRL": {"trained_steps": 4, "error": null}})");
  ASSERT_THAT(unmeasured, IsOk());
  EXPECT_EQ(unmeasured->modules.at("CTRL").trained_steps, 4u);
}

TEST(Metadata, NamesTheMetricThatIsNoNumber) {
  EXPECT_THAT(With("metrics", R"({"a": 1, "b": "good"})"), MessageHas("'b' is not a number"));
  EXPECT_THAT(With("metrics", R"({"a": [1]})"), MessageHas("'a' is not a number"));
}

// What later code allocates from.
TEST(Metadata, BoundsWhatThePolicyWasTrainedFor) {
  EXPECT_THAT(WithEmbodiment([](auto& fits) { fits.joints = 0; }), MessageHas("0 joints"));
  EXPECT_THAT(WithEmbodiment([](auto& fits) { fits.joints = kMaxJoints; }), IsOk()) << "as CheckSizes has it";
  EXPECT_THAT(WithEmbodiment([](auto& fits) { fits.joints = kMaxJoints + 1; }), MessageHas("1025 joints"));
  EXPECT_THAT(WithEmbodiment([](auto& fits) { fits.width = kMaxPicture; }), IsOk());
  EXPECT_THAT(WithEmbodiment([](auto& fits) { fits.width = kMaxPicture + 1; }), MessageHas("4097x48 px"));
  EXPECT_THAT(WithEmbodiment([](auto& fits) { fits.height = -1; }), MessageHas("48x-1 px"));
}

}  // namespace metadata_test
}  // namespace etude::checkpoint
