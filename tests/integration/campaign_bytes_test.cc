// SPDX-License-Identifier: Apache-2.0
// A campaign is a pure function of its spec: the same bytes from one real worker, from three, and from three
// that are killed at random.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <string>
#include <thread>

#include "services/campaign/collector.h"
#include "services/campaign/fingerprint.h"
#include "services/campaign/process.h"
#include "services/core/clock.h"
#include "services/core/config.h"
#include "services/core/file.h"
#include "services/core/rng.h"
#include "services/spec/episode_plan.h"
#include "services/store/dataset.h"
#include "tests/support/child_processes.h"
#include "tests/support/programs_folder.h"
#include "tests/support/temporary_folder.h"

namespace etude::campaign {
namespace campaign_bytes_test {

using namespace std::chrono_literals;

constexpr std::uint32_t kDomain = 82;

CampaignSpec OneRobot() {
  CampaignSpec spec;
  spec.name = "bytes";
  spec.episodes = 12;
  spec.image_stride = 25;
  spec.camera.width = spec.camera.height = 96;
  return spec;
}

// All robots, all tasks, objects of both kinds.
CampaignSpec Mixed() {
  CampaignSpec spec = OneRobot();
  spec.episodes = 2 * kEpisodesPerScene + 4;
  spec.image_stride = 50;
  spec.camera.width = spec.camera.height = 64;
  spec.robots = {"ur5", "panda", "jaco2"};
  spec.tasks = {
      "pick", "push+obstacle", "place_left",    "put_down",     "pick+others", "rotate",           "place_right",
      "push", "place_front",   "pick+obstacle", "place_behind", "push+others", "put_down+obstacle"};
  spec.objects = {"cube", "coke", "pepsi", "milk", "bottle", "mug_01"};
  spec.objects_per_scene = 3;
  spec.max_attempts = 4;
  return spec;
}

Path WorkerProgram() { return ProgramsFolder() / "etude-worker"; }

struct Chaos {
  int workers = 1;
  int kills = 0;
  std::uint64_t seed = 0;
  int slots = 0;  // > 0: of one host, which leases ahead, and whose children are killed instead
  std::map<std::string, std::string> environment = {};
  Path program = WorkerProgram();
};

class CampaignBytes : public testing::Test {
 protected:
  static Process StartWorker(const Path& log, const Chaos& chaos) {
    std::vector<std::string> argv{chaos.program.string(), "--campaign", "bytes", "--domain", std::to_string(kDomain)};
    argv.insert(argv.end(), {"--slots", std::to_string(chaos.slots)});
    auto process = Process::Start({argv, log, chaos.environment});
    EXPECT_TRUE(process) << (process ? "" : process.error().message);
    return std::move(*process);
  }

  // Collects the campaign; returns index -> the file's bytes.
  static std::map<std::uint64_t, std::vector<std::uint8_t>> Collect(const CampaignSpec& spec, const Path& dataset,
                                                                    const Chaos& chaos) {
    auto participant = bus::Participant::Open({kDomain, ""});
    EXPECT_TRUE(participant) << participant.error().message;
    CollectorOptions options;
    options.lease = 3s;
    auto collector = Collector::Open(*participant, spec, dataset, options);
    EXPECT_TRUE(collector) << collector.error().message;
    std::thread thread([&] { EXPECT_TRUE(collector->Run()); });
    std::vector<Process> workers;
    for (int k = 0; k < chaos.workers; ++k) workers.push_back(StartWorker(dataset / "worker.log", chaos));

    Rng rng(chaos.seed);
    const auto give_up = MonotonicClock::now() + 120s;
    int kills = 0;
    // Each kill comes with the next episode after the last one, whatever the machine's speed.
    std::uint64_t next_kill = 1;
    while (!collector->progress().complete && MonotonicClock::now() < give_up) {
      std::this_thread::sleep_for(std::chrono::milliseconds(2 + rng.Below(20)));
      if (kills == chaos.kills || collector->progress().committed < next_kill) continue;
      const std::size_t chosen = rng.Below(workers.size());
      Process& victim = workers[chosen];
      if (chaos.slots > 0) {
        const auto children = ChildrenOf(victim.pid());
        if (children.empty()) continue;
        ::kill(children[rng.Below(children.size())], SIGKILL);
      } else {
        // the others stand still meanwhile: on a busy machine they would be done before the next kill
        const auto signal_others = [&](int signal) {
          for (std::size_t k = 0; k < workers.size(); ++k)
            if (k != chosen) workers[k].Signal(signal);
        };
        signal_others(SIGSTOP);
        victim.Signal(SIGKILL);
        victim.Wait(5s);
        victim = StartWorker(dataset / "worker.log", chaos);
        signal_others(SIGCONT);
      }
      ++kills;
      next_kill = collector->progress().committed + 1;
    }
    EXPECT_TRUE(collector->progress().complete) << ReadTextFile(dataset / "worker.log").value_or("");
    if (chaos.kills > 0) {
      EXPECT_GE(kills, chaos.kills / 3) << "the campaign was over before they were killed";
    }
    collector->Stop();
    thread.join();
    return Files(spec, dataset);
  }

  // Two episodes of each kind, enough for libm and pictures to differ.
  static std::string HashWith(const std::map<std::string, std::string>& environment) {
    CampaignSpec spec = Mixed();
    spec.episodes = 6;
    TemporaryFolder folder;
    (void)Collect(spec, folder / "data", {.environment = environment});
    return store::HashDataset(folder / "data").value_or("none");
  }

  struct Made {
    std::map<std::uint64_t, std::vector<std::uint8_t>> files;
    std::string hash;
  };
  static Made OfOneWorker(const CampaignSpec& spec) {
    TemporaryFolder folder;
    auto files = Collect(spec, folder / "one", {.workers = 1});
    return {std::move(files), store::HashDataset(folder / "one").value_or("none")};
  }
  // What the tests of that campaign compare with, made once.
  static const Made& MixedOfOneWorker() {
    static const Made made = OfOneWorker(Mixed());
    return made;
  }

  // An index that was given up has no file, in none of the three.
  static void ExpectSameBytes(const CampaignSpec& spec, const Made& made, int may_be_given_up) {
    TemporaryFolder folder;
    const auto& [one, hash] = made;
    int missing = 0;
    for (const auto& [index, bytes] : one) missing += bytes.empty();
    ASSERT_LE(missing, may_be_given_up);

    const auto three = Collect(spec, folder / "three", {.workers = 3});
    EXPECT_EQ(store::HashDataset(folder / "three").value(), hash);
    EXPECT_TRUE(three == one) << "the files themselves are equal, byte for byte";

    const auto killed = Collect(spec, folder / "killed", {.workers = 3, .kills = 6, .seed = 11});
    EXPECT_EQ(store::HashDataset(folder / "killed").value(), hash);
    EXPECT_TRUE(killed == one);
  }

  static std::map<std::uint64_t, std::vector<std::uint8_t>> Files(const CampaignSpec& spec, const Path& dataset) {
    std::map<std::uint64_t, std::vector<std::uint8_t>> files;
    for (std::uint64_t i = 0; i < spec.episodes; ++i)
      files[i] = ReadBinaryFile(store::EpisodePath(dataset, i)).value_or(std::vector<std::uint8_t>{});
    return files;
  }
};

TEST_F(CampaignBytes, AreTheSameFromOneWorkerThreeAndThreeThatAreKilled) {
  ExpectSameBytes(OneRobot(), OfOneWorker(OneRobot()), 0);
}

TEST_F(CampaignBytes, AreTheSameWithAllRobotsAndTasksMixed) { ExpectSameBytes(Mixed(), MixedOfOneWorker(), 2); }

TEST_F(CampaignBytes, AreTheSameFromAHostOfThreeSlotsWhoseChildrenAreKilled) {
  const CampaignSpec spec = Mixed();
  TemporaryFolder folder;
  const auto& [singles, hash] = MixedOfOneWorker();

  const auto host = Collect(spec, folder / "host", {.slots = 3});
  EXPECT_EQ(store::HashDataset(folder / "host").value(), hash);
  EXPECT_TRUE(host == singles) << "the files themselves are equal, byte for byte";

  const auto killed = Collect(spec, folder / "killed", {.kills = 6, .seed = 5, .slots = 3});
  EXPECT_EQ(store::HashDataset(folder / "killed").value(), hash);
  EXPECT_TRUE(killed == singles);
}

// ETUDE_OTHER_BUILD: a build folder, of another compiler (`tests/run compilers`).
TEST_F(CampaignBytes, AreTheSameOfTwoBuilds) {
  const char* other = std::getenv("ETUDE_OTHER_BUILD");
  if (other == nullptr) GTEST_SKIP() << "ETUDE_OTHER_BUILD names the build folder of another compiler";
  CampaignSpec spec = Mixed();
  spec.objects.insert(spec.objects.end(),
                      {"apple_00", "orange_00", "lemon_00", "pear_00", "strawberry_00", "avocado_00", "hamburger_00"});
  spec.objects_per_scene = 5;
  spec.randomization.world.camera_position = 0.05;
  spec.randomization.world.table_colour = 0.2;
  spec.randomization.world.object_colour = 0.2;
  spec.randomization.world.distractors = 1;
  TemporaryFolder folder;
  const auto ours = Collect(spec, folder / "ours", {.workers = 2});
  const auto theirs = Collect(spec, folder / "theirs", {.workers = 2, .program = Path(other) / "bin" / "etude-worker"});
  EXPECT_EQ(store::HashDataset(folder / "theirs").value(), store::HashDataset(folder / "ours").value());
  EXPECT_TRUE(theirs == ours) << "the files themselves are equal, byte for byte";
}

// `etude-worker --fingerprint` with this environment.
std::map<std::string, std::string> Probe(const std::map<std::string, std::string>& environment) {
  TemporaryFolder folder;
  auto process = Process::Start({{WorkerProgram().string(), "--fingerprint", "--json"}, folder / "log", environment});
  EXPECT_TRUE(process) << (process ? "" : process.error().message);
  if (!process) return {};
  EXPECT_EQ(process->Wait(120s), 0);
  const std::string text = ReadTextFile(folder / "log").value_or("");
  const auto json = OrderedJson::parse(text.substr(std::min(text.find('{'), text.size())), nullptr, false);
  EXPECT_TRUE(json.is_object()) << text;
  if (!json.is_object()) return {};
  std::map<std::string, std::string> lines;
  for (const auto& [name, value] : json.items()) lines[name] = value.get<std::string>();
  return lines;
}

// The same in a process that pins nothing, with these masks: what another CPU would take.
std::map<std::string, std::string> UnpinnedProbe(std::map<std::string, std::string> masks) {
  masks["ETUDE_UNPINNED"] = "1";
  return Probe(masks);
}

bool HasFmaVariantsOfLibm() {
#if defined(__x86_64__)
  return __builtin_cpu_supports("fma") && __builtin_cpu_supports("avx2");
#else
  return false;
#endif
}

bool HasAvx() {
#if defined(__x86_64__)
  return __builtin_cpu_supports("avx");
#else
  return false;
#endif
}

// Whether pictures depend on AVX here, by a fingerprint: those of another renderer, as that of a GPU, do not.
bool DrawsByAvx(const std::map<std::string, std::string>& probe) {
  const auto driver = probe.find("gl");
  return HasAvx() && driver != probe.end() && driver->second.find("llvmpipe") != std::string::npos;
}

constexpr char kNothingDrawnByAvx[] = "pictures depend on AVX where llvmpipe draws them, on a CPU that has it";

// One by one, so that none of the masks below stands for nothing.
TEST(FingerprintProbe, EachMaskThatBytesCouldDependOnChangesItWhereNothingIsPinned) {
  const auto unpinned = UnpinnedProbe({});
  ASSERT_EQ(unpinned.count("libm") + unpinned.count("physics") + unpinned.count("picture"), 3u);
  if (HasFmaVariantsOfLibm()) {
    for (const char* feature : {"-FMA", "-AVX2"}) {
      const auto masked = UnpinnedProbe({{"GLIBC_TUNABLES", std::string("glibc.cpu.hwcaps=") + feature}});
      EXPECT_NE(masked.at("libm"), unpinned.at("libm")) << feature << ": libm rounds otherwise with FMA";
      EXPECT_NE(masked.at("physics"), unpinned.at("physics")) << feature << ": and so does a simulation";
      EXPECT_EQ(masked.at("picture"), unpinned.at("picture")) << feature;
    }
  }
  std::map<std::string, std::string> pictures;
  for (const char* level : {"sse2", "sse4.1", "avx"}) {
    const auto masked = UnpinnedProbe({{"GALLIUM_OVERRIDE_CPU_CAPS", level}});
    pictures[level] = masked.at("picture");
    EXPECT_EQ(masked.at("libm"), unpinned.at("libm")) << level;
  }
  if (!DrawsByAvx(unpinned)) GTEST_SKIP() << kNothingDrawnByAvx;
  EXPECT_NE(pictures.at("sse2"), pictures.at("avx"));
  EXPECT_NE(pictures.at("sse4.1"), pictures.at("avx"));
  EXPECT_NE(pictures.at("sse2"), pictures.at("sse4.1"));
}

// No function of this libm has a variant for AVX-512, and llvmpipe's threads draw a tile each: masked or not, nothing
// changes. That the number of threads is what it is asked for is shown in tests/worker/fingerprint_test.cc.
TEST(FingerprintProbe, NothingDependsOnAvx512NorOnTheNumberOfThreads) {
  const auto unpinned = UnpinnedProbe({});
  EXPECT_EQ(UnpinnedProbe({{"GLIBC_TUNABLES", "glibc.cpu.hwcaps=-AVX512F"}}), unpinned);
  for (const char* threads : {"1", "4"}) EXPECT_EQ(UnpinnedProbe({{"LP_NUM_THREADS", threads}}), unpinned) << threads;
}

// The pins forbid instructions and give none: a CPU without AVX draws otherwise, and would be refused by its picture.
TEST(FingerprintProbe, ACpuWithoutAvxIsToldFromThoseThatThePinsAreFor) {
  const auto pinned = Probe({});
  const auto without = UnpinnedProbe({{"GLIBC_TUNABLES", "glibc.cpu.hwcaps=-AVX,-AVX2,-FMA,-FMA4,-AVX512F"},
                                      {"GALLIUM_OVERRIDE_CPU_CAPS", "sse4.1"},
                                      {"LP_NATIVE_VECTOR_WIDTH", "128"}});
  const auto lines = [](const std::map<std::string, std::string>& probe) {
    return Fingerprint(probe.begin(), probe.end());
  };
  EXPECT_EQ(FirstDifference(lines(pinned), lines(without), "physics"), std::nullopt);
  if (!DrawsByAvx(pinned)) GTEST_SKIP() << kNothingDrawnByAvx;
  const auto difference = FirstDifference(lines(pinned), lines(without), "bytes");
  ASSERT_TRUE(difference);
  EXPECT_TRUE(difference->starts_with("picture")) << *difference << ": nothing else depends on AVX";
}

// Of a worker, which sets its pins over these masks: this shows that no environment makes other bytes, and not that
// another CPU agrees. What that would do is in FingerprintProbe, where nothing is pinned, and in each host's
// fingerprint.
TEST_F(CampaignBytes, DoNotDependOnTheCpu) {
  const std::string hash = HashWith({});
  const std::string libm = "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F";
  EXPECT_EQ(HashWith({{"GLIBC_TUNABLES", libm}}), hash);
  EXPECT_EQ(HashWith({{"GLIBC_TUNABLES", "glibc.cpu.hwcaps=-FMA"}}), hash);
  EXPECT_EQ(HashWith({{"GLIBC_TUNABLES", "glibc.cpu.hwcaps=-AVX2"}}), hash);
  EXPECT_EQ(HashWith({{"GALLIUM_OVERRIDE_CPU_CAPS", "sse2"}}), hash);
  EXPECT_EQ(HashWith({{"GALLIUM_OVERRIDE_CPU_CAPS", "sse4.1"}}), hash);
  EXPECT_EQ(HashWith({{"LP_NUM_THREADS", "1"}}), hash);
  EXPECT_EQ(HashWith({{"LP_NUM_THREADS", "4"}}), hash);

  const std::string unpinned = HashWith({{"ETUDE_UNPINNED", "1"}});
  if (DrawsByAvx(Probe({}))) {
    EXPECT_NE(HashWith({{"ETUDE_UNPINNED", "1"}, {"GALLIUM_OVERRIDE_CPU_CAPS", "sse2"}}), unpinned)
        << "llvmpipe draws otherwise with SSE2";
  }
  if (!HasFmaVariantsOfLibm()) GTEST_SKIP() << "this CPU has the variants of libm that the pins ask for";
  EXPECT_NE(unpinned, hash) << "libm rounds otherwise with FMA";
}

}  // namespace campaign_bytes_test
}  // namespace etude::campaign
