// SPDX-License-Identifier: Apache-2.0
// `etude` run in a folder of its own, and small datasets and checkpoints to run it on.
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <string>
#include <vector>

#include "services/core/command.h"
#include "services/core/config.h"
#include "services/store/dataset.h"
#include "services/store/safetensors.h"
#include "tests/support/etude_command.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude {

class CliFixture : public testing::Test {
 protected:
  CommandOutcome Etude(const std::vector<std::string>& arguments) {
    return RunEtude(arguments, folder_ / "output.txt");
  }
  std::string WriteFile(const std::string& name, const std::string& text) {
    EXPECT_TRUE(WriteFileAtomically(folder_ / name, std::string_view(text)));
    return (folder_ / name).string();
  }
  std::string In(const std::string& name) { return (folder_ / name).string(); }
  OrderedJson JsonOf(std::vector<std::string> arguments) {
    arguments.push_back("--json");
    const CommandOutcome outcome = Etude(arguments);
    EXPECT_EQ(outcome.exit_code, kExitOk) << outcome.text;
    return OrderedJson::parse(outcome.text, nullptr, false);
  }
  // Synthetic episodes of 10 steps, committed in this order; two attempts failed before.
  void WriteDataset(const std::string& name, const std::vector<std::uint64_t>& indices) {
    CampaignSpec spec = SyntheticSpec();
    auto writer = store::DatasetWriter::Open(folder_ / name, spec);
    ASSERT_TRUE(writer) << writer.error().message;
    for (int i = 0; i < 2; ++i) ASSERT_TRUE(writer->RecordFailure(0, i, "plan_failed", "{}"));
    for (const auto i : indices) ASSERT_TRUE(writer->Commit(MakeSyntheticEpisode(spec, i, 10)));
    ASSERT_TRUE(writer->WriteMaster());
  }
  void WriteCheckpoint(const std::string& name, const std::map<std::string, std::string>& metadata) {
    store::Safetensors content;
    content.metadata = metadata;
    content.tensors["TAR3D.register"] = {store::DType::kF32, {2, 3}, std::vector<std::uint8_t>(24)};
    content.tensors["step"] = {store::DType::kI64, {}, std::vector<std::uint8_t>(8)};
    ASSERT_TRUE(store::WriteSafetensors(folder_ / name, content));
  }

  TemporaryFolder folder_;
};

}  // namespace etude
