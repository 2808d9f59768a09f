// SPDX-License-Identifier: Apache-2.0
// Tests trainer/learn/config.cc and the shipped experiments
#include "trainer/learn/config.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <stdexcept>

#include "services/core/config_reference.h"
#include "services/core/file.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::learn {
namespace config_test {

using ::testing::HasSubstr;
using ::testing::IsSupersetOf;

const Path kExperiments = "trainer/experiments";

TEST(TrainConfig, SaysOfEveryKeyWhatItMeansAndInWhichUnit) {
  EXPECT_THAT(MissingFromReference(ConfigReference<TrainConfig>()), testing::IsEmpty());
}

TEST(LoadTrainConfig, ReadsTheShippedExperimentsWithTheirPolicies) {
  for (const char* name : {"compact", "paper"}) {
    const auto config = LoadTrainConfig(name, kExperiments, {});
    ASSERT_TRUE(config) << config.error().message;
    EXPECT_EQ(config->policy.name, name);
    EXPECT_GE(config->policy.modules.size(), 7u);
  }
}

// one graph, two image encoders; what decoders cost is weighed otherwise against attention, which is asked for of each
// key, and a module that nobody attends to keeps the verb in the sentence
TEST(LoadTrainConfig, FaithfulIsThePaperButForItsImageEncoderLossesAndTask) {
  const auto faithful = LoadTrainConfig("faithful", kExperiments, {});
  const auto paper = LoadTrainConfig("paper", kExperiments, {});
  ASSERT_TRUE(faithful) << faithful.error().message;
  auto ours = ToJson(faithful->policy), theirs = ToJson(paper->policy);
  EXPECT_NE(ours["image"]["layers"], theirs["image"]["layers"]);
  for (auto* policy : {&ours, &theirs}) {
    (*policy)["image"].erase("layers");
    policy->erase("name");
  }
  for (auto& [name, cost] : theirs["losses"].items())
    if (name != "attention") cost["weight"] = (name == "gripper" ? 2400 : 300) * cost["weight"].get<double>();
  theirs["losses"]["attention"]["kind"] = "mse_each";
  const OrderedJson task = ours["modules"].back();
  EXPECT_EQ(task["name"], "TASK");
  EXPECT_EQ(task["decoder"]["quantity"], "task");
  for (const auto& module : faithful->policy.modules)
    EXPECT_EQ(std::ranges::count(module.attend, "TASK"), 0) << module.name;
  ours["modules"].erase(ours["modules"].size() - 1);
  EXPECT_EQ(ours, theirs);
  for (const auto& layer : faithful->policy.image.layers) EXPECT_LE(layer.channels, 32);
  for (const auto& config : {*faithful, *paper}) {
    EXPECT_EQ(config.curriculum.relabelled, "before_last");
    EXPECT_GT(config.data.sentences, 1);
    EXPECT_EQ(config.optimizer.clip, 1);
  }
}

TEST(LoadTrainConfig, OverridesInsideTheNamedPolicy) {
  const auto config =
      LoadTrainConfig("compact", kExperiments, {"policy.width=48", "optimizer.lr=1e-4", "data.batch=7"});
  ASSERT_TRUE(config) << config.error().message;
  EXPECT_EQ(config->policy.width, 48);
  EXPECT_EQ(config->optimizer.lr, 1e-4);
  EXPECT_EQ(config->data.batch, 7);

  const auto other = LoadTrainConfig("compact", kExperiments, {"policy=paper/base"});
  ASSERT_TRUE(other) << other.error().message;
  EXPECT_EQ(other->policy.name, "paper");
}

TEST(LoadTrainConfig, TakesTheLanguageInAWord) {
  const auto config = LoadTrainConfig("compact", kExperiments, {"policy.language=clip:/models/clip"});
  ASSERT_TRUE(config) << config.error().message;
  EXPECT_EQ(config->policy.language.clip_folder(), "/models/clip");
  const auto key = LoadTrainConfig("paper", kExperiments, {"policy.language.encoder=clip:/models/clip"});
  ASSERT_TRUE(key) << key.error().message;
  EXPECT_EQ(key->policy.language.clip_folder(), "/models/clip");
  EXPECT_THAT(LoadTrainConfig("compact", kExperiments, {"policy.language=clop:/models"}).error().message,
              HasSubstr("neither default nor conv nor clip:DIR"));
}

TEST(LoadTrainConfig, ReadsBackItsOwnResolvedFile) {
  const TemporaryFolder folder;
  const auto config = LoadTrainConfig("compact", kExperiments, {"policy.width=48", "seed=9"});
  ASSERT_TRUE(config);
  ASSERT_TRUE(WriteFileAtomically(folder / "config.yaml", ToYaml(ToJson(*config))));

  const auto again = LoadTrainConfig((folder / "config.yaml").string(), kExperiments, {});

  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(ToJson(*again), ToJson(*config));
}

// a run notes there where its data lay
TEST(LoadTrainConfig, ReadsBackWhatARunOfSeveralDatasetsWrote) {
  const TemporaryFolder folder;
  const auto config = LoadTrainConfig("compact", kExperiments, {});
  ASSERT_TRUE(config);
  OrderedJson json = ToJson(*config);
  json["datasets"] = {"/data/a", "/data/b"};
  ASSERT_TRUE(WriteFileAtomically(folder / "config.yaml", ToYaml(json)));
  const auto again = LoadTrainConfig((folder / "config.yaml").string(), kExperiments, {});
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(ToJson(*again), ToJson(*config));
}

std::vector<std::string> Names(const TrainConfig& config) {
  std::vector<std::string> names;
  for (const auto& module : config.policy.modules) names.push_back(module.name);
  return names;
}

TEST(LoadTrainConfig, RefusesWhatItDoesNotKnowByName) {
  const auto typo = LoadTrainConfig("compact", kExperiments, {"optimiser.lr=1"});
  EXPECT_THAT(typo.error().message, HasSubstr("did you mean 'optimizer'"));
  const auto name = LoadTrainConfig("compakt", kExperiments, {});
  EXPECT_EQ(name.error().code, Code::kInvalidArgument);
  EXPECT_THAT(name.error().message, HasSubstr("compact"));
  const auto policy = LoadTrainConfig("compact", kExperiments, {"policy=papr/base"});
  EXPECT_THAT(policy.error().message, HasSubstr("paper"));
}

TEST(LoadTrainConfig, NamesAllProblemsAtOnce) {
  const auto config = LoadTrainConfig(
      "compact", kExperiments, {"optimizer.lr=-1", "data.batch=0", "curriculum.patience=0", "init.freeze=[NONE]"});
  ASSERT_FALSE(config);
  for (const char* part : {"optimizer.lr", "data.batch", "curriculum.patience", "NONE"})
    EXPECT_THAT(config.error().message, HasSubstr(part));
}

// an infinite run could not be resumed: JSON has no such number
TEST(LoadTrainConfig, RefusesMinutesWithoutAnEnd) {
  for (const char* minutes : {"minutes=.inf", "minutes=-1", "minutes=.nan"}) {
    const auto config = LoadTrainConfig("compact", kExperiments, {minutes});
    EXPECT_FALSE(config) << minutes;
  }
}

TEST(LoadTrainConfig, KnowsEveryHierarchyOfBothPresets) {
  for (const char* preset : {"compact", "paper"})
    for (const char* name : {"base", "obstacle", "multi_obstacle", "relational"}) {
      const auto config = LoadTrainConfig(preset, kExperiments, {fmt::format("policy={}/{}", preset, name)});
      ASSERT_TRUE(config) << preset << "/" << name << ": " << config.error().message;
      EXPECT_EQ(config->policy.width, LoadTrainConfig(preset, kExperiments, {})->policy.width);
    }
  const auto relational = LoadTrainConfig("compact", kExperiments, {"policy=compact/relational"});
  EXPECT_THAT(Names(*relational), IsSupersetOf({"LANG", "LANG2", "REF2D", "REF3D", "DISP2", "CTRL"}));
}

TEST(LoadTrainConfig, AddsModulesByName) {
  const auto added = LoadTrainConfig("compact", kExperiments, {"add=[obstacle]"});
  ASSERT_TRUE(added) << added.error().message;
  EXPECT_EQ(ToJson(added->policy),
            ToJson(LoadTrainConfig("compact", kExperiments, {"policy=compact/obstacle"})->policy));

  const auto unknown = LoadTrainConfig("compact", kExperiments, {"add=[obstacel]"});
  ASSERT_FALSE(unknown);
  EXPECT_THAT(unknown.error().message, HasSubstr("did you mean 'obstacle'"));
  const auto twice = LoadTrainConfig("compact", kExperiments, {"policy=compact/obstacle", "add=[obstacle]"});
  ASSERT_FALSE(twice);
  EXPECT_THAT(twice.error().message, HasSubstr("has a module \"OBST2D\" already"));

  // before, a module that was misspelt was a new one that said nothing
  const TemporaryFolder folder;
  ASSERT_THAT(WriteFileAtomically(folder / "more.yaml",
                                  std::string_view("modules: [{name: CTRl, decoder: {inputs: ['position:EE3D']}}]\n")),
              IsOk());
  const auto misspelt = LoadTrainConfig("compact", kExperiments, {"add=[" + (folder / "more.yaml").string() + "]"});
  ASSERT_FALSE(misspelt);
  EXPECT_THAT(misspelt.error().message, HasSubstr("did you mean 'CTRL'"));
}

TEST(LoadTrainConfig, TakesTheGraphOfACheckpoint) {
  const auto graph_of = [](const std::string& file) -> Result<OrderedJson> {
    EXPECT_EQ(file, "a.safetensors");
    auto json = ParseYaml(ReadTextFile("trainer/experiments/policies/compact/base.yaml").value(), "base").value();
    json["width"] = 32;
    return json;
  };
  const std::vector<std::string> overrides{"init.from=a.safetensors", "policy=checkpoint", "add=[obstacle]",
                                           "init.freeze=[LANG, image]", "policy.heads=2"};
  const auto config = LoadTrainConfig("compact", kExperiments, overrides, graph_of);
  ASSERT_TRUE(config) << config.error().message;
  EXPECT_EQ(config->policy.width, 32);
  EXPECT_EQ(config->policy.heads, 2);
  EXPECT_THAT(Names(*config), IsSupersetOf({"OBST2D", "OBST3D", "DISP2"}));

  const auto none = LoadTrainConfig("compact", kExperiments, {"policy=checkpoint"}, graph_of);
  ASSERT_FALSE(none);
  EXPECT_THAT(none.error().message, HasSubstr("init.from"));
  EXPECT_FALSE(LoadTrainConfig("compact", kExperiments, {"init.copy=[LANG]"}));
}

// With attention that is shared, and `reads: [all]`, an addition would be a key of every trained module.
TEST(LoadTrainConfig, LeavesWhatTrainedModulesRead) {
  const auto graph_of = [](const std::string&) -> Result<OrderedJson> {
    return ParseYaml(ReadTextFile("trainer/experiments/policies/paper/base.yaml").value(), "base").value();
  };
  const auto reads = [](const TrainConfig& config, const std::string& name) {
    const auto module = std::ranges::find(config.policy.modules, name, &policy::ModuleConfig::name);
    return module == config.policy.modules.end() ? std::vector<std::string>() : module->reads;
  };
  const auto begun = LoadTrainConfig("paper", kExperiments,
                                     {"init.from=a.safetensors", "policy=checkpoint", "add=[obstacle]"}, graph_of);
  ASSERT_TRUE(begun) << begun.error().message;
  EXPECT_THAT(reads(*begun, "EE3D"), testing::ElementsAre("image", "language", "joints", "LANG", "EE2D", "TAR2D"));
  EXPECT_THAT(reads(*begun, "OBST3D"), testing::ElementsAre("all"));
  EXPECT_THAT(reads(*begun, "CTRL"), testing::ElementsAre("all")) << "the addition names it";

  const auto scratch = LoadTrainConfig("paper", kExperiments, {"add=[obstacle]"});
  ASSERT_TRUE(scratch) << scratch.error().message;
  EXPECT_THAT(reads(*scratch, "EE3D"), testing::ElementsAre("all"));
}

/// What `etude results` asks etude-trainer for, of one row of its file.
class ResultsFile {
 public:
  ResultsFile() : rows_(ParseYaml(ReadTextFile("deploy/docs/results.yaml").value(), "results").value().at("rows")) {}

  const OrderedJson& rows() const { return rows_; }
  const OrderedJson& Row(const std::string& name) const {
    for (const auto& row : rows_)
      if (row.at("name") == name) return row;
    throw std::out_of_range(name);
  }
  // of the row that it begins with; "" of an experiment's own
  std::string GraphOf(const OrderedJson& row) const {
    const OrderedJson& train = row.at("train");
    if (train.contains("init")) return GraphOf(Row(train.at("init").get<std::string>()));
    for (const auto& text : SetOf(train))
      if (text.starts_with("policy=")) return text.substr(std::string("policy=").size());
    return "";
  }
  std::vector<std::string> OverridesOf(const OrderedJson& row) const {
    const OrderedJson& train = row.at("train");
    std::vector<std::string> overrides;
    if (const std::string graph = GraphOf(row); !graph.empty()) overrides.push_back("policy=" + graph);
    if (train.contains("init")) overrides.emplace_back("init.from=a.safetensors");
    for (const auto& [key, option] : {std::pair{"add", "add"}, {"freeze", "init.freeze"}, {"fresh", "init.fresh"}})
      if (train.contains(key)) overrides.push_back(std::string(option) + "=" + train.at(key).dump());
    for (auto& text : SetOf(train))
      if (!text.starts_with("policy=")) overrides.push_back(std::move(text));
    return overrides;
  }

 private:
  static std::vector<std::string> SetOf(const OrderedJson& train) {
    return train.value("set", std::vector<std::string>{});
  }
  OrderedJson rows_;
};

// A name in a row that no graph has would be found after hours of collecting.
TEST(LoadTrainConfig, TakesWhatTheRowsOfTheResultsAsk) {
  const ResultsFile file;
  int trained = 0;
  for (const auto& row : file.rows()) {
    if (row.at("train").contains("runs_of")) continue;
    const auto name = row.at("train").value("config", std::string("compact"));
    const auto config = LoadTrainConfig(name, kExperiments, file.OverridesOf(row));
    EXPECT_TRUE(config) << row.at("name") << ": " << config.error().message;
    const auto& data = row.at("data");
    EXPECT_TRUE(std::filesystem::exists("deploy/campaigns/" + data.at("campaign").get<std::string>() + ".yaml"))
        << data;
    ++trained;
  }
  EXPECT_GT(trained, 20);
}

// config.yaml of a run of before there was `init`
TEST(LoadTrainConfig, ReadsFreezeWhereItStoodBefore) {
  const auto config = LoadTrainConfig("compact", kExperiments, {"freeze=[TAR3D]"});
  ASSERT_TRUE(config) << config.error().message;
  EXPECT_THAT(config->init.freeze, testing::ElementsAre("TAR3D"));
}

// `--resume --freeze LANG` of an older run was passed over without a word
TEST(LoadTrainConfig, WhatIsSaidNowComesBeforeTheFreezeOfOldFiles) {
  const TemporaryFolder folder;
  ASSERT_TRUE(WriteFileAtomically(folder / "old.yaml", std::string_view("policy: compact/base\nfreeze: []\n")));
  const auto config = LoadTrainConfig((folder / "old.yaml").string(), kExperiments, {"init.freeze=[LANG]"});
  ASSERT_TRUE(config) << config.error().message;
  EXPECT_THAT(config->init.freeze, testing::ElementsAre("LANG"));
}

}  // namespace config_test
}  // namespace etude::learn
