// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/stat.h>

#include <algorithm>
#include <fstream>
#include <map>
#include <utility>

#include "services/core/clock.h"
#include "services/core/log.h"
#include "services/episode/bounded_json.h"
#include "services/spec/episode_plan.h"
#include "services/store/commit_file.h"
#include "services/store/commit_journal.h"
#include "services/store/dataset.h"
#include "services/store/edit.h"
#include "services/store/episode_file.h"
#include "services/store/layout.h"
#include "services/store/master_file.h"
#include "services/store/summary.h"

namespace etude::store {
namespace {

constexpr std::size_t kMaxDetailsText = 1000;

using AttemptId = std::pair<std::uint64_t, std::uint32_t>;

// What a crash between writing and renaming left behind.
Status RemoveTemporaries(const Path& dataset, const std::vector<Path>& episode_files) {
  std::error_code error;
  for (const auto& path : episode_files)
    if (path.extension() == internal::kTemporarySuffix) std::filesystem::remove(path, error);
  for (std::filesystem::directory_iterator it(dataset, error), end; !error && it != end; it.increment(error))
    if (it->path().filename().string().find(".tmp-") != std::string::npos) std::filesystem::remove(it->path(), error);
  if (error) return Fail(ErrnoError("remove temporary files in", dataset, error.value()));
  return {};
}

// A new dataset only in a folder that has nothing which we did not put there.
Status CheckFresh(const Path& dataset) {
  std::error_code error;
  for (std::filesystem::directory_iterator it(dataset, error), end; !error && it != end; it.increment(error)) {
    const std::string name = it->path().filename().string();
    // a journal that is there already says what to make: the dataset that it comes from again
    if (name == internal::kLock || name == internal::kSampling || name.starts_with(internal::kDatasetJson)) continue;
    return Fail(Code::kInvalidArgument,
                fmt::format("'{}' has no {} but holds '{}': not a dataset, and not empty; choose another folder",
                            dataset.string(), internal::kDatasetJson, name));
  }
  if (error) return Fail(ErrnoError("list", dataset, error.value()));
  return {};
}

Status CheckSpec(const Path& dataset, const internal::DatasetFile& found, const CampaignSpec& now) {
  if (found.schema_version != kSchemaVersion)
    return Fail(Code::kInvalidArgument,
                fmt::format("dataset '{}' has schema version {}, new episodes have {}: it can be read and trained on, "
                            "but not added to; collect into another folder",
                            dataset.string(), found.schema_version, kSchemaVersion));
  if (found.content != kContentVersion)
    return Fail(Code::kInvalidArgument,
                fmt::format("dataset '{}' was made with content version {}, new episodes have {}: the same spec would "
                            "not make the same bytes; collect into another folder",
                            dataset.string(), found.content, kContentVersion));
  if (found.spec_sha256 != SpecHash(found.spec))
    return Fail(Code::kInvalidArgument,
                fmt::format("dataset '{}': its spec has another hash in this version, which knows other keys; new "
                            "episodes would not be of one spec with those in it; collect into another folder",
                            dataset.string()));
  const CampaignSpec& made_from = found.spec;
  const auto differences = internal::SpecDifferences(made_from, now);
  if (differences.empty()) return {};
  return Fail(Code::kInvalidArgument,
              fmt::format("dataset '{}' was made from another spec; different: {}; use its own spec or "
                          "another folder",
                          dataset.string(), fmt::join(differences, ", ")));
}

std::set<AttemptId> RecordedAttempts(const Path& dataset) {
  std::set<AttemptId> attempts;
  std::ifstream file(dataset / internal::kAttempts);
  for (std::string line; std::getline(file, line);) {
    const OrderedJson json = ParseBoundedJson(line).value_or(OrderedJson());
    const auto number = [&](const char* key) {
      return json.is_object() && json.contains(key) && json[key].is_number_unsigned();
    };
    if (number("index") && number("attempt"))
      attempts.emplace(json["index"].get<std::uint64_t>(), json["attempt"].get<std::uint32_t>());
  }
  return attempts;
}

// Of the episodes that are there; 0 where the file cannot be asked.
std::map<std::uint64_t, std::uint64_t> SizesOf(const std::vector<Path>& files) {
  std::map<std::uint64_t, std::uint64_t> sizes;
  for (const auto& path : files) {
    const auto index = internal::IndexOf(path);
    if (!index) continue;
    std::error_code error;
    const auto bytes = std::filesystem::file_size(path, error);
    sizes[*index] = error ? 0 : bytes;
  }
  return sizes;
}

// When a file was committed, seconds since 1970, as well as its folder knows.
double CommitTime(const Path& path) {
  struct stat info {};
  if (::stat(path.c_str(), &info) != 0) return 0;
  return static_cast<double>(info.st_mtim.tv_sec) + 1e-9 * static_cast<double>(info.st_mtim.tv_nsec);
}

}  // namespace

struct DatasetWriter::Impl {
  Path dataset;
  CampaignSpec spec;
  std::string spec_sha256;
  internal::DatasetLock lock;
  LineAppender attempts;
  CommitJournal commits;
  std::set<AttemptId> recorded = {};
  std::set<std::uint64_t> committed = {};
  std::map<std::uint64_t, internal::EpisodeSummary> summaries = {};  // of those committed, read when needed

  Status Summarize();
  void Note(CommitRow row, const CommitFacts& facts, double t);
};

DatasetWriter::DatasetWriter(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
DatasetWriter::DatasetWriter(DatasetWriter&&) noexcept = default;
DatasetWriter& DatasetWriter::operator=(DatasetWriter&&) noexcept = default;
DatasetWriter::~DatasetWriter() = default;

Result<DatasetWriter> DatasetWriter::Open(const Path& dataset, const CampaignSpec& spec) {
  ETUDE_RETURN_IF_ERROR(MakeFolders(dataset));
  // an earlier run may have ended between making the folder and making its entry durable; where the folder above
  // cannot be read, this cannot be done
  (void)SyncFolder(std::filesystem::absolute(dataset / ".").parent_path().parent_path());
  ETUDE_ASSIGN_OR_RETURN(auto lock, internal::DatasetLock::Take(dataset));

  // the description says what the dataset is; it is the first thing that is made
  internal::DatasetFile description{spec};
  auto found = internal::ReadDatasetFile(dataset);
  if (found) {
    ETUDE_RETURN_IF_ERROR(CheckSpec(dataset, *found, spec));
    description.statistics = found->statistics;
  } else if (found.error().code == Code::kNotFound) {
    ETUDE_RETURN_IF_ERROR(CheckFresh(dataset));
  } else {
    return Fail(found.error());
  }
  if (!found || ToJson(found->spec) != ToJson(spec))
    ETUDE_RETURN_IF_ERROR(internal::WriteDatasetFile(dataset, description));

  ETUDE_RETURN_IF_ERROR(internal::FinishDeletion(dataset));
  ETUDE_ASSIGN_OR_RETURN(const auto files, internal::ListEpisodeFolder(dataset));
  ETUDE_RETURN_IF_ERROR(RemoveTemporaries(dataset, files));
  ETUDE_ASSIGN_OR_RETURN(auto attempts, LineAppender::Open(dataset / internal::kAttempts));
  const auto sizes = SizesOf(files);
  ETUDE_ASSIGN_OR_RETURN(auto commits, CommitJournal::Open(dataset, sizes));
  auto impl = std::unique_ptr<Impl>(
      new Impl{dataset, spec, SpecHash(spec), std::move(lock), std::move(attempts), std::move(commits)});
  impl->recorded = RecordedAttempts(dataset);
  for (const auto& [index, bytes] : sizes) impl->committed.insert(index);
  return DatasetWriter(std::move(impl));
}

const std::set<std::uint64_t>& DatasetWriter::committed() const { return impl_->committed; }

bool DatasetWriter::Contains(std::uint64_t index) const { return impl_->committed.contains(index); }

// The episode is durable: a line that cannot be written now is made from its file with the next index.
void DatasetWriter::Impl::Note(CommitRow row, const CommitFacts& facts, double t) {
  row.facts = facts;
  row.t = t;
  if (const Status noted = commits.Append(row); !noted) Log().warn("{}", noted.error().message);
}

Status DatasetWriter::Commit(const Episode& episode, const CommitFacts& facts) {
  if (Contains(episode.index)) return {};
  const auto context = [&] { return fmt::format("commit episode {} to '{}'", episode.index, impl_->dataset.string()); };
  if (episode.spec_sha256 != impl_->spec_sha256)
    return Fail(Code::kInvalidArgument, fmt::format("{}: it was made from another spec ({}, not {})", context(),
                                                    episode.spec_sha256, impl_->spec_sha256));
  const auto bytes = internal::EncodeEpisodeFile(episode);
  if (!bytes) return Fail(bytes.error().Wrap(context()));
  if (Status done = internal::CommitFile(EpisodePath(impl_->dataset, episode.index), *bytes); !done)
    return Fail(done.error().Wrap(context()));
  std::uint64_t frames = 0;
  for (const auto& camera : episode.cameras) frames += camera.frames.size();
  impl_->committed.insert(episode.index);
  impl_->summaries[episode.index] = internal::Summarize(episode, frames, bytes->size());
  impl_->Note(RowOf(episode, frames, bytes->size()), facts, WallSeconds());
  return {};
}

Status DatasetWriter::RecordFailure(std::uint64_t index, std::uint32_t attempt, const std::string& outcome,
                                    const std::string& details_json) {
  if (impl_->recorded.contains({index, attempt})) return {};  // made again after a crash
  // whatever a worker sent: what is no JSON, or has no end of brackets, is kept as text
  auto details = ParseBoundedJson(details_json);
  if (!details) details = details_json.substr(0, kMaxDetailsText);
  const OrderedJson line = {{"index", index},
                            {"attempt", attempt},
                            {"seed", EpisodeSeed(impl_->spec, index, attempt)},
                            {"outcome", outcome},
                            {"details", std::move(*details)}};
  ETUDE_RETURN_IF_ERROR(impl_->attempts.Append(line.dump(-1, ' ', false, OrderedJson::error_handler_t::replace)));
  impl_->recorded.emplace(index, attempt);
  return {};
}

// Reads what an earlier run committed, and what the journal lacks. A file that cannot be read stays out of both.
Status DatasetWriter::Impl::Summarize() {
  const auto known = [this](std::uint64_t index) { return summaries.contains(index) && commits.Contains(index); };
  if (std::ranges::all_of(committed, known)) return {};
  ETUDE_ASSIGN_OR_RETURN(const auto reader, DatasetReader::Open(dataset));
  for (const std::uint64_t index : committed) {
    if (known(index)) continue;
    const auto record = reader.Read(index);
    if (!record) {
      Log().warn("left out of the master file: {}", record.error().message);
      continue;
    }
    const auto& summary = summaries[index] = internal::Summarize(*record);
    if (!commits.Contains(index))
      Note(RowOf(record->episode, summary.frames, summary.bytes), {}, CommitTime(record->path));
  }
  return {};
}

Status DatasetWriter::WriteMaster() {
  ETUDE_RETURN_IF_ERROR(impl_->Summarize());
  ETUDE_RETURN_IF_ERROR(impl_->attempts.Sync());
  ETUDE_RETURN_IF_ERROR(impl_->commits.Sync());
  ETUDE_RETURN_IF_ERROR(internal::WriteMasterFile(impl_->dataset, impl_->spec, impl_->summaries));
  OrderedJson statistics = internal::StatisticsOf(impl_->spec, impl_->summaries);
  statistics["failed_attempts"] = internal::FailuresByOutcome(impl_->dataset);
  return internal::WriteDatasetFile(impl_->dataset, {impl_->spec, std::move(statistics)});
}

}  // namespace etude::store
