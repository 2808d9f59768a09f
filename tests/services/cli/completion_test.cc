// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/completion.cc and all_commands.cc: through the real bash, with the programs that are built.
#include "services/cli/completion.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sstream>
#include <vector>

#include "services/cli/all_commands.h"
#include "tests/support/etude_command.h"
#include "tests/support/run_command.h"
#include "tests/support/temporary_folder.h"

namespace etude::cli {
namespace completion_test {

using testing::Contains;
using testing::ElementsAre;
using testing::IsEmpty;
using testing::IsSupersetOf;
using testing::Not;

// What bash offers after `words`; the last one is being typed.
class Completion : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    const std::string etude = (ProgramsFolder() / "etude").string();
    ASSERT_EQ(RunInShell(etude + " completion bash > " + Script()).code, 0);
  }
  static void TearDownTestSuite() { delete folder_; }
  static std::string Script() { return (*folder_ / "etude.bash").string(); }

  std::vector<std::string> Offered(const std::string& words) {
    const auto output = RunInShell("bash --norc -uc 'source " + Script() + "; COMP_WORDS=(etude " + words +
                                   "); COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); _etude; printf \"%s\\n\" " +
                                   "\"${COMPREPLY[@]:-}\"' 2>&1");
    EXPECT_EQ(output.code, 0) << output.text;
    std::vector<std::string> offered;
    std::istringstream lines(output.text);
    for (std::string line; std::getline(lines, line);)
      if (!line.empty()) offered.push_back(line);
    return offered;
  }

 private:
  static inline TemporaryFolder* folder_ = nullptr;
};

TEST_F(Completion, OffersCommands) {
  EXPECT_THAT(Offered("data"), ElementsAre("dataset"));
  EXPECT_THAT(Offered("\"\""), IsSupersetOf({"collect", "train", "dataset", "doctor"}));
  EXPECT_THAT(Offered("dataset ex"), ElementsAre("export"));
}

TEST_F(Completion, AsksProgramsOfTheirOwn) {
  EXPECT_THAT(Offered("train --fr"), ElementsAre("--fresh", "--freeze"));
  EXPECT_THAT(Offered("robot ch"), ElementsAre("check"));
  EXPECT_THAT(Offered("scene render --seg"), ElementsAre("--segmentation"));
  EXPECT_THAT(Offered("worker r"), Not(Contains("robot"))) << "it is a command of its own";
}

TEST_F(Completion, OffersWhatAnOptionMayBe) {
  EXPECT_THAT(Offered("dataset export data out --format r"), ElementsAre("robomimic"));
  EXPECT_THAT(Offered("config describe \"\""), IsSupersetOf({"campaign", "robot"}));
  EXPECT_THAT(Offered("checkpoint watch --channel \"\""), ElementsAre("latest", "best"));
}

TEST_F(Completion, LeavesFilesToTheShell) {
  EXPECT_THAT(Offered("train --data run"), IsEmpty());
  EXPECT_THAT(Offered("dataset info run"), IsEmpty());
}

TEST_F(Completion, AValueIsNoCommand) {
  EXPECT_THAT(Offered("train --out collect --fr"), ElementsAre("--fresh", "--freeze"));
}

TEST_F(Completion, ZshTakesItsScriptWhereItIsThere) {
  const std::string file = Script() + ".zsh", etude = (ProgramsFolder() / "etude").string();
  ASSERT_EQ(RunInShell(etude + " completion zsh > " + file).code, 0);
  const auto output = RunInShell("zsh -n " + file + " 2>&1");
  if (output.code == 127) GTEST_SKIP() << "no zsh here";
  EXPECT_EQ(output.code, 0) << output.text;
}

}  // namespace completion_test
}  // namespace etude::cli
