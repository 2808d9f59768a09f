// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/stat.h>

#include <algorithm>
#include <map>
#include <optional>
#include <tuple>
#include <unordered_set>
#include <utility>

#include "services/core/clock.h"
#include "services/core/free_name.h"
#include "services/core/log.h"
#include "services/core/thread_annotations.h"
#include "services/episode/bounded_json.h"
#include "services/spec/attempt_outcome.h"
#include "services/spec/episode_plan.h"
#include "services/store/attempts.h"
#include "services/store/commit_file.h"
#include "services/store/commit_journal.h"
#include "services/store/dataset.h"
#include "services/store/edit.h"
#include "services/store/episode_file.h"
#include "services/store/filter_keys.h"
#include "services/store/layout.h"
#include "services/store/master_file.h"
#include "services/store/summary.h"

namespace etude::store {
namespace {

constexpr std::size_t kMaxDetails = kMaxAttemptLine / 8;  // written out again, it may be longer
constexpr std::size_t kMaxDetailsText = 1000;
constexpr std::uint64_t kInflateEvery = 64;  // streams, of what workers deflated and SHA-256 covers: 0.05 ms each

// An attempt that waits for its policy in vain is made again under its own number, and may then fail for itself.
using AttemptId = std::tuple<std::uint64_t, std::uint32_t, std::string>;

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
  if (const std::string why = internal::WhyClosed(found); !why.empty())
    return Fail(Code::kInvalidArgument,
                fmt::format("dataset '{}' {}; collect into another folder", dataset.string(), why));
  const CampaignSpec& made_from = found.spec;
  if (made_from.name != now.name && now.mode == "demonstrate")
    return Fail(Code::kInvalidArgument,
                fmt::format("dataset '{}' is of campaign '{}', whose name is in every episode: go on with it (--set "
                            "name={}), or collect '{}' into another folder",
                            dataset.string(), made_from.name, made_from.name, now.name));
  const auto differences = internal::SpecDifferences(made_from, now);
  if (differences.empty()) return {};
  return Fail(Code::kInvalidArgument,
              fmt::format("dataset '{}' was made from another spec; different: {}; use its own spec or "
                          "another folder",
                          dataset.string(), fmt::join(differences, ", ")));
}

std::set<AttemptId> RecordedAttempts(const Path& dataset) {
  std::set<AttemptId> attempts;
  ForEachAttempt(dataset, [&](const AttemptLine& line) { attempts.emplace(line.index, line.attempt, line.outcome); });
  return attempts;
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
  FileLock lock;

  Mutex master_mutex = {};  // one WriteMaster at a time; never taken while `mutex` is held
  std::uint64_t in_master ETUDE_GUARDED_BY(master_mutex) = 0;  // episodes; 0: not written by this one yet
  mutable Mutex mutex = {};
  LineAppender attempts ETUDE_GUARDED_BY(mutex);
  std::optional<CommitJournal> commits ETUDE_GUARDED_BY(mutex) = {};  // opened with what it restores
  std::set<AttemptId> recorded ETUDE_GUARDED_BY(mutex) = {};
  std::map<std::string, std::uint64_t> failures ETUDE_GUARDED_BY(mutex) = {};  // by outcome
  std::set<std::uint64_t> committed ETUDE_GUARDED_BY(mutex) = {};
  internal::Statistics statistics ETUDE_GUARDED_BY(mutex) = {};  // of `entries`
  std::vector<internal::MasterEntry> entries ETUDE_GUARDED_BY(mutex) = {};
  std::set<std::string> tasks ETUDE_GUARDED_BY(mutex) = {};  // that entries point to
  // committed, and not counted by the journal: what is known of each
  std::map<std::uint64_t, CommitRow> uncounted ETUDE_GUARDED_BY(mutex) = {};

  Status Restore(const std::map<std::uint64_t, std::uint64_t>& sizes) ETUDE_REQUIRES(mutex);
  void Take(std::uint64_t index, const internal::EpisodeSummary& summary) ETUDE_REQUIRES(mutex);
  void Note(const CommitRow& row) ETUDE_REQUIRES(mutex);
  void Account(const ArrivedEpisode& arrived, std::uint64_t bytes) ETUDE_REQUIRES(mutex);
  Status CountTheUncounted() ETUDE_EXCLUDES(mutex);
  std::vector<internal::MasterEntry> CopyEntries() const ETUDE_EXCLUDES(mutex);
  struct Written {  // and how it becomes durable
    LineAppender attempts, commits;
    OrderedJson statistics;
  };
  Result<Written> WrittenSoFar() const ETUDE_EXCLUDES(mutex);
  Status WriteStatistics() ETUDE_EXCLUDES(mutex);
  Status WriteLinks() ETUDE_REQUIRES(master_mutex) ETUDE_EXCLUDES(mutex);
  Status CheckArrived(const ArrivedEpisode& arrived) const;
};

DatasetWriter::DatasetWriter(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
DatasetWriter::DatasetWriter(DatasetWriter&&) noexcept = default;
DatasetWriter& DatasetWriter::operator=(DatasetWriter&&) noexcept = default;
DatasetWriter::~DatasetWriter() = default;

namespace {

// What the dataset is: the first thing that is made, and refused where it is another campaign's.
Status Describe(const Path& dataset, const CampaignSpec& spec) {
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
  if (found && ToJson(found->spec) == ToJson(spec)) return {};
  return internal::WriteDatasetFile(dataset, description);
}

// `episodes` on a disk that is not mounted is an empty folder. A deletion, and verify, leave statistics of none.
Status CheckNotAway(const Path& dataset) {
  std::error_code error;
  const auto journal = std::filesystem::file_size(dataset / internal::kCommits, error);
  if (error || journal == 0) return {};
  ETUDE_ASSIGN_OR_RETURN(const auto found, internal::ReadDatasetFile(dataset));
  const OrderedJson& statistics = found.statistics;
  const bool had_some = statistics.is_object() && statistics.contains("episodes") &&
                        statistics["episodes"].is_number_unsigned() && statistics["episodes"] > 0;
  if (!had_some) return {};
  return Fail(
      Code::kUnavailable,
      fmt::format("'{}' says that it has {} episodes, and not one of them is there: is the disk of '{}' away? If "
                  "they were removed on purpose, remove {}, too",
                  dataset.string(), statistics["episodes"].get<std::uint64_t>(),
                  (dataset / internal::kEpisodes).string(), internal::kCommits));
}

}  // namespace

Result<DatasetWriter> DatasetWriter::Open(const Path& dataset, const CampaignSpec& spec) {
  ETUDE_RETURN_IF_ERROR(MakeFolders(dataset));
  // an earlier run may have ended between making the folder and making its entry durable; where the folder above
  // cannot be read, this cannot be done
  (void)SyncFolder(std::filesystem::absolute(dataset / ".").parent_path().parent_path());
  ETUDE_ASSIGN_OR_RETURN(auto lock, internal::LockDataset(dataset));

  ETUDE_RETURN_IF_ERROR(Describe(dataset, spec));
  ETUDE_RETURN_IF_ERROR(internal::FinishDeletion(dataset));
  ETUDE_ASSIGN_OR_RETURN(const auto files, internal::ListEpisodeFolder(dataset));
  const auto sizes = internal::SizesOf(files);
  if (sizes.empty()) ETUDE_RETURN_IF_ERROR(CheckNotAway(dataset));
  ETUDE_RETURN_IF_ERROR(RemoveTemporaries(dataset, files));
  ETUDE_ASSIGN_OR_RETURN(auto attempts, LineAppender::Open(dataset / internal::kAttempts));
  auto impl = std::unique_ptr<Impl>(new Impl{.dataset = dataset,
                                             .spec = spec,
                                             .spec_sha256 = SpecHash(spec),
                                             .lock = std::move(lock),
                                             .attempts = std::move(attempts)});
  const MutexLock writing(impl->mutex);
  impl->recorded = RecordedAttempts(dataset);
  impl->failures = internal::FailuresByOutcome(dataset);
  ETUDE_RETURN_IF_ERROR(impl->Restore(sizes));
  return DatasetWriter(std::move(impl));
}

// What the journal says of the episodes that are there. Line by line: a million of them are not in memory at once.
Status DatasetWriter::Impl::Restore(const std::map<std::uint64_t, std::uint64_t>& sizes) {
  std::unordered_set<std::uint64_t> counted;
  ETUDE_ASSIGN_OR_RETURN(commits, CommitJournal::Open(dataset, sizes, [&](const CommitRow& row) ETUDE_REQUIRES(mutex) {
                           if (row.counted) {
                             Take(row.index, internal::SummaryOf(row));
                             counted.insert(row.index);
                           } else {
                             uncounted[row.index] = row;
                           }
                         }));
  for (const auto& [index, bytes] : sizes) {
    committed.insert(index);
    if (!counted.contains(index)) uncounted.try_emplace(index, CommitRow{.index = index});
  }
  return {};
}

const std::set<std::uint64_t>& DatasetWriter::committed() const {
  const MutexLock lock(impl_->mutex);
  return impl_->committed;
}

bool DatasetWriter::Contains(std::uint64_t index) const {
  const MutexLock lock(impl_->mutex);
  return impl_->committed.contains(index);
}

void DatasetWriter::Impl::Take(std::uint64_t index, const internal::EpisodeSummary& summary) {
  statistics.Add(spec, index, summary);
  entries.push_back({index, summary.samples, &*tasks.insert(summary.task).first});
}

// The episode is durable: a line that cannot be written now is made from its file with the next start.
void DatasetWriter::Impl::Note(const CommitRow& row) {
  if (const Status noted = commits->Append(row); !noted) Log().warn("{}", noted.error().message);
}

Status DatasetWriter::Impl::CheckArrived(const ArrivedEpisode& arrived) const {
  const Episode& episode = arrived.view->episode;
  if (episode.spec_sha256 != spec_sha256)
    return Fail(Code::kInvalidArgument,
                fmt::format("it was made from another spec ({}, not {})", episode.spec_sha256, spec_sha256));
  if (Status good = internal::CheckStreams(episode, arrived.view->streams, kInflateEvery); !good)
    return Fail(Code::kInvalidArgument, good.error().message);
  return {};
}

Status DatasetWriter::Commit(const Episode& episode, const CommitFacts& facts) {
  if (Contains(episode.index)) return {};
  EpisodeView view{episode, StreamsOf(episode)};
  Status good = ValidateEpisode(episode);
  if (good) good = internal::CheckStreams(episode, view.streams);
  if (!good)
    return Fail(Code::kInvalidArgument, fmt::format("commit episode {} to '{}': {}", episode.index,
                                                    impl_->dataset.string(), good.error().message));
  const ArrivedEpisode arrived{&view, internal::ContentHash(episode), facts};
  return CommitGroup({&arrived, 1}).front();
}

namespace {

std::uint64_t FramesIn(const EpisodeView& view) {
  const auto of_camera = static_cast<std::uint64_t>(FrameCount(view.episode.steps(), view.episode.image_stride));
  std::uint64_t frames = 0;
  for (const auto& streams : view.streams) frames += streams.empty() ? 0 : of_camera;
  return frames;
}

}  // namespace

// What was committed, in memory and in the journal.
void DatasetWriter::Impl::Account(const ArrivedEpisode& arrived, std::uint64_t bytes) {
  CommitRow row = RowOf(arrived.view->episode, FramesIn(*arrived.view), bytes);
  row.facts = arrived.facts;
  row.t = WallSeconds();
  committed.insert(row.index);
  Take(row.index, internal::SummaryOf(row));
  Note(row);
}

std::vector<Status> DatasetWriter::CommitGroup(std::span<const ArrivedEpisode> group) {
  std::vector<Status> statuses(group.size());
  std::vector<std::size_t> fresh;  // positions in the group of those that are written
  std::vector<internal::EpisodeFileParts> parts;
  std::vector<internal::FileToCommit> files;
  for (std::size_t i = 0; i < group.size(); ++i) {
    const EpisodeView& view = *group[i].view;
    if (Contains(view.episode.index)) continue;
    statuses[i] = impl_->CheckArrived(group[i]);
    if (!statuses[i]) continue;
    auto made = internal::LayOutEpisodeFile(view.episode, view.streams, group[i].content_sha256);
    if (!made) {
      statuses[i] = Fail(made.error());
      continue;
    }
    fresh.push_back(i);
    parts.push_back(std::move(*made));
  }
  for (std::size_t k = 0; k < fresh.size(); ++k)
    files.push_back({EpisodePath(impl_->dataset, group[fresh[k]].view->episode.index), parts[k].pieces()});
  const auto committed = internal::CommitFiles(files);

  const MutexLock lock(impl_->mutex);
  for (std::size_t k = 0; k < fresh.size(); ++k) {
    statuses[fresh[k]] = committed[k];
    if (committed[k]) impl_->Account(group[fresh[k]], parts[k].size());
  }
  for (std::size_t i = 0; i < group.size(); ++i)
    if (!statuses[i])
      statuses[i] = Fail(statuses[i].error().Wrap(
          fmt::format("commit episode {} to '{}'", group[i].view->episode.index, impl_->dataset.string())));
  return statuses;
}

Status DatasetWriter::RecordFailure(std::uint64_t index, std::uint32_t attempt, const std::string& outcome,
                                    const std::string& details_json) {
  const MutexLock lock(impl_->mutex);
  if (impl_->recorded.contains({index, attempt, outcome})) return {};  // made again after a crash
  // whatever a worker sent: what is no JSON, or has no end of brackets, is kept as text
  auto details = details_json.size() > kMaxDetails ? std::nullopt : ParseBoundedJson(details_json, kMaxJsonDepth - 1);
  if (!details) details = details_json.substr(0, kMaxDetailsText);
  const OrderedJson line = {{"index", index},
                            {"attempt", attempt},
                            {"seed", EpisodeSeed(impl_->spec, index, attempt)},
                            {"outcome", outcome},
                            {"details", std::move(*details)}};
  ETUDE_RETURN_IF_ERROR(impl_->attempts.Append(JsonText(line)));
  impl_->recorded.emplace(index, attempt, outcome);
  if (outcome != kRecheckMismatch) ++impl_->failures[outcome];
  return {};
}

Status DatasetWriter::ForgetFailures() {
  const MutexLock lock(impl_->mutex);
  if (impl_->recorded.empty()) return {};
  const Path file = impl_->dataset / internal::kAttempts;
  const Path aside = FirstFree([&](int n) { return impl_->dataset / fmt::format("attempts.{}.jsonl", n); });
  std::error_code error;
  std::filesystem::rename(file, aside, error);
  if (error) return Fail(ErrnoError("set aside", file, error.value()));
  ETUDE_ASSIGN_OR_RETURN(impl_->attempts, LineAppender::Open(file));
  ETUDE_RETURN_IF_ERROR(SyncFolder(impl_->dataset));
  impl_->recorded.clear();
  impl_->failures.clear();
  return {};
}

// Reads what an earlier run committed and the journal lacks. A file that cannot be read stays out of both.
Status DatasetWriter::Impl::CountTheUncounted() {
  const auto rows = [&] {
    const MutexLock lock(mutex);
    return uncounted;
  }();
  if (rows.empty()) return {};
  ETUDE_ASSIGN_OR_RETURN(const auto reader, DatasetReader::Open(dataset));
  for (const auto& [index, known] : rows) {
    const auto record = reader.Read(index);
    if (!record) {
      Log().warn("left out of the master file: {}", record.error().message);
      continue;
    }
    const auto summary = internal::Summarize(*record);
    CommitRow row = RowOf(record->episode, summary.frames, summary.bytes);
    row.facts = known.facts;
    row.t = known.t > 0 ? known.t : CommitTime(record->path);
    const MutexLock lock(mutex);
    Take(index, summary);
    Note(row);
    uncounted.erase(index);
  }
  return {};
}

// In pieces, so that no commit waits for a million of them: what is in the list stays there.
std::vector<internal::MasterEntry> DatasetWriter::Impl::CopyEntries() const {
  constexpr std::size_t kAtOnce = 1 << 14;
  std::vector<internal::MasterEntry> copied;
  while (true) {
    const MutexLock lock(mutex);
    const auto begin = entries.begin() + static_cast<std::ptrdiff_t>(copied.size());
    const std::size_t left = entries.size() - copied.size();
    copied.insert(copied.end(), begin, begin + static_cast<std::ptrdiff_t>(std::min(left, kAtOnce)));
    if (left <= kAtOnce) return copied;
  }
}

Result<DatasetWriter::Impl::Written> DatasetWriter::Impl::WrittenSoFar() const {
  const MutexLock lock(mutex);
  ETUDE_ASSIGN_OR_RETURN(auto attempt_lines, attempts.Duplicate());
  ETUDE_ASSIGN_OR_RETURN(auto commit_lines, commits->Duplicate());
  OrderedJson json = statistics.Json();
  json["failed_attempts"] = failures;
  return Written{std::move(attempt_lines), std::move(commit_lines), std::move(json)};
}

// However long the disk takes, commits and failures are taken meanwhile.
Status DatasetWriter::Impl::WriteStatistics() {
  ETUDE_ASSIGN_OR_RETURN(auto written, WrittenSoFar());
  ETUDE_RETURN_IF_ERROR(written.attempts.Sync());
  ETUDE_RETURN_IF_ERROR(written.commits.Sync());
  return internal::WriteDatasetFile(dataset, {spec, std::move(written.statistics)});
}

Status DatasetWriter::Impl::WriteLinks() {
  auto links = CopyEntries();
  std::ranges::sort(links, {}, &internal::MasterEntry::index);
  ETUDE_RETURN_IF_ERROR(internal::WriteMasterFile(dataset, spec, spec_sha256, links));
  in_master = links.size();
  return {};
}

Status DatasetWriter::WriteMaster() {
  const MutexLock one_at_a_time(impl_->master_mutex);
  ETUDE_RETURN_IF_ERROR(impl_->CountTheUncounted());
  ETUDE_RETURN_IF_ERROR(impl_->WriteLinks());
  return impl_->WriteStatistics();
}

Status DatasetWriter::WriteProgress() {
  const MutexLock one_at_a_time(impl_->master_mutex);
  ETUDE_RETURN_IF_ERROR(impl_->CountTheUncounted());
  const std::uint64_t episodes = [&] {
    const MutexLock lock(impl_->mutex);
    return impl_->entries.size();
  }();
  if (internal::MasterIsDue(episodes, impl_->in_master)) {
    ETUDE_RETURN_IF_ERROR(impl_->WriteLinks());
  }
  return impl_->WriteStatistics();
}

Status DatasetWriter::WriteFilterKey(const std::string& name, const std::set<std::uint64_t>& indices) {
  {
    const MutexLock one_at_a_time(impl_->master_mutex);
    ETUDE_RETURN_IF_ERROR(internal::SetFilterKey(impl_->dataset, impl_->spec, name, indices,
                                                 [this](std::uint64_t index) { return Contains(index); }));
  }
  return WriteMaster();
}

}  // namespace etude::store
