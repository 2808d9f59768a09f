// SPDX-License-Identifier: Apache-2.0
// Disks that are full, fail, lose power or flip bits, and clocks that jump, under a real collector.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <sstream>
#include <thread>
#include <vector>

#include "services/bus/blob_transfer.h"
#include "services/bus/participant.h"
#include "services/core/clock.h"
#include "services/core/identity.h"
#include "services/core/rng.h"
#include "services/store/dataset.h"
#include "tests/faults/campaign_run.h"
#include "tests/faults/disk_model.h"
#include "tests/support/small_disk.h"
#include "tests/support/wait_until.h"

namespace etude::faults {
namespace disk_faults_test {

using namespace std::chrono_literals;

Environment With(Environment environment, const std::string& name, const std::string& value) {
  environment[name] = value;
  return environment;
}

TEST(Faults, F10ADiskThatIsFullIsWaitedFor) {
  // slow, so that the disk is full before all of them are there
  CampaignRun run({.name = "f10", .domain = 93, .episodes = 24, .ms_per_attempt = 60});
  const SmallDisk disk(run.dataset(), "16m");
  if (!disk.mounted()) GTEST_SKIP() << "F10 on a small tmpfs needs root";
  const Path ballast = run.dataset() / ".lock-ballast";
  run.StartCollector();
  run.StartWorker();
  run.WaitForCommitted(4);
  {
    std::ofstream file(ballast, std::ios::binary);
    const std::string block(4096, 'x');
    while (file.write(block.data(), static_cast<std::streamsize>(block.size())).flush()) {
    }
  }
  EXPECT_TRUE(WaitUntil([&] { return run.Logs().find("committing waits") != std::string::npos; }, 30s)) << run.Logs();
  const auto full = run.Committed();
  EXPECT_LT(full, run.spec().episodes);
  EXPECT_TRUE(run.Scan().clean()) << run.Scan().Text();
  EXPECT_TRUE(run.collector().running());
  std::filesystem::remove(ballast);
  ReportRow("F10", fmt::format("disk full after {} episodes, until space came back", full), run.Finish());
}

TEST(Faults, F10CallsThatFailAreNoAcknowledgement) {
  Counts sum;
  int runs = 0;
  for (const char* fault :
       {"write:ENOSPC:15:4", "write:EIO:20:3", "fsync:EIO:20:3", "fsync:EIO:25:1", "rename:EIO:7:2"}) {
    SCOPED_TRACE(fault);
    CampaignRun run({.name = "f10b", .domain = 93, .episodes = 16});
    run.StartCollector(With(Shim(run.dataset()), "ETUDE_SHIM_FAIL", fault));
    run.StartWorker();
    sum += run.Finish();
    EXPECT_NE(run.Logs().find("it is tried again"), std::string::npos) << "the fault was not met" << run.Logs();
    ++runs;
  }
  ReportRow("F10", fmt::format("write, fsync, rename return ENOSPC or EIO, {} patterns", runs), sum);
}

// Offers of 256 MB from 32 senders while nothing can be written: `max_memory`, beside what DDS has under way.
double MostResidentMb(const CampaignRun& run, pid_t collector, std::uint32_t domain) {
  auto participant = bus::Participant::Open({domain, ""});
  const auto id = ReadIdentity(run.dataset());
  EXPECT_TRUE(participant && id);
  if (!participant || !id) return 0;
  std::vector<std::uint8_t> bytes(8u << 20);
  Rng rng(10);
  for (auto& byte : bytes) byte = static_cast<std::uint8_t>(rng.Next());
  std::vector<bus::BlobSender> senders;
  for (int i = 0; i < 32; ++i) {
    auto sender = bus::BlobSender::Open(*participant, {run.spec().name, id->id}, "episode", fmt::format("crowd-{}", i));
    EXPECT_TRUE(sender);
    if (sender) senders.push_back(std::move(*sender));
  }
  std::vector<std::jthread> sending;
  for (auto& sender : senders)
    sending.emplace_back([&] { (void)sender.Send(1, bytes, 0, "{}", 12s); });  // nobody answers
  double most = 0;
  for (const Stopwatch watch; watch.Seconds() < 12;) {
    most = std::max(most, ResidentMb(collector));
    std::this_thread::sleep_for(50ms);
  }
  return most;
}

// before, it ended, and a service that ended so five times stays down
TEST(Faults, F10ACollectorThatIsStartedOnAFullDiskWaits) {
  CampaignRun run({.name = "f10d", .domain = 93, .episodes = 12, .ms_per_attempt = 60});
  run.StartCollector();
  run.StartWorker();
  run.WaitForCommitted(3);
  run.StartCollector(With(Shim(run.dataset()), "ETUDE_SHIM_FAIL", "write:ENOSPC:1:4"));
  ReportRow("F10", "collector started again on a disk that is full for seconds", run.Finish());
  EXPECT_NE(run.Logs().find("the disk took the collector's epoch"), std::string::npos) << run.Logs();
}

TEST(Faults, F10AFullDiskCostsNoMoreMemoryThanIsStated) {
  constexpr std::uint32_t kDomain = 93;
  constexpr double kMaxMemoryMb = 16, kUnderWayMb = 80;
  CampaignRun run({.name = "f10c",
                   .domain = kDomain,
                   .episodes = 200,
                   .collector_flags = {"--max-memory", fmt::format("{:.0f}", kMaxMemoryMb)}});
  run.StartCollector(With(Shim(run.dataset()), "ETUDE_SHIM_FAIL", "write:ENOSPC:15:100000000"));
  // more than there are threads that commit: all of them wait for the disk
  for (int i = 0; i < 8; ++i) run.StartWorker();
  ASSERT_TRUE(WaitUntil([&] { return run.Logs().find("committing waits") != std::string::npos; }, 30s)) << run.Logs();
  const double before = ResidentMb(run.collector().pid());
  ASSERT_GT(before, 0);
  const double most = MostResidentMb(run, run.collector().pid(), kDomain);
  EXPECT_LE(most - before, kMaxMemoryMb + kUnderWayMb) << "of 256 MB that were offered";
  EXPECT_TRUE(run.collector().running());
  ReportAsserted("F10", fmt::format("nothing can be written, 40 senders offer 256 MB to a collector of --max-memory "
                                    "{:.0f}: it took {:.0f} MB more",
                                    kMaxMemoryMb, most - before));
}

TEST(Faults, F13ClocksThatJump) {
  CampaignRun run({.name = "f13", .domain = 94, .episodes = 40, .ms_per_attempt = 20});
  const auto set = [&](double seconds) {
    std::fstream file(run.folder() / "clock", std::ios::binary | std::ios::in | std::ios::out);
    file.write(reinterpret_cast<const char*>(&seconds), sizeof seconds);
  };
  ASSERT_TRUE(WriteFileAtomically(run.folder() / "clock", std::string(sizeof(double), '\0')));
  const auto environment = With(Shim("/nowhere"), "ETUDE_SHIM_CLOCK", (run.folder() / "clock").string());
  run.StartCollector(environment);
  run.StartWorker(environment);
  run.StartWorker();
  std::uint64_t committed = 0;
  for (const double seconds : {3600.0, -3600.0, 86400.0, -1e8}) {
    run.WaitForCommitted(committed += 8);
    set(seconds);
  }
  const Counts counts = run.Finish();
  ReportRow("F13", "wall clock of collector and one worker jumps 4 times by hours to years", counts);
}

// k random bytes of k files: each is found, and nothing else is touched.
TEST(Faults, F15BitsThatFlipAreFound) {
  CampaignRun run({.name = "f15", .domain = 94, .episodes = 30});
  run.StartCollector();
  for (int i = 0; i < 2; ++i) run.StartWorker();
  Counts counts = run.Finish();
  Rng rng(15);
  int found = 0;
  constexpr int kFlips = 150;
  for (int flip = 0; flip < kFlips; ++flip) {
    const Path file = store::EpisodePath(run.dataset(), rng.Below(run.spec().episodes));
    const auto bytes = ReadBinaryFile(file);
    ASSERT_TRUE(bytes) << bytes.error().message;
    auto flipped = *bytes;
    flipped[rng.Below(flipped.size())] ^= static_cast<std::uint8_t>(1u << rng.Below(8));
    ASSERT_TRUE(WriteFileAtomically(file, flipped));
    const auto report = store::Verify(run.dataset(), store::Quarantine::kNo);
    ASSERT_TRUE(report) << report.error().message;
    found += report->bad.size() == 1 && report->bad[0].path == file && report->good == run.spec().episodes - 1;
    if (flip == kFlips - 1) break;  // the last one is set aside
    ASSERT_TRUE(WriteFileAtomically(file, *bytes));
  }
  EXPECT_EQ(found, kFlips);
  ASSERT_TRUE(store::Verify(run.dataset(), store::Quarantine::kYes));
  EXPECT_EQ(run.Committed(), run.spec().episodes - 1) << "the others stay";
  run.StartCollector();
  run.StartWorker();
  counts = run.Finish();
  EXPECT_EQ(counts.duplicated, 1u) << "the one set aside was acknowledged before, and again";
  counts.duplicated = 0;
  ReportRow("F15", fmt::format("{} of {} flipped bits found; the one set aside was made again", found, kFlips), counts);
}

// What was answered up to here, by the collector's own word just before it says so.
std::vector<Ack> AnsweredIn(const std::string& log) {
  std::vector<Ack> acks;
  std::istringstream lines(log);
  std::string name;
  for (std::uint64_t index = 0; lines >> name >> index;)
    if (name == "collector.before_ack") acks.push_back({.index = index});
  return acks;
}

// The dataset that power loss leaves opens and verifies without a person's help.
void ExpectOpens(const Files& files, const CampaignSpec& spec, std::size_t prefix) {
  const TemporaryFolder folder;
  bool any = false;
  for (const auto& [name, bytes] : files) {
    if (!name.starts_with("data/")) continue;
    ASSERT_TRUE(WriteFileAtomically(folder / name, bytes));
    any = true;
  }
  if (!any) return;
  const auto writer = store::DatasetWriter::Open(folder / "data", spec);
  ASSERT_TRUE(writer) << "after " << prefix << " operations: " << writer.error().message;
  const auto report = store::Verify(folder / "data", store::Quarantine::kNo);
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_TRUE(report->bad.empty()) << "after " << prefix << " operations: " << report->bad[0].reason;
}

TEST(Faults, F16EveryPrefixOfWhatACollectorWritesHoldsItsPromises) {
  CampaignRun run({.name = "f16", .domain = 95, .episodes = 12});
  auto environment = With(Shim(run.folder()), "ETUDE_SHIM_TRACE", (run.folder() / "trace").string());
  environment["ETUDE_CRASH_LOG"] = (run.folder() / "points").string();
  run.StartCollector(environment);
  for (int i = 0; i < 2; ++i) run.StartWorker();  // episodes that are committed at the same time
  run.Finish();

  const auto trace = ReadTrace(run.folder() / "trace");
  ASSERT_GT(trace.size(), 100u) << "the shim recorded nothing";
  DiskModel disk;
  Scanner scanner;
  Rng rng(16);
  Counts sum, last;
  std::uint64_t states = 0;
  for (std::size_t n = 0; n < trace.size(); ++n) {
    disk.Apply(trace[n]);
    if (trace[n].kind == 'W' && trace[n].path.ends_with(".log")) continue;
    if (trace[n].kind == 's' || trace[n].kind == 'd') continue;  // nothing is safe by it yet
    const auto acks = AnsweredIn(disk.TextOf("points"));
    for (const Survives survives : {Survives::kNothing, Survives::kNames, Survives::kSome, Survives::kAll}) {
      const Files files = disk.AfterLoss(survives, rng);
      last = scanner.Scan(files, acks);
      ASSERT_TRUE(last.clean()) << "after " << n << " of " << trace.size() << " operations: " << last.Text();
      sum += last;
      ++states;
      if (states % 29 == 0) ExpectOpens(files, run.spec(), n);
    }
  }
  EXPECT_EQ(last.acknowledged, run.spec().episodes);
  EXPECT_EQ(last.files, run.spec().episodes);
  Counts counts = sum;
  counts.acknowledged = last.acknowledged;
  counts.files = last.files;
  ReportRow("F16", fmt::format("power lost after each of {} operations, {} states of the disk", trace.size(), states),
            counts);
}

// The model itself: a program that answers before it syncs is caught.
TEST(Faults, F16TheModelSeesAnAnswerThatCameTooEarly) {
  const auto write = [](const std::string& path, std::uint64_t inode, const std::string& text) {
    return DiskOperation{'W', inode, 0, path, {text.begin(), text.end()}};
  };
  DiskModel disk;
  for (const auto& operation :
       {DiskOperation{'M', 0, 0, "data", {}}, DiskOperation{'d', 1, 7, "", {}}, DiskOperation{'D', 1, 7, "", {}},
        DiskOperation{'C', 2, 1, "data/a.tmp", {}}, write("data/a.tmp", 2, "whole"),
        DiskOperation{'R', 0, 0, "data/a.hdf5", {'d', 'a', 't', 'a', '/', 'a', '.', 't', 'm', 'p'}}})
    disk.Apply(operation);
  Rng rng(1);
  EXPECT_TRUE(disk.AfterLoss(Survives::kNothing, rng).empty());
  EXPECT_TRUE(disk.AfterLoss(Survives::kNames, rng).at("data/a.hdf5").empty()) << "its name overtook its bytes";
  EXPECT_EQ(disk.AfterLoss(Survives::kAll, rng).at("data/a.hdf5").size(), 5u);
  disk.Apply({'s', 2, 7, "data/a.hdf5", {}});
  disk.Apply({'S', 2, 7, "data/a.hdf5", {}});
  EXPECT_TRUE(disk.AfterLoss(Survives::kNothing, rng).empty()) << "its folder was not synced";
  disk.Apply({'d', 3, 7, "data", {}});
  disk.Apply({'D', 3, 7, "data", {}});
  EXPECT_EQ(disk.AfterLoss(Survives::kNothing, rng).at("data/a.hdf5").size(), 5u);
}

// What another thread does while a sync is under way is not covered by it.
TEST(Faults, F16TheModelTakesOnlyWhatWasThereWhenASyncBegan) {
  const auto text = [](const std::string& from) { return std::vector<std::uint8_t>(from.begin(), from.end()); };
  DiskModel disk;
  Rng rng(1);
  const auto left = [&] { return disk.AfterLoss(Survives::kNothing, rng); };
  disk.Apply({'C', 2, 1, "a.tmp", {}});
  disk.Apply({'W', 2, 0, "a.tmp", text("early")});
  disk.Apply({'s', 2, 7, "a.tmp", {}});
  disk.Apply({'W', 2, 5, "a.tmp", text("late")});
  disk.Apply({'S', 2, 7, "a.tmp", {}});
  disk.Apply({'d', 1, 7, "", {}});
  disk.Apply({'R', 0, 0, "a.hdf5", text("a.tmp")});
  disk.Apply({'d', 1, 8, "", {}});
  disk.Apply({'D', 1, 8, "", {}});
  ASSERT_TRUE(left().contains("a.hdf5"));
  EXPECT_EQ(left().at("a.hdf5"), text("early"));
  disk.Apply({'D', 1, 7, "", {}});
  EXPECT_TRUE(left().contains("a.hdf5")) << "a call that began earlier takes nothing back";
  disk.Apply({'R', 0, 0, "b.hdf5", text("a.hdf5")});
  disk.Apply({'D', 1, 7, "", {}});
  EXPECT_FALSE(left().contains("b.hdf5"));
  disk.Apply({'d', 1, 7, "", {}});
  disk.Apply({'R', 0, 0, "c.hdf5", text("b.hdf5")});
  disk.Apply({'D', 1, 7, "", {}});
  EXPECT_TRUE(left().contains("b.hdf5"));
  EXPECT_FALSE(left().contains("c.hdf5"));
}

}  // namespace disk_faults_test
}  // namespace etude::faults
