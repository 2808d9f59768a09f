// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/sink.h"

#include <map>

#include "services/campaign/eval_report.h"
#include "services/campaign/scene_report.h"
#include "services/episode/bounded_json.h"
#include "services/store/dataset.h"

namespace etude::campaign {
namespace {

constexpr int kDeepestDetails = 16;

class DatasetSink : public EpisodeSink {
 public:
  DatasetSink(Path folder, store::DatasetWriter writer) : folder_(std::move(folder)), writer_(std::move(writer)) {}

  const Path& folder() const override { return folder_; }
  const std::set<std::uint64_t>& committed() const override { return writer_.committed(); }
  Status Commit(const Episode& episode, const store::CommitFacts& facts) override {
    return writer_.Commit(episode, facts);
  }
  Status RecordFailure(std::uint64_t index, std::uint32_t attempt, const std::string& outcome,
                       const std::string& details_json) override {
    return writer_.RecordFailure(index, attempt, outcome, details_json);
  }
  Status WriteIndex() override { return writer_.WriteMaster(); }

 private:
  Path folder_;
  store::DatasetWriter writer_;
};

// Rollouts are a dataset too (FOLDER/rollouts), and eval.json is derived from it: a crash between the two
// loses nothing, because Open derives it again.
class EvalSink : public EpisodeSink {
 public:
  EvalSink(Path out, CampaignSpec spec, store::DatasetWriter writer)
      : out_(std::move(out)), folder_(out_ / "rollouts"), spec_(std::move(spec)), writer_(std::move(writer)) {}

  Status Restore() {
    if (!writer_.committed().empty()) {
      ETUDE_ASSIGN_OR_RETURN(const auto reader, store::DatasetReader::Open(folder_));
      for (const std::uint64_t index : writer_.committed()) {
        ETUDE_ASSIGN_OR_RETURN(const auto record, reader.Read(index));
        rows_[index] = RowOf(record.episode);
        scenes_.Add(record.episode);
      }
    }
    scenes_.Restore(folder_);
    return WriteReport();
  }

  const Path& folder() const override { return folder_; }
  const std::set<std::uint64_t>& committed() const override { return writer_.committed(); }

  Status Commit(const Episode& episode) override {
    ETUDE_RETURN_IF_ERROR(writer_.Commit(episode));
    rows_[episode.index] = RowOf(episode);
    scenes_.Add(episode);
    // the rollout is durable; a report that cannot be written now is written with the next one
    (void)WriteReport();
    return {};
  }
  Status RecordFailure(std::uint64_t index, std::uint32_t attempt, const std::string& outcome,
                       const std::string& details_json) override {
    if (const auto details = ParseBoundedJson(details_json, kDeepestDetails))
      scenes_.AddFailure(index, outcome, *details);
    return writer_.RecordFailure(index, attempt, outcome, details_json);
  }
  Status WriteIndex() override {
    ETUDE_RETURN_IF_ERROR(WriteReport());
    return writer_.WriteMaster();
  }

 private:
  Status WriteReport() const {
    OrderedJson report = EvalReport(spec_, rows_);
    report["scenes"] = scenes_.Json(spec_.scenes);
    return WriteFileAtomically(out_ / "eval.json", report.dump(1) + "\n");
  }

  Path out_, folder_;
  CampaignSpec spec_;
  store::DatasetWriter writer_;
  std::map<std::uint64_t, RolloutRow> rows_;
  SceneReport scenes_;
};

}  // namespace

Result<std::unique_ptr<EpisodeSink>> OpenDatasetSink(const Path& dataset, const CampaignSpec& spec) {
  ETUDE_ASSIGN_OR_RETURN(auto writer, store::DatasetWriter::Open(dataset, spec));
  return std::make_unique<DatasetSink>(dataset, std::move(writer));
}

Result<std::unique_ptr<EpisodeSink>> OpenEvalSink(const Path& folder, const CampaignSpec& spec) {
  ETUDE_ASSIGN_OR_RETURN(auto writer, store::DatasetWriter::Open(folder / "rollouts", spec));
  auto sink = std::make_unique<EvalSink>(folder, spec, std::move(writer));
  ETUDE_RETURN_IF_ERROR(sink->Restore());
  return sink;
}

Result<std::unique_ptr<EpisodeSink>> OpenSink(const Path& folder, const CampaignSpec& spec) {
  return spec.mode == "rollout" ? OpenEvalSink(folder, spec) : OpenDatasetSink(folder, spec);
}

}  // namespace etude::campaign
