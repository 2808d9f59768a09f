// SPDX-License-Identifier: Apache-2.0
// The units in deploy/systemd: systemd takes them as they are, and they start programs and files that there are.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <sstream>

#include "services/core/file.h"
#include "tests/support/etude_command.h"
#include "tests/support/matchers.h"
#include "tests/support/run_command.h"
#include "tests/support/temporary_folder.h"

namespace etude {
namespace units_test {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

std::string With(std::string text, const std::string& from, const std::string& to) {
  for (std::size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size())
    text.replace(at, from.size(), to);
  return text;
}

class UnitsTest : public ::testing::Test {
 protected:
  // As an installation writes them, with the programs that were built and the settings of the source tree.
  void SetUp() override {
    for (const auto& entry : std::filesystem::directory_iterator("deploy/systemd")) {
      if (entry.path().extension() != ".in") continue;
      std::string text = ReadTextFile(entry.path()).value_or("");
      text = With(text, "@bindir@", ProgramsFolder().string());
      text = With(text, "@share@", std::filesystem::absolute("deploy").string());
      text = With(text, "@settings@", folder_.path().string());
      ASSERT_THAT(text, Not(HasSubstr("@bin"))) << entry.path();
      units_[entry.path().stem().string()] = text;
      ASSERT_THAT(WriteFileAtomically(folder_ / entry.path().stem().string(), text), IsOk());
    }
  }

  std::vector<std::string> Services() const {
    std::vector<std::string> names;
    for (const auto& [name, text] : units_)
      if (name.ends_with(".service")) names.push_back(name);
    return names;
  }

  const TemporaryFolder folder_;
  std::map<std::string, std::string> units_;
};

TEST_F(UnitsTest, SystemdTakesThem) {
  if (RunInShell("command -v systemd-analyze").code != 0) GTEST_SKIP() << "systemd-analyze is not installed";
  std::string files;
  for (const auto& [name, text] : units_)
    if (!name.ends_with(".env")) files += " '" + (folder_ / name).string() + "'";
  const auto output = RunInShell("SYSTEMD_LOG_LEVEL=warning systemd-analyze verify --man=no" + files + " 2>&1");
  EXPECT_EQ(output.code, 0) << output.text;
  EXPECT_EQ(output.text, "");
}

TEST_F(UnitsTest, AreHardened) {
  if (RunInShell("command -v systemd-analyze").code != 0) GTEST_SKIP() << "systemd-analyze is not installed";
  for (const auto& name : Services()) {
    // 10 is a service with every right; each of ours reaches the "OK" of below 3
    const auto output = RunInShell("systemd-analyze security --offline=true --threshold=30 --no-pager '" +
                                   (folder_ / name).string() + "' 2>&1");
    EXPECT_EQ(output.code, 0) << name << "\n" << output.text;
  }
}

// `--resume` beside `--init` is refused, and the service stayed down after its first restart
TEST_F(UnitsTest, HowARunBeginsIsNotSaidWhenItGoesOn) {
  std::string script = units_["etude-trainer.service"];
  const std::string begin = "ExecStart=/bin/sh -c '";
  script.erase(0, script.find(begin) + begin.size());
  script.resize(script.find("'\n"));
  script = With(With(script, "exec ", "echo "), "$$", "$");
  const std::string run = (folder_ / "run").string();
  const auto start = [&] {
    return RunInShell("ETUDE_TRAINER_RUN='" + run + "' ETUDE_TRAINER_BEGIN='--init f' ETUDE_TRAINER=--follow sh -c '" +
                      script + "'")
        .text;
  };
  EXPECT_THAT(start(), AllOf(HasSubstr("--follow --init f"), Not(HasSubstr("--resume"))));
  ASSERT_THAT(MakeFolders(run), IsOk());
  ASSERT_THAT(WriteFileAtomically(Path(run) / "training_state.safetensors", std::string_view("x")), IsOk());
  EXPECT_THAT(start(), AllOf(HasSubstr("--follow --resume"), Not(HasSubstr("--init"))));
}

TEST_F(UnitsTest, EachIsWatched) {
  EXPECT_THAT(Services(), testing::SizeIs(5));
  for (const auto& name : Services()) {
    EXPECT_THAT(units_[name], HasSubstr("\nType=notify\n")) << name;
    EXPECT_THAT(units_[name], HasSubstr("\nWatchdogSec=")) << name;
    EXPECT_THAT(units_[name], HasSubstr("\nPartOf=etude.target\n")) << name;
  }
  // it replaces a child that the kernel ended for want of memory; systemd would end all of them
  EXPECT_THAT(units_["etude-worker@.service"], HasSubstr("\nOOMPolicy=continue\n"));
}

// A variable that a unit names is set, and a file that a setting names is there.
TEST_F(UnitsTest, SettingsFit) {
  const std::string& settings = units_["etude.env"];
  for (const auto& name : Services()) {
    std::istringstream words(units_[name]);
    for (std::string word; words >> word;) {
      const auto at = word.find("$ETUDE_");
      if (at == std::string::npos) continue;
      const auto end = word.find_first_not_of("ABCDEFGHIJKLMNOPQRSTUVWXYZ_", at + 1);
      const std::string variable = word.substr(at + 1, end == std::string::npos ? end : end - at - 1);
      EXPECT_THAT(settings, HasSubstr("\n" + variable + "=")) << name;
    }
  }
  const std::string campaign = std::filesystem::absolute("deploy/campaigns/quickstart.yaml").string();
  EXPECT_THAT(settings, HasSubstr("ETUDE_COLLECTOR=" + campaign));
  EXPECT_TRUE(std::filesystem::exists(campaign));
  // a folder that is not there yet would be a wrong argument, with which nothing is tried again
  EXPECT_THAT(settings, HasSubstr("--name quickstart"));
  EXPECT_THAT(settings, HasSubstr("\nETUDE_POLICY=--subscribe quickstart "));
}

// `cmake --install` of a checkout in such a folder found nothing
TEST_F(UnitsTest, AreInstalledFromAFolderWithASpaceInItsName) {
  const std::string script = ReadTextFile(ProgramsFolder().parent_path() / "cmake_install.cmake").value_or("");
  const auto begin = script.find("set(source "), end = script.find("endif()", begin);
  ASSERT_NE(begin, std::string::npos);
  const std::string tree = std::filesystem::current_path().string(), other = (folder_ / "a tree").string();
  std::filesystem::create_directory_symlink(tree, other);
  const std::string block = With(script.substr(begin, end - begin), tree, other);
  ASSERT_THAT(block, HasSubstr("a tree"));
  ASSERT_THAT(
      WriteFileAtomically(folder_ / "install.cmake", With(block, other + "/build", (folder_ / "made").string())),
      IsOk());
  const std::string prefix = (folder_ / "a prefix").string();
  const auto output = RunInShell("env -u DESTDIR cmake '-DCMAKE_INSTALL_PREFIX=" + prefix + "' -P '" +
                                 (folder_ / "install.cmake").string() + "' 2>&1");
  ASSERT_EQ(output.code, 0) << output.text;
  for (const auto& [name, text] : units_) {
    const std::string place = name.ends_with(".env") ? "/etc/etude/" : "/lib/systemd/system/";
    EXPECT_TRUE(std::filesystem::exists(prefix + place + name)) << name << "\n" << output.text;
  }
}

// before, a host that had followed the worker's unit had none after its next start
TEST_F(UnitsTest, WhoEnablesOneIsToldOfTheTarget) {
  std::string all = ReadTextFile("deploy/systemd/README.md").value_or("");
  all += ReadTextFile("deploy/docs/tutorials/three_hosts.md").value_or("");
  for (const auto& [name, text] : units_) all += text;
  const std::string words = "systemctl enable --now ", target = "etude.target";
  int told = 0;
  for (std::size_t at = 0; (at = all.find(words, at)) != std::string::npos; at += words.size(), ++told)
    EXPECT_EQ(all.substr(at + words.size(), target.size()), target);
  EXPECT_GE(told, 5);
}

}  // namespace units_test
}  // namespace etude
