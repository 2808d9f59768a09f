// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/sink.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <optional>

#include "services/campaign/scene_report.h"
#include "services/core/clock.h"
#include "services/core/thread_annotations.h"
#include "services/episode/bounded_json.h"
#include "services/store/commit_journal.h"
#include "services/store/dataset.h"

namespace etude::campaign {
namespace {

constexpr int kDeepestDetails = 16;

class DatasetSink : public EpisodeSink {
 public:
  DatasetSink(Path folder, store::DatasetWriter writer) : folder_(std::move(folder)), writer_(std::move(writer)) {}

  const Path& folder() const override { return folder_; }
  const std::set<std::uint64_t>& committed() const override { return writer_.committed(); }
  std::vector<Status> CommitGroup(std::span<const store::ArrivedEpisode> group) override {
    return writer_.CommitGroup(group);
  }
  Status RecordFailure(std::uint64_t index, std::uint32_t attempt, const std::string& outcome,
                       const std::string& details_json) override {
    return writer_.RecordFailure(index, attempt, outcome, details_json);
  }
  Status ForgetFailures() override { return writer_.ForgetFailures(); }
  Status WriteIndex() override { return writer_.WriteMaster(); }
  Status WriteProgress() override { return writer_.WriteProgress(); }
  Status WriteFilterKey(const std::string& name, const std::set<std::uint64_t>& indices) override {
    return writer_.WriteFilterKey(name, indices);
  }

 private:
  Path folder_;
  store::DatasetWriter writer_;
};

std::string LineOf(const RolloutRow& row) { return JsonText(RowJson(row)); }

constexpr double kReportEvery = 2;   // s; the report of 400 rollouts is 200 kB
constexpr double kReportShare = 20;  // times what one took is between two

// One report is of one policy, and of rollouts that are there.
Status CheckReport(const Path& out, const OrderedJson& report, bool has_rollouts, const EvalSubject& subject) {
  const auto refuse = [&](const std::string& why) {
    return Fail(Code::kInvalidArgument,
                fmt::format("evaluate into '{}': {}; give another --out, or move it away", out.string(), why));
  };
  if (!has_rollouts) {
    const std::uint64_t done = RolloutsOf(report);
    return done == 0 ? Status()
                     : refuse(fmt::format("its eval.json reports {} rollouts that are not there any more, and would be "
                                          "written anew",
                                          done));
  }
  const EvalSubject before = SubjectOf(report);
  const auto differ = [](const std::string& a, const std::string& b) { return !a.empty() && !b.empty() && a != b; };
  if (differ(before.run_id, subject.run_id))
    return refuse(fmt::format("it has rollouts of run {}@{}, not of {}@{}", before.run, before.run_id, subject.run,
                              subject.run_id));
  if (differ(before.sha256, subject.sha256))
    return refuse(fmt::format("it has rollouts of checkpoint {:.12} (step {}), not of {:.12} (step {})", before.sha256,
                              before.step, subject.sha256, subject.step));
  return {};
}

// What was evaluated when the folder was made.
EvalSubject Remember(const OrderedJson& report, EvalSubject subject) {
  const EvalSubject before = SubjectOf(report);
  if (subject.sha256.empty() && !before.sha256.empty()) subject = before;
  subject.created = before.created > 0 ? before.created : WallSeconds();
  return subject;
}

// Rollouts are a dataset too (FOLDER/rollouts), and eval.json and eval.jsonl are derived from it: a crash between them
// loses nothing, because Open derives them again.
class EvalSink : public EpisodeSink {
 public:
  EvalSink(Path out, CampaignSpec spec, EvalSubject subject, store::DatasetWriter writer)
      : out_(std::move(out)),
        folder_(out_ / "rollouts"),
        spec_(std::move(spec)),
        subject_(std::move(subject)),
        writer_(std::move(writer)) {}

  Status Restore() {
    ETUDE_RETURN_IF_ERROR(RestoreRows());
    return WriteReport();
  }

  const Path& folder() const override { return folder_; }
  const std::set<std::uint64_t>& committed() const override { return writer_.committed(); }
  std::vector<Status> CommitGroup(std::span<const store::ArrivedEpisode> group) override {
    auto statuses = writer_.CommitGroup(group);
    bool due = false;
    {
      const MutexLock lock(mutex_);
      for (std::size_t i = 0; i < group.size(); ++i)
        if (statuses[i]) due = Report(group[i].view->episode, group[i].facts) || due;
    }
    if (due) (void)WriteReport();
    return statuses;
  }
  Status RecordFailure(std::uint64_t index, std::uint32_t attempt, const std::string& outcome,
                       const std::string& details_json) override {
    if (const auto details = ParseBoundedJson(details_json, kDeepestDetails)) {
      const MutexLock lock(mutex_);
      scenes_.AddFailure(index, outcome, *details);
    }
    return writer_.RecordFailure(index, attempt, outcome, details_json);
  }
  Status ForgetFailures() override {
    {
      const MutexLock lock(mutex_);
      scenes_ = SceneReport();
    }
    return writer_.ForgetFailures();
  }
  Status WriteIndex() override {
    ETUDE_RETURN_IF_ERROR(WriteReport());
    return writer_.WriteMaster();
  }
  // what is done, and not the links to each rollout: nobody follows those in between
  Status WriteProgress() override {
    ETUDE_RETURN_IF_ERROR(WriteReport());
    return writer_.WriteProgress();
  }
  Status WriteFilterKey(const std::string& name, const std::set<std::uint64_t>& indices) override {
    return writer_.WriteFilterKey(name, indices);
  }

 private:
  Status RestoreRows() ETUDE_EXCLUDES(mutex_) {
    const MutexLock lock(mutex_);
    if (!writer_.committed().empty()) {
      ETUDE_ASSIGN_OR_RETURN(const auto reader, store::DatasetReader::Open(folder_));
      std::map<std::uint64_t, double> wall_s;  // by index: the later line of one counts
      const auto take = [&](const store::CommitRow& line) {
        if (writer_.committed().contains(line.index)) wall_s[line.index] = line.facts.timings.wall_s;
      };
      ETUDE_RETURN_IF_ERROR(store::CommitTail(folder_).Refresh([&] { wall_s.clear(); }, take));
      for (const std::uint64_t index : writer_.committed()) {
        ETUDE_ASSIGN_OR_RETURN(const auto record, reader.Read(index));
        RolloutRow& row = rows_[index] = RowOf(record.episode);
        if (const auto said = wall_s.find(index); said != wall_s.end()) row.wall_s = said->second;
        scenes_.Add(record.episode);
      }
    }
    scenes_.Restore(folder_);
    return RestoreLines();
  }
  // The rollout is durable; what cannot be written now is derived from it with the next start.
  // @returns whether a report is due
  bool Report(const Episode& episode, const store::CommitFacts& facts) ETUDE_REQUIRES(mutex_) {
    if (rows_.contains(episode.index)) return false;
    RolloutRow& row = rows_[episode.index] = RowOf(episode);
    row.wall_s = facts.timings.wall_s;
    scenes_.Add(episode);
    if (lines_) (void)lines_->Append(LineOf(row));
    return since_report_.Seconds() > std::max(kReportEvery, kReportShare * report_took_s_) || rows_.size() == 1 ||
           rows_.size() == spec_.episodes;
  }
  // A slow disk holds up who writes, not who has a failure to record.
  Status WriteReport() ETUDE_EXCLUDES(mutex_) {
    const MutexLock writing(report_mutex_);
    const Stopwatch took;
    const OrderedJson report = ReportNow();
    const Status written = WriteFileAtomically(out_ / "eval.json", JsonText(report, 1) + "\n");
    const MutexLock lock(mutex_);
    report_took_s_ = took.Seconds();
    return written;
  }
  OrderedJson ReportNow() ETUDE_EXCLUDES(mutex_) {
    const MutexLock lock(mutex_);
    OrderedJson report = EvalReport(spec_, rows_, subject_);
    report["scenes"] = scenes_.Json(spec_.scenes);
    since_report_.Restart();
    return report;
  }
  // A row a rollout, in the order of their indices; those to come are appended.
  Status RestoreLines() ETUDE_REQUIRES(mutex_) {
    std::string text;
    for (const auto& [index, row] : rows_) text += LineOf(row) + "\n";
    ETUDE_RETURN_IF_ERROR(WriteFileAtomically(out_ / "eval.jsonl", text));
    ETUDE_ASSIGN_OR_RETURN(lines_, LineAppender::Open(out_ / "eval.jsonl"));
    return {};
  }

  Path out_, folder_;
  CampaignSpec spec_;
  EvalSubject subject_;
  store::DatasetWriter writer_;
  Mutex report_mutex_;  // eval.json's, taken before the other
  Mutex mutex_;
  std::optional<LineAppender> lines_ ETUDE_GUARDED_BY(mutex_);
  Stopwatch since_report_ ETUDE_GUARDED_BY(mutex_);
  double report_took_s_ ETUDE_GUARDED_BY(mutex_) = 0;
  std::map<std::uint64_t, RolloutRow> rows_ ETUDE_GUARDED_BY(mutex_);
  SceneReport scenes_ ETUDE_GUARDED_BY(mutex_);
};

}  // namespace

Result<std::unique_ptr<EpisodeSink>> OpenDatasetSink(const Path& dataset, const CampaignSpec& spec) {
  ETUDE_ASSIGN_OR_RETURN(auto writer, store::DatasetWriter::Open(dataset, spec));
  return std::make_unique<DatasetSink>(dataset, std::move(writer));
}

Result<std::unique_ptr<EpisodeSink>> OpenEvalSink(const Path& folder, const CampaignSpec& spec,
                                                  const EvalSubject& subject) {
  const OrderedJson report = ReadReport(folder);
  std::error_code missing;
  const bool has_rollouts = std::filesystem::exists(folder / "rollouts", missing);
  ETUDE_RETURN_IF_ERROR(CheckReport(folder, report, has_rollouts, subject));
  ETUDE_ASSIGN_OR_RETURN(auto writer, store::DatasetWriter::Open(folder / "rollouts", spec));
  if (!report.is_object() && !writer.committed().empty())
    return Fail(
        Code::kInvalidArgument,
        fmt::format("evaluate into '{}': it has rollouts, and no eval.json that says of whom they are; give another "
                    "--out, or remove its rollouts/",
                    folder.string()));
  auto sink = std::make_unique<EvalSink>(folder, spec, Remember(report, subject), std::move(writer));
  ETUDE_RETURN_IF_ERROR(sink->Restore());
  return sink;
}

Result<std::unique_ptr<EpisodeSink>> OpenSink(const Path& folder, const CampaignSpec& spec,
                                              const EvalSubject& subject) {
  return spec.mode == "rollout" ? OpenEvalSink(folder, spec, subject) : OpenDatasetSink(folder, spec);
}

}  // namespace etude::campaign
