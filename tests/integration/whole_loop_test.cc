// SPDX-License-Identifier: Apache-2.0
// The whole system for real and in small: `etude up` with a collector, two workers, a trainer that follows the growing
// dataset, checkpoints on DDS, a policy server that subscribes, and workers that roll its answers out.
#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>

#include "services/campaign/process.h"
#include "services/core/command.h"
#include "services/core/config.h"
#include "services/core/file.h"
#include "services/store/dataset.h"
#include "services/store/safetensors.h"
#include "tests/integration/examples.h"
#include "tests/support/programs_folder.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/wait_until.h"

namespace etude {
namespace whole_loop_test {

constexpr int kDomain = 88, kSecuredDomain = 152;

Path Binary(const char* name) { return ProgramsFolder() / name; }

int RunCommand(const std::string& command) {
  const int status = std::system(command.c_str());
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

class WholeLoop : public testing::Test {
 protected:
  TemporaryFolder temporary_;
  Path folder_ = temporary_.path();
  Path out_ = folder_ / "out";
  Path log_ = folder_ / "up.log";

  void WriteConfigs(int episodes = 16, const char* split = "{train: 0.7, valid: 0.3}") {
    std::ofstream(folder_ / "campaign.yaml") << "name: loop\nepisodes: " << episodes << "\nsplit: " << split << "\n";
    std::ofstream(folder_ / "up.yaml")
        << "campaign: campaign.yaml\nworkers: 2\ntrain:\n  run: loop\n  start_episodes: 6\n"
           "  set: [data.batch=16, eval.every_steps=40, eval.frames=48, checkpoint.every_steps=40]\n"
           "eval:\n  episodes: 3\n  videos: 2\n";
  }

  // The identities that SECURITY.md has for `etude up`.
  void IssueIdentities(const Path& fleet) {
    const std::string security = Binary("etude").string() + " security ", quiet = " > " + log_.string() + " 2>&1";
    ASSERT_EQ(RunCommand(security + "init " + fleet.string() + quiet), 0) << ReadTextFile(log_).value_or("");
    for (const char* roles : {"--role collector --role gateway --role relay --name up", "--role worker --name worker",
                              "--role trainer --name trainer", "--role policy --role relay --name policy"})
      ASSERT_EQ(RunCommand(security + "issue " + fleet.string() + " " + roles + quiet), 0)
          << ReadTextFile(log_).value_or("");
  }

  // An evaluation whose video shows what the policy saw and said at each of its decisions.
  void ExpectAnOverlay(const Path& checkpoint) {
    const std::string command = Binary("etude").string() + " eval --checkpoint " + checkpoint.string() +
                                " --episodes 1 --workers 1 --overlay --first-draw --set rollout.max_steps=240 --out " +
                                (folder_ / "overlay").string() + " --domain " + std::to_string(kDomain) + " > " +
                                log_.string() + " 2>&1";
    ASSERT_EQ(RunCommand(command), 0) << ReadTextFile(log_).value_or("");
    const auto taken = store::DatasetReader::Open(folder_ / "overlay" / "rollouts");
    ASSERT_TRUE(taken) << taken.error().message;
    EXPECT_EQ(taken->spec().scenes, "first_draw");
    const std::string text = ReadTextFile(log_).value_or("");
    int shown = 0, decisions = -1;
    const auto line = text.find("overlay: ");
    ASSERT_NE(line, std::string::npos) << text;
    EXPECT_EQ(std::sscanf(text.c_str() + line, "overlay: %d of %d decisions", &shown, &decisions), 2) << text;
    EXPECT_GT(shown, 0);
    EXPECT_EQ(shown, decisions) << text;
    int videos = 0;
    for (const auto& entry : std::filesystem::directory_iterator(folder_ / "overlay" / "videos"))
      videos += entry.path().filename().string().ends_with("-overlay.mp4") ? 1 : 0;
    EXPECT_EQ(videos, 1);
  }

  // In the place of the one that has ended: all is there already, and its policy server stays.
  Result<campaign::Process> KeepRunning() {
    return campaign::Process::Start(
        {{Binary("etude").string(), "up", (folder_ / "up.yaml").string(), "--out", out_.string(), "--minutes", "0.4",
          "--domain", std::to_string(kDomain), "--set", "eval.seed=3", "--no-dashboard", "--keep-running"},
         folder_ / "kept.log",
         {}});
  }
  pid_t PolicyPid() const {
    const auto record = Json::parse(ReadTextFile(out_ / "up.json").value_or(""), nullptr, false);
    return record.is_object() ? record.value("/pids/policy"_json_pointer, -1) : -1;
  }

  // Refused, and what goes on with the folder stays what made it.
  void ExpectAnotherCampaignIsRefused() {
    const auto kept = ReadTextFile(out_ / "up.yaml");
    ASSERT_TRUE(kept.has_value());
    std::ofstream(folder_ / "campaign.yaml", std::ios::app) << "image_stride: 8\n";
    const std::string up = Binary("etude").string() + " up " + (folder_ / "up.yaml").string() + " --out " +
                           out_.string() + " --minutes 0.4 --set eval.seed=3 --no-dashboard --domain " +
                           std::to_string(kDomain) + " > " + log_.string() + " 2>&1";
    EXPECT_EQ(RunCommand(up), kExitUsage) << ReadTextFile(log_).value_or("");
    EXPECT_NE(ReadTextFile(log_).value_or("").find("image_stride"), std::string::npos);
    EXPECT_EQ(ReadTextFile(out_ / "up.yaml").value_or(""), *kept);
    WriteConfigs();
  }

  // Training is over and its process gone: who is started again has the weights from the relay.
  void ExpectAKilledPolicyServesAgain() {
    auto up = KeepRunning();
    ASSERT_TRUE(up.has_value()) << up.error().message;
    const auto log = [&] { return ReadTextFile(folder_ / "kept.log").value_or(""); };
    const std::chrono::seconds patience(120);
    ASSERT_TRUE(WaitUntil([&] { return log().find("serves on domain") != std::string::npos; }, patience)) << log();
    for (const int signal : {SIGTERM, SIGKILL}) {
      const pid_t killed = PolicyPid();
      ASSERT_GT(killed, 0);
      ASSERT_EQ(::kill(killed, signal), 0);
      ASSERT_TRUE(WaitUntil([&] { return PolicyPid() > 0 && PolicyPid() != killed; }, patience)) << signal << log();
      const auto driven = RunExample({(Binary("etude").parent_path() / "example-robot-driver").string(), "loop",
                                      "pick up the red can", std::to_string(kDomain), "30"},
                                     folder_ / "driver.log");
      EXPECT_EQ(driven.exit_code, 0) << signal << driven.text << log();
    }
    EXPECT_EQ(up->Stop(std::chrono::seconds(60)), 0) << log();
  }
};

TEST_F(WholeLoop, CollectsTrainsPublishesServesAndRollsOut) {
  WriteConfigs();
  const std::string up = Binary("etude").string() + " up " + (folder_ / "up.yaml").string() + " --out " +
                         out_.string() + " --minutes 0.4 --domain " + std::to_string(kDomain) +
                         " --set eval.seed=3 --dashboard-port 0 > " + log_.string() + " 2>&1";
  ASSERT_EQ(RunCommand(up), 0) << ReadTextFile(log_).value_or("");

  // every demonstration is there and whole
  const Path dataset = out_ / "dataset";
  const auto report = store::Verify(dataset, store::Quarantine::kNo);
  ASSERT_TRUE(report.has_value()) << report.error().message;
  EXPECT_EQ(report->good, 16u);
  EXPECT_TRUE(report->bad.empty());

  // a checkpoint was written that any reader of the format understands
  const auto checkpoint = store::ReadSafetensors(out_ / "run" / "loop" / "checkpoints" / "latest.safetensors");
  ASSERT_TRUE(checkpoint.has_value()) << checkpoint.error().message;
  EXPECT_GT(checkpoint->tensors.size(), 10u);

  // every rollout ended in a success or in a reason, driven by that run's policy
  const auto evaluation = std::filesystem::directory_iterator(out_ / "eval");  // one, of the last checkpoint
  const auto eval_text = ReadTextFile(evaluation->path() / "eval.json");
  ASSERT_TRUE(eval_text.has_value()) << eval_text.error().message;
  const Json eval = Json::parse(*eval_text);
  ASSERT_EQ(eval.at("per_episode").size(), 3u);
  for (const auto& episode : eval.at("per_episode")) EXPECT_NE(episode.value("outcome", ""), "policy_error");

  ExpectAnOverlay(out_ / "run" / "loop" / "checkpoints" / "latest.safetensors");

  // what deploy/examples shows works with that checkpoint
  const Path file = out_ / "run" / "loop" / "checkpoints" / "latest.safetensors";
  ExpectDriverFollowsAPolicy(Binary("etude").parent_path(), file, kDomain, folder_);
  ExpectSubscriberTakesACheckpoint(Binary("etude").parent_path(), file, kDomain, folder_);

  ExpectAnotherCampaignIsRefused();
  ExpectAKilledPolicyServesAgain();
}

// All of its processes with identities of their own: demonstrations, checkpoints, answers and rollouts get through.
TEST_F(WholeLoop, GoesThroughUnderSecurity) {
  WriteConfigs(8, "{train: 0.5, valid: 0.5}");
  const Path fleet = folder_ / "fleet";
  ASSERT_NO_FATAL_FAILURE(IssueIdentities(fleet));
  const std::string up = Binary("etude").string() + " up " + (folder_ / "up.yaml").string() + " --out " +
                         out_.string() + " --minutes 0.1 --domain " + std::to_string(kSecuredDomain) +
                         " --set workers=1 --set eval.episodes=1 --set eval.videos=0" +
                         " --dashboard-port 0 --security " + (fleet / "up").string() + " > " + log_.string() + " 2>&1";
  ASSERT_EQ(RunCommand(up), 0) << ReadTextFile(log_).value_or("");
  const auto report = store::Verify(out_ / "dataset", store::Quarantine::kNo);
  ASSERT_TRUE(report.has_value()) << report.error().message;
  EXPECT_EQ(report->good, 8u);
  const auto evaluation = std::filesystem::directory_iterator(out_ / "eval");
  const Json eval = Json::parse(ReadTextFile(evaluation->path() / "eval.json").value_or("{}"));
  ASSERT_EQ(eval.value("per_episode", Json::array()).size(), 1u) << ReadTextFile(log_).value_or("");
  EXPECT_NE(eval["per_episode"][0].value("outcome", ""), "policy_error");
}

// that it publishes what it errs on, and that the collection it hosts leases more of it
TEST_F(WholeLoop, ATrainingThatHostsItsCollectionAsksForWhatItLacks) {
  std::ofstream(folder_ / "campaign.yaml") << "name: lacks\nepisodes: 400\nsplit: {train: 0.7, valid: 0.3}\n"
                                              "adaptive_sampling: {share: 0.5, every: 10}\n";
  const std::string domain = std::to_string(kDomain);
  std::vector<std::string> words{Binary("etude").string(),
                                 "train",
                                 "--collect",
                                 (folder_ / "campaign.yaml").string(),
                                 "--config",
                                 "compact",
                                 "--out",
                                 (folder_ / "run").string(),
                                 "--steps",
                                 "2000",
                                 "--domain",
                                 domain};
  for (const char* set : {"curriculum.enabled=false", "data.batch=16", "data.min_episodes=6", "data.min_valid=2",
                          "eval.every_steps=10", "eval.frames=48"})
    words.insert(words.end(), {"--set", set});
  auto trainer = campaign::Process::Start({words, log_, {}});
  ASSERT_TRUE(trainer) << trainer.error().message;
  auto worker = campaign::Process::Start(
      {{Binary("etude").string(), "worker", "--campaign", "lacks", "--domain", domain}, folder_ / "worker.log", {}});
  ASSERT_TRUE(worker) << worker.error().message;
  const auto asked = [&] {
    const auto journal = ReadTextFile(folder_ / "run" / "dataset" / "sampling.jsonl");
    return journal && journal->find("from_index") != std::string::npos;
  };
  EXPECT_TRUE(WaitUntil([&] { return asked() || !trainer->running(); }, std::chrono::minutes(3)));
  EXPECT_TRUE(asked()) << ReadTextFile(log_).value_or("");
  (void)worker->Stop(std::chrono::seconds(60));
  (void)trainer->Stop(std::chrono::seconds(60));
}

}  // namespace whole_loop_test
}  // namespace etude
