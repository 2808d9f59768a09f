// SPDX-License-Identifier: Apache-2.0
// Power that is lost at any point of what a trainer writes: what `latest` and `best` name, and the state that --resume
// goes on from, must load. What a collector writes is in disk_faults_test.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <sstream>
#include <string>
#include <string_view>

#include "services/core/rng.h"
#include "services/store/safetensors.h"
#include "tests/faults/campaign_run.h"
#include "tests/faults/disk_model.h"
#include "tests/faults/trainer_run.h"
#include "tests/support/temporary_folder.h"
#include "tests/trainer/data/synthetic_dataset.h"

namespace etude::faults {
namespace power_loss_test {

using namespace std::chrono_literals;

// Steps that are safe, by the trainer's own word: of the newest checkpoint, and of the state that was written after the
// one before it.
struct Promised {
  int checkpoint = 0, state = 0;
};

Promised PromisedIn(const std::string& points) {
  Promised promised;
  std::istringstream lines(points);
  std::string name;
  for (int step = 0; lines >> name >> step;)
    if (name == "trainer.checkpoint_kept") promised = {step, promised.checkpoint};
  return promised;
}

// The step of the checkpoint that a link names; -1 where there is no link. What it names is there and whole.
int StepOfLink(const Files& files, const std::string& channel) {
  const std::string folder = "run/checkpoints/";
  const auto link = files.find(folder + channel + ".safetensors");
  if (link == files.end()) return -1;
  const std::string target(link->second.begin(), link->second.end());
  const auto named = files.find(folder + target);
  EXPECT_NE(named, files.end()) << channel << " -> " << target;
  if (named == files.end()) return -1;
  const auto whole = store::DecodeSafetensors(named->second);
  EXPECT_TRUE(whole) << channel << " -> " << target << ": " << whole.error().message;
  return std::atoi(target.c_str());
}

int StepOfState(const Files& files) {
  const auto file = files.find("run/training_state.safetensors");
  if (file == files.end()) return -1;
  const auto state = store::DecodeSafetensors(file->second);
  EXPECT_TRUE(state) << state.error().message;
  return state ? OrderedJson::parse(state->metadata.at("run"))["step"].get<int>() : -1;
}

// Operations that change what loads: those of checkpoints, links and the state, and of folders.
bool Matters(const DiskOperation& operation) {
  if (!operation.path.starts_with("run") || operation.kind == 's' || operation.kind == 'd') return false;
  return operation.kind == 'D' || operation.kind == 'M' || operation.path.find(".safetensors") != std::string::npos;
}

TEST(Faults, F16EveryPrefixOfWhatATrainerWritesLoads) {
  const TemporaryFolder folder;
  const CampaignSpec spec = SyntheticSpec(learn::kTinyPicture, learn::kTinyPicture);
  AddSyntheticEpisodes(folder / "data", spec, 0, 24);
  const Path own = folder / "own";
  ASSERT_TRUE(MakeFolders(own));
  auto environment = Shim(own);
  environment["ETUDE_SHIM_TRACE"] = (folder / "trace").string();
  environment["ETUDE_CRASH_LOG"] = (own / "points").string();
  const Path log = folder / "trainer.log";
  // two are kept, so that older ones are removed
  auto trainer = StartTrainer({folder / "data", own / "run", log, false, 2, environment});
  ASSERT_EQ(trainer.Wait(120s), 0) << ReadTextFile(log).value_or("");

  DiskModel disk;
  Rng rng(16);
  std::uint64_t operations = 0, states = 0;
  Promised promised;
  for (const DiskOperation& operation : ReadTrace(folder / "trace")) {
    disk.Apply(operation);
    ++operations;
    if (!Matters(operation)) continue;
    promised = PromisedIn(disk.TextOf("points"));
    for (const Survives survives : {Survives::kNothing, Survives::kNames, Survives::kSome, Survives::kAll}) {
      const Files files = disk.AfterLoss(survives, rng);
      const int latest = StepOfLink(files, "latest"), state = StepOfState(files);
      (void)StepOfLink(files, "best");
      EXPECT_GE(std::max(latest, 0), promised.checkpoint);
      EXPECT_GE(std::max(state, 0), promised.state);
      ASSERT_FALSE(testing::Test::HasFailure()) << "after " << operations << " operations, the last one of "
                                                << operation.path << ", survivors " << static_cast<int>(survives);
      ++states;
    }
  }
  EXPECT_EQ(promised.checkpoint, kSteps);
  const Files whole = disk.AfterLoss(Survives::kNothing, rng);
  EXPECT_EQ(StepOfLink(whole, "latest"), kSteps);
  EXPECT_EQ(StepOfState(whole), kSteps);
  ReportAsserted("F16", fmt::format("power lost after each of {} operations of a trainer, {} states of the disk: what "
                                    "`latest` and `best` name, and the state, load, and are as new as it had said",
                                    operations, states));
}

// The model itself: a link that is made before what it names is safe.
TEST(Faults, F16TheModelSeesALinkThatCameTooEarly) {
  const auto text = [](std::string_view from) { return std::vector<std::uint8_t>(from.begin(), from.end()); };
  DiskModel disk;
  Rng rng(1);
  for (const auto& operation :
       {DiskOperation{'M', 0, 0, "run", {}}, DiskOperation{'M', 0, 0, "run/checkpoints", {}},
        DiskOperation{'C', 2, 1, "run/checkpoints/00000010.safetensors", {}},
        DiskOperation{'W', 2, 0, "run/checkpoints/00000010.safetensors", text("bytes")},
        DiskOperation{'L', 0, 0, "run/checkpoints/latest.tmp", text("00000010.safetensors")},
        DiskOperation{'R', 0, 0, "run/checkpoints/latest.safetensors", text("run/checkpoints/latest.tmp")}})
    disk.Apply(operation);
  const Files files = disk.AfterLoss(Survives::kNames, rng);
  EXPECT_EQ(files.at("run/checkpoints/latest.safetensors"), text("00000010.safetensors"))
      << "it is there with its name";
  EXPECT_TRUE(files.at("run/checkpoints/00000010.safetensors").empty()) << "and what it names is not";
}

}  // namespace power_loss_test
}  // namespace etude::faults
