// SPDX-License-Identifier: Apache-2.0
#include "tests/faults/campaign_run.h"

#include <fmt/format.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <iterator>

#include "services/core/hash.h"
#include "services/core/share.h"
#include "services/store/dataset.h"
#include "tests/services/campaign/fake_work.h"
#include "tests/support/etude_command.h"
#include "tests/support/wait_until.h"

namespace etude::faults {

using namespace std::chrono_literals;

namespace {

// In the file that ETUDE_FAULTS_REPORT names, if it does.
void AppendRow(const std::string& row) {
  const char* report = std::getenv("ETUDE_FAULTS_REPORT");
  if (report == nullptr) return;
  auto file = LineAppender::Open(report);
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_TRUE(file->Append(row));
}

Path Or(const Path& given, const Path& own) { return given.empty() ? own : given; }

}  // namespace

void ReportRow(const std::string& fault, const std::string& what, const Counts& counts) {
  std::printf("%s %s (%s; %llu acknowledged, %llu files)\n", fault.c_str(), counts.Text().c_str(), what.c_str(),
              static_cast<unsigned long long>(counts.acknowledged), static_cast<unsigned long long>(counts.files));
  std::fflush(stdout);
  EXPECT_TRUE(counts.clean()) << fault << " " << counts.Text();
  AppendRow(fmt::format("| {} | {} | {} | {} | {} | {} | {} |", fault, what, counts.acknowledged, counts.lost,
                        counts.duplicated, counts.partial, counts.mismatched));
}

void ReportAsserted(const std::string& fault, const std::string& what) {
  if (testing::Test::HasFailure()) return;
  std::printf("%s %s\n", fault.c_str(), what.c_str());
  std::fflush(stdout);
  AppendRow(fmt::format("| {} | {} | – | – | – | – | – |", fault, what));
}

double ResidentMb(pid_t pid) {
  std::ifstream file(fmt::format("/proc/{}/status", pid));  // whose size is said to be 0
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  const auto at = text.find("VmRSS:");
  if (at == std::string::npos) return 0;
  return static_cast<double>(std::strtoull(text.c_str() + at + 6, nullptr, 10)) / 1024;
}

Environment Shim(const Path& folder) {
  return {{"LD_PRELOAD", (ProgramFolder() / "libfault_shim.so").string()}, {"ETUDE_SHIM_FOLDER", folder.string()}};
}

CampaignRun::CampaignRun(RunOptions options) : options_(std::move(options)) {
  spec_ = SyntheticSpec();
  spec_.name = fmt::format("{}-{}", options_.name, ::getpid());
  spec_.episodes = options_.episodes;
  spec_.max_attempts = 100;
  EXPECT_TRUE(WriteFileAtomically(folder() / "spec.yaml", ToYaml(ToJson(spec_))));
}

campaign::Process& CampaignRun::StartCollector(const Environment& environment) {
  collector_.reset();
  campaign::ProcessOptions options{options_.collector_prefix, folder() / "collector.log", options_.environment};
  for (const auto& [name, value] : environment) options.environment[name] = value;
  const Path program = Or(options_.collector_program, ProgramsFolder() / "etude-collector");
  for (const std::string& word :
       {program.string(), (folder() / "spec.yaml").string(), std::string("--out"), dataset().string(),
        std::string("--domain"), std::to_string(options_.domain), std::string("--lease"), options_.lease_s})
    options.argv.push_back(word);
  // those that were killed are not waited for as long as by default; another build's program may not know of it
  if (options_.collector_program.empty()) options.argv.insert(options.argv.end(), {"--away", "15"});
  options.argv.insert(options.argv.end(), options_.collector_flags.begin(), options_.collector_flags.end());
  auto process = campaign::Process::Start(options);
  EXPECT_TRUE(process) << (process ? "" : process.error().message);
  collector_.emplace(std::move(*process));
  return *collector_;
}

campaign::Process& CampaignRun::StartWorker(const Environment& environment, const std::string& content) {
  const std::string number = std::to_string(started_++);
  campaign::ProcessOptions options{options_.worker_prefix, folder() / "worker.log", options_.environment};
  options.environment["ETUDE_ACK_LOG"] = (folder() / ("acks-" + number)).string();
  for (const auto& [name, value] : environment) options.environment[name] = value;
  const Path program = Or(options_.worker_program, ProgramFolder() / "fake_worker");
  for (const std::string& word :
       {program.string(), spec_.name, std::to_string(options_.domain), std::to_string(options_.ms_per_attempt)})
    options.argv.push_back(word);
  if (!content.empty()) options.argv.push_back(content);
  auto process = campaign::Process::Start(options);
  EXPECT_TRUE(process) << (process ? "" : process.error().message);
  workers_.push_back(std::move(*process));
  return workers_.back();
}

void CampaignRun::ReplaceWorker(std::size_t which, const Environment& environment) {
  workers_[which].Signal(SIGKILL);
  workers_[which].Wait(5s);
  StartWorker(environment);
  workers_[which] = std::move(workers_.back());
  workers_.pop_back();
}

std::uint64_t CampaignRun::Committed() const {
  std::uint64_t count = 0;
  std::error_code error;
  for (std::filesystem::recursive_directory_iterator it(dataset() / "episodes", error), end; !error && it != end;
       it.increment(error))
    count += it->path().extension() == ".hdf5";
  return count;
}

void CampaignRun::WaitForCommitted(std::uint64_t episodes) {
  EXPECT_TRUE(WaitUntil([&] { return Committed() >= episodes; })) << Committed() << " of " << episodes << Logs();
}

std::vector<Path> CampaignRun::AckLogs() const {
  std::vector<Path> logs;
  for (const auto& item : std::filesystem::directory_iterator(folder()))
    if (item.path().filename().string().starts_with("acks-")) logs.push_back(item.path());
  std::sort(logs.begin(), logs.end());
  return logs;
}

std::vector<Ack> CampaignRun::Acks() const { return ReadAcks(AckLogs()); }

Counts CampaignRun::Scan() const {
  Scanner scanner;
  const auto acks = Acks();  // first: what is answered meanwhile would look lost
  return scanner.ScanFolder(dataset(), acks);
}

std::string CampaignRun::Logs() const {
  return "\n" + ReadTextFile(folder() / "collector.log").value_or("") +
         ReadTextFile(folder() / "worker.log").value_or("");
}

Counts CampaignRun::Finish(std::chrono::seconds patience) {
  const auto code = collector_->Wait(patience);
  EXPECT_EQ(code, 0) << "the collector ends when all is committed" << Logs();
  for (auto& worker : workers_) worker.Wait(10s);
  Counts counts = Scan();
  EXPECT_EQ(counts.files, spec_.episodes) << Logs();
  // what a calm run commits, whoever made it and however often
  const auto reader = store::DatasetReader::Open(dataset());
  EXPECT_TRUE(reader);
  for (std::uint64_t index = 0; reader && index < spec_.episodes; ++index) {
    const auto episode = reader->ReadWhole(index);
    const auto expected = EncodeEpisode(campaign::FakeEpisode(spec_, index, campaign::FakeCommittedAttempt(index)));
    if (!episode || EncodeEpisode(*episode) != expected) ++counts.mismatched;
  }
  return counts;
}

}  // namespace etude::faults
