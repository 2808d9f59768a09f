// SPDX-License-Identifier: Apache-2.0
// A campaign of real processes to do harm to: the program etude-collector, fake workers (synthetic episodes, so that
// hundreds pass in seconds), their acknowledgement logs, and at the end the scanner's word.
#pragma once

#include <gtest/gtest.h>

#include <chrono>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "services/campaign/process.h"
#include "services/spec/campaign_spec.h"
#include "tests/faults/scanner.h"
#include "tests/support/temporary_folder.h"

namespace etude::faults {

using Environment = std::map<std::string, std::string>;

/// Prints "F7 lost=0 duplicated=0 partial=0 mismatched=0 ...", expects that it is so, and appends a row of the table in
/// deploy/docs/reliability.md to the file that ETUDE_FAULTS_REPORT names.
void ReportRow(const std::string& fault, const std::string& what, const Counts& counts);
/// The same of a fault that does not touch committed data: `what` says what was asserted, the counts are dashes.
/// Nothing when the test has failed.
void ReportAsserted(const std::string& fault, const std::string& what);

/// Resident memory of a process, MB; 0 when it has gone.
double ResidentMb(pid_t pid);

/// With it a process has tests/faults/shim.cc, for what is below `folder`.
Environment Shim(const Path& folder);
/// Environment of a fake worker with this identity; empty: without one.
inline Environment WorkerOf(const Path& identity) { return {{"FAKE_SECURITY", identity.string()}}; }

struct RunOptions {
  std::string name;
  std::uint32_t domain = 90;
  std::uint64_t episodes = 30;
  std::string lease_s = "1.5";
  int ms_per_attempt = 10;
  Environment environment;                    ///< of every process
  std::vector<std::string> collector_prefix;  ///< e.g. ip netns exec NAME
  std::vector<std::string> worker_prefix;
  std::vector<std::string> collector_flags;  ///< behind its own
  Path collector_program, worker_program;    ///< empty: those of this build
};

class CampaignRun {
 public:
  explicit CampaignRun(RunOptions options);

  const Path& folder() const { return folder_.path(); }
  Path dataset() const { return folder() / "data"; }
  const CampaignSpec& spec() const { return spec_; }

  /// Ends the one before, if it still runs.
  campaign::Process& StartCollector(const Environment& environment = {});
  campaign::Process& collector() { return *collector_; }
  /// Each has a log of acknowledgements of its own: every file acks-* of the folder is one.
  /// @param content  number that it says it makes episodes of; "": its own
  campaign::Process& StartWorker(const Environment& environment = {}, const std::string& content = "");
  campaign::Process& worker(std::size_t which) { return workers_[which]; }
  std::size_t workers() const { return workers_.size(); }
  /// SIGKILL, if it runs, and another in its place.
  void ReplaceWorker(std::size_t which, const Environment& environment = {});

  /// Episodes that are visible in the folder.
  std::uint64_t Committed() const;
  void WaitForCommitted(std::uint64_t episodes);
  std::vector<Ack> Acks() const;

  /// Until the collector says by its end that all is committed; then scans, and expects every episode in its place with
  /// the bytes that a calm run gives.
  Counts Finish(std::chrono::seconds patience = std::chrono::seconds(60));
  Counts Scan() const;
  std::string Logs() const;

 private:
  std::vector<Path> AckLogs() const;

  RunOptions options_;
  TemporaryFolder folder_;
  CampaignSpec spec_;
  std::optional<campaign::Process> collector_;
  std::vector<campaign::Process> workers_;
  int started_ = 0;
};

}  // namespace etude::faults
