// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <functional>
#include <mutex>
#include <thread>

#include "services/core/cores.h"
#include "services/core/free_name.h"
#include "services/core/hash.h"
#include "services/core/stop.h"
#include "services/core/without_throwing.h"
#include "services/episode/codec.h"
#include "services/spec/episode_plan.h"
#include "services/store/commit_file.h"
#include "services/store/dataset.h"
#include "services/store/edit.h"
#include "services/store/episode_file.h"
#include "services/store/layout.h"
#include "services/store/sampling_journal.h"
#include "services/store/summary.h"

namespace etude::store {
namespace {

// Calls work(i) for all i < n on as many threads as the machine has; order is free.
// @error kExhausted: a stop was requested before all were done; what a thread throws, such as that memory is out
Status ForEach(std::size_t n, const char* what, const std::function<void(std::size_t)>& work) {
  std::atomic<std::size_t> next{0}, done{0};
  std::mutex mutex;
  Status thrown;
  const auto run = [&] {
    const Status well = WithoutThrowing([&]() -> Status {
      for (std::size_t i = next++; i < n && !StopRequested(); i = next++, ++done) work(i);
      return {};
    });
    const std::lock_guard lock(mutex);
    if (!well) thrown = well;
  };
  const std::size_t threads = std::min<std::size_t>({static_cast<std::size_t>(Cores()), 8, n});
  std::vector<std::jthread> pool;
  for (std::size_t t = 1; t < threads; ++t)  // the system may have no more of them: those that are there do all
    if (!WithoutThrowing([&]() -> Status { return pool.emplace_back(run), Status(); })) break;
  run();
  pool.clear();
  if (!thrown) return Fail(thrown.error().Wrap(fmt::format("{}, after {} of {} files", what, done.load(), n)));
  if (done == n) return {};
  return Fail(Code::kExhausted,
              fmt::format("{}: stopped after {} of {} files; nothing was changed", what, done.load(), n));
}

// @error what is wrong with the file of episode `index`
Status VerifyEpisode(const DatasetReader& reader, const SamplingJournal& journal, std::uint64_t index) {
  const Path path = EpisodePath(reader.path(), index);
  ETUDE_ASSIGN_OR_RETURN(const auto bytes, ReadBinaryFile(path, internal::kMaxEpisodeFile));
  ETUDE_ASSIGN_OR_RETURN(const auto file, internal::DecodeEpisodeFile(bytes));
  const Episode& episode = file.episode;
  const StreamSpans streams = internal::StreamsIn(file, bytes);
  if (episode.index != index) return Fail(Code::kCorrupt, fmt::format("it holds episode {}", episode.index));
  if (episode.spec_sha256 != reader.spec_sha256())
    return Fail(Code::kCorrupt, "made from another spec than the dataset");
  // the episode may be good, and the file that tells so has not come along
  if (!WeightsOf(episode.details).empty() && journal.entries().empty())
    return Fail(Code::kNotFound,
                fmt::format("made with sampling weights, and the dataset has no {}: put back the one that it came with",
                            internal::kSampling));
  if (WeightsOf(episode.details) != WeightsSha256(journal.At(index)))
    return Fail(Code::kCorrupt,
                fmt::format("made with other sampling weights than {} has for it", internal::kSampling));
  // of a schema that is converted the seal alone speaks: it covers every byte
  if (!file.converted() && EpisodeSha256(episode, streams) != file.content_sha256)
    return Fail(Code::kCorrupt, "content and its SHA-256 differ");
  return internal::CheckStreams(episode, streams);
}

// An older schema's hash is the one its writer computed (the seal says that it is): reading converts the content.
Result<std::string> ContentHashOf(const DatasetReader& reader, std::uint64_t index) {
  const Path path = EpisodePath(reader.path(), index);
  ETUDE_ASSIGN_OR_RETURN(const auto bytes, ReadBinaryFile(path, internal::kMaxEpisodeFile));
  const auto file = internal::DecodeEpisodeFile(bytes);
  if (!file) return Fail(file.error().Wrap(fmt::format("read '{}'", path.string())));
  if (file->converted()) return file->content_sha256;
  return EpisodeSha256(file->episode, internal::StreamsIn(*file, bytes));
}

// episodes/ may be a link to another disk, across which nothing can be renamed.
Status MoveAcross(const Path& file, const Path& to) {
  std::error_code error, ignored;
  std::filesystem::copy_file(file, to, error);
  Status copied = error ? Status(Fail(ErrnoError("copy", file, error.value()))) : SyncFile(to);
  if (copied) copied = SyncFolder(to.parent_path());  // before the only other one goes
  if (!copied) {
    std::filesystem::remove(to, ignored);
    return copied;
  }
  std::filesystem::remove(file, error);
  if (error) return Fail(ErrnoError("delete", file, error.value()));
  return {};
}

// quarantine/000123.hdf5, or the first of 000123.hdf5.1, .2, ... that is free
Status MoveToQuarantine(const Path& dataset, const Path& file) {
  const Path folder = dataset / internal::kQuarantine;
  ETUDE_RETURN_IF_ERROR(MakeFolders(folder));
  const std::string name = file.filename().string();
  const Path to = FirstFree([&](int n) { return folder / (n == 0 ? name : fmt::format("{}.{}", name, n)); }, 0);
  std::error_code error;
  std::filesystem::rename(file, to, error);
  if (error == std::errc::cross_device_link)
    ETUDE_RETURN_IF_ERROR(MoveAcross(file, to));
  else if (error)
    return Fail(ErrnoError("quarantine", file, error.value()));
  ETUDE_RETURN_IF_ERROR(SyncFolder(folder));
  ETUDE_RETURN_IF_ERROR(SyncFolder(file.parent_path()));
  return SyncFolder(dataset);
}

Status CheckFile(const DatasetReader& reader, const SamplingJournal& journal, const Path& path) {
  const auto index = internal::IndexOf(path);
  if (!index) return Fail(Code::kCorrupt, "not an episode's name");
  return VerifyEpisode(reader, journal, *index);
}

// Whether the statistics, which are written behind the master file, are of another number of episodes than are there.
Result<bool> CountsOtherEpisodes(const DatasetReader& reader) {
  ETUDE_ASSIGN_OR_RETURN(const auto description, internal::ReadDatasetFile(reader.path()));
  ETUDE_ASSIGN_OR_RETURN(const auto indices, reader.List());
  const auto& statistics = description.statistics;
  return !statistics.is_object() || !statistics.contains("episodes") || statistics["episodes"] != indices.size();
}

}  // namespace

Result<VerifyReport> Verify(const Path& dataset, Quarantine quarantine) {
  ETUDE_ASSIGN_OR_RETURN(const auto reader, DatasetReader::Open(dataset));
  ETUDE_ASSIGN_OR_RETURN(const auto journal, SamplingJournal::Open(dataset, reader.spec()));
  std::optional<FileLock> lock;  // moving files away under a writer would confuse it
  if (quarantine == Quarantine::kYes) {
    auto taken = internal::LockDataset(dataset);
    if (!taken) {
      Error refused = std::move(taken).error();
      refused.message += "; --keep only reports and needs no lock";
      return Fail(std::move(refused));
    }
    lock = std::move(*taken);
    ETUDE_RETURN_IF_ERROR(internal::FinishDeletion(dataset));
  }
  ETUDE_ASSIGN_OR_RETURN(auto files, internal::ListEpisodeFolder(dataset));
  // hidden ones are of those who copy, of network file systems and of desktops: nobody takes them for episodes
  std::erase_if(files, [](const Path& path) {
    return path.extension() == internal::kTemporarySuffix || path.filename().string().starts_with('.');
  });

  std::vector<Status> found(files.size());
  ETUDE_RETURN_IF_ERROR(
      ForEach(files.size(), "verify", [&](std::size_t i) { found[i] = CheckFile(reader, journal, files[i]); }));
  VerifyReport report;
  for (std::size_t i = 0; i < files.size(); ++i) {
    if (found[i]) {
      ++report.good;
      continue;
    }
    // what cannot be read now (a full table of open files, a disk that comes back) may be whole
    const bool wrong = found[i].error().code == Code::kCorrupt;
    (wrong ? report.bad : report.unread).push_back({files[i], found[i].error().message});
    if (wrong && quarantine == Quarantine::kYes && report.moved) report.moved = MoveToQuarantine(dataset, files[i]);
  }
  // the master file must not link what was moved away, now or by a verification that ended before it came to this
  if (quarantine == Quarantine::kYes) {
    const auto behind = CountsOtherEpisodes(reader);
    if (!behind)
      report.refreshed = Fail(behind.error());  // and the report is not lost with it
    else if (*behind || !report.bad.empty())
      report.refreshed = internal::RefreshDerived(dataset);
  }
  return report;
}

Result<std::string> HashDataset(const Path& dataset) {
  ETUDE_ASSIGN_OR_RETURN(const auto reader, DatasetReader::Open(dataset));
  ETUDE_ASSIGN_OR_RETURN(const auto journal, SamplingJournal::Open(dataset, reader.spec()));
  ETUDE_ASSIGN_OR_RETURN(const auto indices, reader.List());
  std::vector<Result<std::string>> hashes(indices.size());
  ETUDE_RETURN_IF_ERROR(
      ForEach(indices.size(), "hash", [&](std::size_t i) { hashes[i] = ContentHashOf(reader, indices[i]); }));
  Sha256 hash;
  for (std::size_t i = 0; i < indices.size(); ++i) {
    if (!hashes[i]) return Fail(hashes[i].error());
    hash.Update(fmt::format("{} {}\n", indices[i], *hashes[i]));
  }
  for (const SamplingEntry& entry : journal.entries())
    hash.Update(fmt::format("from {} {}\n", entry.from_index, WeightsSha256(entry.weights)));
  return ToHex(hash.Finish());
}

Result<OrderedJson> DatasetInfo(const Path& dataset) {
  ETUDE_ASSIGN_OR_RETURN(const auto reader, DatasetReader::Open(dataset));
  ETUDE_ASSIGN_OR_RETURN(const auto indices, reader.List());
  ETUDE_ASSIGN_OR_RETURN(const auto journal, SamplingJournal::Open(dataset, reader.spec()));
  std::map<std::uint64_t, internal::EpisodeSummary> summaries;
  OrderedJson unreadable = OrderedJson::array();
  OrderedJson features = OrderedJson::array();
  for (const std::uint64_t index : indices) {
    ETUDE_RETURN_IF_ERROR(internal::CheckNotStopped(dataset));
    const auto record = reader.Read(index);
    if (!record) {
      unreadable.push_back(record.error().message);
      continue;
    }
    summaries[index] = internal::Summarize(*record);
    if (features.empty()) features = internal::FeatureTable(record->episode);
  }
  OrderedJson info{{"schema_version", reader.schema_version()},
                   {"name", reader.spec().name},
                   {"spec_sha256", reader.spec_sha256()},
                   {"wanted_episodes", reader.spec().episodes},
                   {"statistics", internal::StatisticsOf(reader.spec(), summaries)},
                   {"failed_attempts", internal::FailuresByOutcome(dataset)},
                   {"unreadable", std::move(unreadable)},
                   {"features", std::move(features)}};
  if (!journal.entries().empty()) info["sampling"] = ToJson(journal.entries());
  return info;
}

}  // namespace etude::store
