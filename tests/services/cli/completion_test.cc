// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/completion.cc and all_commands.cc: through the real bash and zsh, with the programs that are
// built.
#include "services/cli/completion.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sstream>
#include <vector>

#include "services/cli/all_commands.h"
#include "services/core/file.h"
#include "tests/support/etude_command.h"
#include "tests/support/matchers.h"
#include "tests/support/run_command.h"
#include "tests/support/temporary_folder.h"

namespace etude::cli {
namespace completion_test {

using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::IsSupersetOf;
using testing::Not;
using testing::StartsWith;

std::vector<std::string> LinesOf(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);)
    if (!line.empty()) lines.push_back(line);
  return lines;
}

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
    return LinesOf(output.text);
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

// What zsh offers after `words`, as "word:description"; its completion system, which would draw them, is played by
// functions that print. The script is where zsh looks for it, as a user has it, and `words` are completed by the
// first TAB of a shell.
class ZshCompletes : public testing::Test {
 protected:
  void SetUp() override {
    if (RunInShell("zsh --version >/dev/null 2>&1").code == 127) GTEST_SKIP() << "no zsh here: deploy/install";
    ASSERT_EQ(
        RunInShell((ProgramsFolder() / "etude").string() + " completion zsh > " + (folder_ / "_etude").string()).code,
        0);
  }
  std::vector<std::string> Offered(const std::string& words) {
    const std::string script = "fpath=(" + folder_.path().string() +
                               " $fpath)\nautoload -U _etude\n_describe() { print -rl -- \"${(P@)2}\" }\n"
                               "_files() { print -r -- FILES }\nwords=(etude " +
                               words + ")\nCURRENT=$#words\n_etude\n";
    EXPECT_THAT(WriteFileAtomically(folder_ / "complete", script), IsOk());
    const auto output = RunInShell("zsh -f " + (folder_ / "complete").string() + " 2>&1");
    EXPECT_EQ(output.code, 0) << output.text;
    return LinesOf(output.text);
  }

  TemporaryFolder folder_;
};

TEST_F(ZshCompletes, AtTheFirstTabAndSaysWhatWordsMean) {
  EXPECT_THAT(Offered("\"\""), IsSupersetOf({HasSubstr("doctor:"), HasSubstr("train:")}));
  EXPECT_THAT(Offered("comp"), Contains("completion:a script that completes commands, options and values after TAB"));
  EXPECT_THAT(Offered("dataset export data out --"), Contains(StartsWith("--format:")));
}

TEST_F(ZshCompletes, ValuesAndElseFiles) {
  EXPECT_THAT(Offered("dataset export data out --format \"\""), IsSupersetOf({"lerobot", "robomimic"}));
  EXPECT_THAT(Offered("train --data \"\""), ElementsAre("FILES"));
  EXPECT_THAT(Offered("train --out collect --fr"), Contains(StartsWith("--fresh:"))) << "a value is no command";
}

}  // namespace completion_test
}  // namespace etude::cli
