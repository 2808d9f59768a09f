// SPDX-License-Identifier: Apache-2.0
// deploy/install, deploy/quickstart, deploy/slurm/etude.sbatch and deploy/container/build as they are, with stand-ins
// for the programs that they call.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "services/core/clock.h"
#include "services/core/file.h"
#include "tests/support/matchers.h"
#include "tests/support/run_command.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/write_program.h"

namespace etude {
namespace scripts_test {

using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::Not;

class Scripts : public ::testing::Test {
 protected:
  void StandIn(const std::string& program, const std::string& script) {
    WriteProgram(folder_ / program, "#!/bin/bash\n" + script + "\n");
  }
  // `words` in a shell that finds the stand-ins of `bin` first
  auto Run(const std::string& words) { return RunInShell("export PATH=" + In("bin") + ":$PATH; " + words + " 2>&1"); }
  std::string In(const std::string& name) const { return (folder_ / name).string(); }

  const TemporaryFolder folder_;
};

class InstallScript : public Scripts {
 protected:
  // all packages are there, but for `but`, which has `state`
  void Packages(const std::string& but, const std::string& state) {
    StandIn("bin/dpkg-query", "for package; do :; done\nif [[ $package == " + but + " ]]; then echo -n '" + state +
                                  "'; else echo -n 'ii '; fi");
  }
};

TEST_F(InstallScript, SaysWhatIsMissing) {
  Packages("cmake", "un ");
  const auto asked = Run("deploy/install --check");
  EXPECT_EQ(asked.code, 3);
  EXPECT_THAT(asked.text, HasSubstr("missing: cmake"));
  Packages("cmake", "hi ");
  EXPECT_EQ(Run("deploy/install --check").code, 0) << "held, and there";
}

// it took the first argument alone, and said that all was there
TEST_F(InstallScript, TakesItsArgumentsInAnyOrder) {
  Packages("chromium", "un ");
  for (const char* words : {"--check --browser", "--browser --check", "--browser --dev --check"}) {
    const auto asked = Run(std::string("deploy/install ") + words);
    EXPECT_EQ(asked.code, 3) << words;
    EXPECT_THAT(asked.text, HasSubstr("missing: chromium")) << words;
  }
  EXPECT_EQ(Run("deploy/install --check").code, 0);
  EXPECT_EQ(Run("deploy/install --check --nonsense").code, 2);
  EXPECT_THAT(Run("deploy/install --help").text, HasSubstr("--check"));
}

// A tree whose programs are stand-ins: `etude` says how it is called.
class QuickstartScript : public Scripts {
 protected:
  void SetUp() override {
    ASSERT_THAT(MakeFolders(folder_ / "a tree/deploy"), IsOk());
    std::filesystem::copy_file("deploy/quickstart", folder_ / "a tree/deploy/quickstart");
    StandIn("a tree/deploy/install", "");
    StandIn("bin/cmake", "");
    StandIn("a tree/build/bin/etude", "printf '<%s>' \"$@\"");
    ASSERT_THAT(MakeFolders(folder_ / "lab"), IsOk());
  }
  std::string Say(const std::string& words) {
    const auto said = Run("cd '" + In("lab") + "' && '" + In("a tree/deploy/quickstart") + "' " + words);
    EXPECT_EQ(said.code, 0) << said.text;
    return said.text;
  }
};

TEST_F(QuickstartScript, PathsAreThoseOfWhoCallsIt) {
  EXPECT_THAT(Say("--minutes 3"), HasSubstr("<--out><" + In("a tree/out/quickstart") + "><--minutes><3>"));
  EXPECT_THAT(Say("--out out/quickstart"), HasSubstr("<--out><" + In("lab/out/quickstart") + ">"));
  EXPECT_THAT(
      Say("--out=/data/x --security keys/me --profile=star.xml --no-dashboard"),
      EndsWith("<--security><" + In("lab/keys/me") + "><--profile><" + In("lab/star.xml") + "><--no-dashboard>"));
}

// the minutes are what the build leaves, and a second build takes none: a training that was finished went on
TEST_F(QuickstartScript, ATrainingThatHasBegunKeepsItsMinutes) {
  ASSERT_THAT(WriteFileAtomically(folder_ / "lab/mine/up.yaml",
                                  std::string_view("campaign: x\ntrain:\n  config: compact\n  minutes: 7.5\n")),
              IsOk());
  EXPECT_THAT(Say("--out mine"), Not(HasSubstr("<7.5>"))) << "nothing was trained yet";
  ASSERT_THAT(WriteFileAtomically(folder_ / "lab/mine/run/first/training_state.safetensors", std::string_view("x")),
              IsOk());
  EXPECT_THAT(Say("--out mine"), HasSubstr("<--minutes><7.5>"));
  EXPECT_THAT(Say("--out mine --minutes 9"), HasSubstr("<--minutes><9>"));
}

// A job of one node whose programs are stand-ins.
class SlurmScript : public Scripts {
 protected:
  void SetUp() override {
    StandIn("bin/scontrol", "echo node1");
    StandIn("bin/etude", "");
    StandIn("bin/etude-collector", "trap 'exit 0' TERM; echo collector \"$@\"; while :; do sleep 0.05; done");
    StandIn("bin/srun", "echo workers \"$@\"; exit 2");
    ASSERT_THAT(WriteFileAtomically(folder_ / "spec.yaml", std::string_view("name: \"mine\"  # ours\nepisodes: 3\n")),
                IsOk());
  }
  auto Submit(const std::string& more, const std::string& by = "", const std::string& id = "7") {
    return Run("cd '" + folder_.path().string() + "' && ETUDE_BIN= SLURM_JOB_ID=" + id +
               " SLURM_JOB_NODELIST=node1 ETUDE_WITHOUT_WORKERS_S=1 " + by + " bash " +
               std::filesystem::absolute("deploy/slurm/etude.sbatch").string() + " " + more);
  }
};

// nodes without the program, or without GL, were kept until the end of their time
TEST_F(SlurmScript, WithoutWorkersTheNodesAreGivenBack) {
  const auto job = Submit("spec.yaml data");
  EXPECT_EQ(job.code, 1) << job.text;
  EXPECT_THAT(job.text, HasSubstr("all workers have ended"));
}

TEST_F(SlurmScript, ACompleteCampaignEndsWell) {
  StandIn("bin/etude-collector", "sleep 0.2");
  StandIn("bin/srun", "exit 0");
  const auto job = Submit("spec.yaml data");
  EXPECT_EQ(job.code, 0) << job.text;
  EXPECT_THAT(job.text, Not(HasSubstr("all workers have ended")));
}

// what waits for it with --dependency=afterok began on a part
TEST_F(SlurmScript, AJobWhoseTimeRanOutHasNotSucceeded) {
  StandIn("bin/srun", "trap 'exit 0' TERM; while :; do sleep 0.05; done");
  EXPECT_NE(Submit("spec.yaml data", "timeout --preserve-status --signal TERM 2").code, 0);
}

TEST_F(SlurmScript, TheCollectorsErrorIsTheJobs) {
  StandIn("bin/etude-collector", "exit 3");
  StandIn("bin/srun", "trap 'exit 0' TERM; while :; do sleep 0.05; done");
  EXPECT_EQ(Submit("spec.yaml data").code, 3);
}

// workers waited for a campaign that nobody has
TEST_F(SlurmScript, WorkersJoinTheCampaignAsItIsCalled) {
  EXPECT_THAT(Submit("spec.yaml data").text, HasSubstr("--campaign mine --domain 8"));
  EXPECT_THAT(Submit("spec.yaml data --set name=other").text, HasSubstr("--campaign other --domain 8"));
}

// domains from 102 on have ports that the system gives away itself, and 0 is everybody's
TEST_F(SlurmScript, AJobHasADomainOfItsOwn) {
  EXPECT_THAT(Submit("spec.yaml data", "", "199").text, HasSubstr("--domain 100 "));
  EXPECT_THAT(Submit("spec.yaml data", "", "200").text, HasSubstr("--domain 1 "));
}

// the collector alone was secured, and workers in clear waited for it to the end of the job's time
TEST_F(SlurmScript, WhatWouldBeTheCollectorsAloneIsRefused) {
  for (const char* alone : {"--security fleet/collector", "--profile=lan.xml", "--domain 3"}) {
    const auto job = Submit(std::string("spec.yaml data ") + alone);
    EXPECT_EQ(job.code, 2) << job.text;
    EXPECT_THAT(job.text, HasSubstr("ETUDE_SECURITY"));
  }
}

TEST_F(SlurmScript, SaysHowItIsCalled) {
  EXPECT_EQ(Submit("--help").code, 0);
  const auto half = Submit("spec.yaml");
  EXPECT_EQ(half.code, 2);
  EXPECT_THAT(half.text, HasSubstr("sbatch --nodes 8"));
}

// of a tarball, or of another user's checkout, git lists nothing, and all of nothing had run well
TEST_F(Scripts, WithoutPagesTheDocumentationIsNotFine) {
  EXPECT_EQ(Run("GIT_DIR=/nonexistent tests/docs/run --list").code, 3);
}

// two of them took each other's workers and campaigns
TEST_F(Scripts, OneSuiteAtATimeOnAMachine) {
  if (RunInShell("flock -n -E 75 /proc/self/ns/net true; code=$?; [ $code = 0 ] || [ $code = 75 ]").code != 0)
    GTEST_SKIP() << "a network namespace cannot be locked here";
  ASSERT_THAT(MakeFolders(folder_ / "tree/tests"), IsOk());
  for (const char* script : {"tests/run", "tests/alone"}) std::filesystem::copy_file(script, folder_ / "tree" / script);
  StandIn("tree/deploy/install", "echo begun; exit 7");
  // held by the suite that this is of, or by this shell
  const auto waits =
      Run("exec 9</proc/self/ns/net; flock -n 9; cd '" + In("tree") + "' && ETUDE_SUITE= timeout 2 tests/run unit");
  EXPECT_EQ(waits.code, 124);
  EXPECT_THAT(waits.text, HasSubstr("waits for another suite"));
  EXPECT_THAT(waits.text, Not(HasSubstr("begun")));
  EXPECT_EQ(Run("cd '" + In("tree") + "' && ETUDE_SUITE=1 tests/run unit").code, 7);
}

// Who makes the image is a stand-in, and says how it is called.
class ContainerScript : public Scripts {
 protected:
  void SetUp() override {
    StandIn("bin/dpkg-deb", "echo 0.1.0");
    ASSERT_THAT(WriteFileAtomically(folder_ / "x.deb", std::string_view("x")), IsOk());
  }
  auto Build(const std::string& settings) { return Run(settings + " deploy/container/build " + In("x.deb")); }
};

// an empty one stayed, and was what the image of the next try was made of
TEST_F(ContainerScript, ABaseThatFailedIsNotKept) {
  StandIn("bin/podman", "echo podman \"$@\"");
  StandIn("bin/mmdebstrap", "for last; do :; done; : >\"$last\"; exit 1");
  EXPECT_EQ(Build("ETUDE_BASE_TAR=" + In("base.tar")).code, 1);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "base.tar"));
  StandIn("bin/mmdebstrap", "for last; do :; done; echo whole >\"$last\"");
  const auto made = Build("ETUDE_BASE_TAR=" + In("base.tar"));
  EXPECT_EQ(made.code, 0) << made.text;
  EXPECT_THAT(made.text, EndsWith("etude:0.1.0\n"));
  EXPECT_EQ(ReadTextFile(folder_ / "base.tar").value_or(""), "whole\n");
}

// its `oci` gave an ordinary user no network, and so no packages
TEST_F(ContainerScript, HowBuildahIsolatesIsItsOwnChoice) {
  StandIn("bin/buildah", "echo buildah \"$@\"");
  StandIn("bin/mmdebstrap", "for last; do :; done; echo whole >\"$last\"");
  for (const char* tool : {"bash", "dirname", "mktemp", "cp", "mv", "rm"})
    std::filesystem::create_symlink(std::string("/usr/bin/") + tool, folder_ / "bin" / tool);
  // no podman, wherever the system has one
  const auto made = RunInShell("PATH=" + In("bin") + " deploy/container/build " + In("x.deb") + " 2>&1");
  EXPECT_EQ(made.code, 0) << made.text;
  EXPECT_THAT(made.text, HasSubstr("buildah build --tag etude:0.1.0"));
  EXPECT_THAT(made.text, Not(HasSubstr("--isolation")));
}

}  // namespace scripts_test
}  // namespace etude
