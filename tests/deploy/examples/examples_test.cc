// SPDX-License-Identifier: Apache-2.0
// Runs the examples that read: deploy/examples/read_dataset.cc, read_dataset.py, read_checkpoint.py.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <cstring>
#include <sstream>

#include "services/store/dataset.h"
#include "services/store/safetensors.h"
#include "tests/support/etude_command.h"
#include "tests/support/matchers.h"
#include "tests/support/run_command.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"

namespace etude {
namespace examples_test {

using testing::HasSubstr;

constexpr const char* kPython = "/usr/bin/python3 deploy/examples/";

// An error where it has to be there (tests/run, behind deploy/install), and is not.
bool HasH5py() {
  const auto [code, text] = RunInShell("/usr/bin/python3 -c 'import h5py, numpy' 2>&1");
  EXPECT_TRUE(code == 0 || std::getenv("ETUDE_H5PY_REQUIRED") == nullptr) << "apt-get install python3-h5py: " << text;
  return code == 0;
}

class Examples : public testing::Test {
 protected:
  void SetUp() override {
    auto writer = store::DatasetWriter::Open(data_, spec_);
    ASSERT_THAT(writer, IsOk());
    for (std::uint64_t i = 0; i < 3; ++i) ASSERT_THAT(writer->Commit(MakeSyntheticEpisode(spec_, i)), IsOk());
    ASSERT_THAT(writer->WriteMaster(), IsOk());
  }

  TemporaryFolder folder_;
  CampaignSpec spec_ = SyntheticSpec();
  Path data_ = folder_ / "data";
};

TEST_F(Examples, ReadADatasetInCpp) {
  const Path picture = folder_ / "last.ppm";
  const auto output = RunInShell((ProgramsFolder() / "example-read-dataset").string() + " " + data_.string() + " " +
                                 picture.string() + " 2>&1");

  EXPECT_EQ(output.code, 0) << output.text;
  for (std::uint64_t i = 0; i < 3; ++i) EXPECT_THAT(output.text, HasSubstr(MakeSyntheticEpisode(spec_, i).instruction));
  EXPECT_THAT(ReadTextFile(picture).value_or(""), testing::StartsWith("P6 32 32 255\n"));
  EXPECT_EQ(std::filesystem::file_size(picture), 13u + 32 * 32 * 3);
}

TEST_F(Examples, ReadADatasetInPython) {
  if (!HasH5py()) GTEST_SKIP() << "python3-h5py is not installed";
  const auto output =
      RunInShell(kPython + std::string("read_dataset.py ") + (data_ / "dataset.hdf5").string() + " 2>&1");

  EXPECT_EQ(output.code, 0) << output.text;
  EXPECT_THAT(output.text, HasSubstr("demo_2 " + MakeSyntheticEpisode(spec_, 2).instruction));
  EXPECT_THAT(output.text, HasSubstr("(32, 32, 3)"));
}

TEST_F(Examples, ReadACheckpointInPython) {
  if (!HasH5py()) GTEST_SKIP() << "python3-h5py is not installed";
  store::Safetensors content;
  content.metadata = {{"run", "demo"}};
  std::vector<std::uint8_t> bytes(24);
  const float half = 0.5F;
  for (std::size_t i = 0; i < 6; ++i) std::memcpy(&bytes[4 * i], &half, 4);
  content.tensors["TAR3D.register"] = {store::DType::kF32, {2, 3}, bytes};
  ASSERT_THAT(store::WriteSafetensors(folder_ / "c.safetensors", content), IsOk());

  const auto output =
      RunInShell(kPython + std::string("read_checkpoint.py ") + (folder_ / "c.safetensors").string() + " 2>&1");

  EXPECT_EQ(output.code, 0) << output.text;
  EXPECT_THAT(output.text, HasSubstr("run demo of 1 tensors"));
  EXPECT_THAT(output.text, HasSubstr("TAR3D.register float32 (2, 3) 0.5"));
}

TEST_F(Examples, AreAsShortAsTheySay) {
  for (const char* name : {"read_dataset.py", "read_checkpoint.py"}) {
    std::istringstream text(ReadTextFile(Path("deploy/examples") / name).value_or(""));
    int lines = 0;
    for (std::string line; std::getline(text, line);)
      lines += !line.empty() && line[0] != '#' && !line.starts_with("import") ? 1 : 0;
    EXPECT_GT(lines, 3) << name;
    EXPECT_LE(lines, 10) << name;
  }
}

}  // namespace examples_test
}  // namespace etude
