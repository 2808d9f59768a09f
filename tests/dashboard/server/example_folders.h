// SPDX-License-Identifier: Apache-2.0
// A small lab: a dataset with failed attempts, a run with checkpoints, two evaluations of the same scenes, a log.
// Written by the store's own writers where it has some.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "services/core/identity.h"
#include "services/spec/episode_plan.h"
#include "services/store/dataset.h"
#include "services/store/safetensors.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude {

inline constexpr std::uint64_t kEpisodes = 6, kSteps = 50;
/// Beyond what a JavaScript number holds.
inline constexpr std::uint64_t kLargeSeed = 6285334756670210419ull;

inline void WriteExampleDataset(const Path& folder, std::uint64_t episodes = kEpisodes) {
  CampaignSpec spec = SyntheticSpec();
  spec.seed = kLargeSeed;
  auto writer = store::DatasetWriter::Open(folder, spec);
  ASSERT_TRUE(writer) << writer.error().message;
  for (std::uint64_t i = 0; i < episodes; ++i) {
    const Status committed = writer->Commit(MakeSyntheticEpisode(spec, i, kSteps));
    ASSERT_TRUE(committed) << committed.error().message;
  }
  ASSERT_TRUE(writer->RecordFailure(
      2, 0, "plan_failed",
      R"({"reason":"reach: no path","plan_s":0.25,"step_s":0.5,"render_s":0.1,"deflate_s":0.01})"));
  ASSERT_TRUE(writer->RecordFailure(9, 0, "grasp_missed", R"({"reason":"grasp: nothing in the hand"})"));
  ASSERT_TRUE(writer->WriteMaster());
  ASSERT_TRUE(OpenIdentity(folder));
}

inline std::string MetricsText() {
  std::string text;
  for (int step = 50; step <= 200; step += 50)
    text += OrderedJson{{"kind", "train"},
                        {"step", step},
                        {"elapsed_s", step / 10.0},
                        {"time", 1795369600.0 + step},
                        {"loss", step == 150 ? OrderedJson() : OrderedJson(100.0 / step)},
                        {"LANG.decode", 0.5},
                        {"data_wait", 0.01},
                        {"samples_per_second", 900.0},
                        {"stage", 2.0}}
                .dump() +
            "\n";
  text +=
      R"({"kind":"valid","step":200,"elapsed_s":21.0,"time":1795369821.0,"LANG.accuracy":0.75,"TAR3D.cm":0.5,"loss":1.0})"
      "\n";
  return text + R"({"kind":"train","st)";  // torn
}

inline constexpr const char* kExampleConfig = R"(name: example
steps: 200
data: {batch: 32, sentences: 6}
curriculum: {goals: {LANG: 0.01, TAR3D: 0.012, CTRL: 0.015}}
checkpoint: {every_steps: 50}
policy:
  modules:
    - {name: LANG, level: 1, reads: [language], attend: [language], query: "", detach: false,
       decoder: {entity: target, quantity: class, readout: mlp, from: [], inputs: [register]}}
    - {name: TAR3D, level: 2, reads: [image, LANG], attend: [image@target], query: LANG, detach: false,
       decoder: {entity: target, quantity: position, readout: mlp, from: [], inputs: [register, class:LANG]}}
)";

inline void WriteExampleRun(const Path& folder) {
  ASSERT_TRUE(WriteFileAtomically(folder / "config.yaml", kExampleConfig));
  ASSERT_TRUE(WriteFileAtomically(folder / "metrics.jsonl", MetricsText()));
  ASSERT_TRUE(WriteFileAtomically(
      folder / "curriculum.jsonl",
      R"({"step":100,"from":1,"to":2,"name":"TAR3D","cause":"budget","reason":"15 % of the run are over"})"
      "\n"));
  ASSERT_TRUE(OpenIdentity(folder));
  store::Safetensors content;
  content.metadata = {{"step", "200"},
                      {"stage", "2"},
                      {"stages", "2"},
                      {"stage_name", "TAR3D"},
                      {"run", "example"},
                      {"refused", ""},
                      {"version", "0.1.0"},
                      {"train_episodes", "5"},
                      {"words", "coke pick the up"},
                      {"metrics", R"({"TAR3D.cm":0.5})"},
                      {"architecture", std::string(64, 'a')},
                      {"modules", R"({"LANG":{"trained_steps":200,"error":0.25}})"},
                      {"embodiment", R"({"robot":"ur5","joints":7})"}};
  content.tensors["modules.LANG.w"] = {store::DType::kF32, {2, 3}, std::vector<std::uint8_t>(24)};
  ASSERT_TRUE(MakeFolders(folder / "checkpoints"));
  ASSERT_TRUE(store::WriteSafetensors(folder / "checkpoints" / "00000200.safetensors", content));
  std::filesystem::create_symlink("00000200.safetensors", folder / "checkpoints" / "latest.safetensors");
}

/// @param failed  index of the one rollout that did not succeed
inline void WriteExampleEval(const Path& folder, std::uint64_t failed, std::uint64_t seed = 9001) {
  CampaignSpec spec = SyntheticSpec();
  spec.mode = "rollout";
  spec.rollout.run = "example";
  spec.seed = seed;
  spec.episodes = 4;
  auto writer = store::DatasetWriter::Open(folder / "rollouts", spec);
  ASSERT_TRUE(writer) << writer.error().message;
  OrderedJson rows = OrderedJson::array();
  for (std::uint64_t i = 0; i < spec.episodes; ++i) {
    const EpisodePlan plan = PlanEpisode(spec, i, 0);
    rows.push_back({{"index", i},
                    {"seed", plan.seed},
                    {"task", plan.task.text()},
                    {"target", plan.target},
                    {"instruction", "pick it up"},
                    {"success", i != failed},
                    {"success_latched", true},
                    {"outcome", i != failed ? "success" : "timeout"},
                    {"steps", 100},
                    {"checkpoint_step", 200},
                    {"error_cm", {{"TAR3D", 0.2}}}});
  }
  const OrderedJson share{{"successes", 3}, {"share", 0.75}, {"low", 0.3}, {"high", 0.95}};
  const OrderedJson overall{
      {"task", "overall"}, {"n", 4}, {"success", share}, {"success_latched", share}, {"error_cm", {{"TAR3D", 0.2}}}};
  const OrderedJson report{{"campaign", "synthetic"},
                           {"run", "example"},
                           {"seed", seed},
                           {"episodes", 4},
                           {"done", 4},
                           {"per_task", {overall}},
                           {"overall", overall},
                           {"latency", {{"setting_ms", 0}}},
                           {"per_episode", rows}};
  ASSERT_TRUE(WriteFileAtomically(folder / "eval.json", report.dump()));
  ASSERT_TRUE(WriteFileAtomically(folder / "videos" / "000001-pick-success.mp4", "not really a video"));
}

/// Below one folder named "lab": data, run, eval_a, eval_b, eval_other (other scenes), logs.
class ExampleFolders {
 public:
  ExampleFolders() {
    using std::filesystem::copy_options;
    std::filesystem::copy(Made(), root(), copy_options::recursive | copy_options::copy_symlinks);
    for (const char* folder : {"data", "run"}) EXPECT_TRUE(OpenIdentity(root() / folder));
  }
  Path root() const { return folder_ / "lab"; }

 private:
  // Written once for all tests of a program, without the ids that each copy has for itself.
  static Path Made() {
    static const TemporaryFolder folder;
    static const bool written = (Write(folder / "lab"), true);
    (void)written;
    return folder / "lab";
  }
  static void Write(const Path& lab) {
    WriteExampleDataset(lab / "data");
    WriteExampleRun(lab / "run");
    for (const char* of : {"data", "run"}) std::filesystem::remove(lab / of / "identity.json");
    WriteExampleEval(lab / "eval_a", 0);
    WriteExampleEval(lab / "eval_b", 1);
    WriteExampleEval(lab / "eval_other", 1, 9002);
    EXPECT_TRUE(
        WriteFileAtomically(lab / "logs" / "trainer.log",
                            "17:22:57 info etude-trainer: begins\n17:22:58 warn etude-trainer: slow disk\nend\n"));
  }

  TemporaryFolder folder_;
};

}  // namespace etude
