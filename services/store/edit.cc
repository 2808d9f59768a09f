// SPDX-License-Identifier: Apache-2.0
#include "services/store/edit.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <fstream>

#include "services/core/log.h"
#include "services/core/stop.h"
#include "services/episode/bounded_json.h"
#include "services/store/attempts.h"
#include "services/store/commit_journal.h"
#include "services/store/filter_keys.h"
#include "services/store/layout.h"
#include "services/store/master_file.h"
#include "services/store/summary.h"

namespace etude::store {
namespace {

namespace fs = std::filesystem;

constexpr const char* kDeleting = "deleting.json";  // a deletion that has begun

bool Holds(const std::vector<std::string>& allowed, const std::string& value) {
  return allowed.empty() || std::find(allowed.begin(), allowed.end(), value) != allowed.end();
}

bool Fits(const Selection& selection, const CampaignSpec& spec, const Episode& episode) {
  return Holds(selection.tasks, episode.task) && Holds(selection.targets, episode.target) &&
         Holds(selection.robots, episode.robot) && Holds(selection.outcomes, episode.outcome) &&
         Holds(selection.splits, SplitOf(spec, episode.index)) && episode.steps() >= selection.min_steps.value_or(0) &&
         episode.steps() <= selection.max_steps.value_or(episode.steps());
}

// Whether only indices are asked for, so that no file has to be read.
bool NeedsEpisodes(const Selection& s) {
  return !(s.tasks.empty() && s.targets.empty() && s.robots.empty() && s.outcomes.empty() && s.splits.empty()) ||
         s.min_steps || s.max_steps;
}

bool IsFull(const Path& folder) {
  constexpr std::uintmax_t kLittle = 1 << 20;
  std::error_code error;
  const auto space = fs::space(folder, error);
  return !error && space.available < kLittle;
}

// @error kNotFound: it is not there; kUnavailable: it cannot be looked for
Status CheckHasEpisode(const Path& dataset, std::uint64_t index) {
  const Path file = EpisodePath(dataset, index);
  std::error_code error;
  if (fs::exists(file, error)) return {};
  if (error) return Fail(ErrnoError("look for", file, error.value()));
  return Fail(Code::kNotFound, fmt::format("dataset '{}' has no episode {}", dataset.string(), index));
}

// Episodes that filter keys and indices leave.
Result<std::vector<std::uint64_t>> Candidates(const DatasetReader& reader, const Selection& selection) {
  ETUDE_ASSIGN_OR_RETURN(auto indices, reader.List());
  if (!selection.keys.empty()) {
    ETUDE_ASSIGN_OR_RETURN(const FilterKeys keys, ReadFilterKeys(reader.path()));
    std::set<std::uint64_t> chosen;
    for (const auto& name : selection.keys) {
      const auto key = keys.find(name);
      if (key == keys.end())
        return Fail(Code::kNotFound, fmt::format("dataset '{}' has no filter key '{}'", reader.path().string(), name));
      chosen.insert(key->second.begin(), key->second.end());
    }
    std::erase_if(indices, [&](std::uint64_t index) { return !chosen.contains(index); });
  }
  if (selection.indices.empty()) return indices;
  for (const std::uint64_t index : selection.indices) ETUDE_RETURN_IF_ERROR(CheckHasEpisode(reader.path(), index));
  std::erase_if(indices, [&](std::uint64_t index) { return !selection.indices.contains(index); });
  return indices;
}

// The same file under another name where the file system can, else a copy.
Status LinkOrCopy(const Path& from, const Path& to) {
  ETUDE_RETURN_IF_ERROR(MakeFolders(to.parent_path()));
  if (internal::HardLink(from, to) == 0) return {};
  std::error_code error;
  fs::copy_file(from, to, error);
  if (error) return Fail(ErrnoError("copy", from, error.value()));
  return SyncFile(to);
}

// Lines of attempts.jsonl about these episodes.
Status CopyAttemptLines(const Path& from, const std::set<std::uint64_t>& indices, LineAppender& to) {
  Status copied;
  ForEachAttempt(from, [&](const AttemptLine& line) {
    if (copied && indices.contains(line.index)) copied = to.Append(line.text);
  });
  return copied;
}

// All else stays: schema, content and spec are those of the episodes.
Status SetInDescription(const Path& dataset, const char* key, OrderedJson value) {
  ETUDE_ASSIGN_OR_RETURN(const std::string text, ReadTextFile(dataset / internal::kDatasetJson));
  OrderedJson description = ParseBoundedJson(text).value_or(OrderedJson());
  if (!description.is_object())
    return Fail(Code::kCorrupt, fmt::format("read '{}': not a map", (dataset / internal::kDatasetJson).string()));
  description[key] = std::move(value);
  return WriteFileAtomically(dataset / internal::kDatasetJson, JsonText(description, 2) + "\n");
}

// @error kNotFound, kCorrupt: there is no dataset
Status CheckDataset(const Path& dataset) {
  ETUDE_ASSIGN_OR_RETURN(const auto reader, DatasetReader::Open(dataset));
  (void)reader;
  return {};
}

}  // namespace

Result<std::vector<std::uint64_t>> Select(const Path& dataset, const Selection& selection) {
  ETUDE_ASSIGN_OR_RETURN(const auto reader, DatasetReader::Open(dataset));
  ETUDE_ASSIGN_OR_RETURN(const auto candidates, Candidates(reader, selection));
  if (!NeedsEpisodes(selection)) return candidates;
  std::vector<std::uint64_t> fitting;
  for (const std::uint64_t index : candidates) {
    ETUDE_RETURN_IF_ERROR(internal::CheckNotStopped(dataset));
    ETUDE_ASSIGN_OR_RETURN(const auto record, reader.Read(index));
    if (Fits(selection, reader.spec(), record.episode)) fitting.push_back(index);
  }
  return fitting;
}

Status CopyEpisodes(const Path& dataset, const std::vector<std::uint64_t>& indices, const Path& out, Leftover leftover,
                    const EditProgress& progress, const EditFinish& finish) {
  if (Status there = CheckDataset(dataset); !there) return there;
  if (indices.empty())
    return Fail(Code::kInvalidArgument,
                fmt::format("no episode of '{}' is chosen: nothing to write to '{}'", dataset.string(), out.string()));
  ETUDE_ASSIGN_OR_RETURN(auto folder, OutputFolder::Create(out, leftover));
  ETUDE_RETURN_IF_ERROR(internal::FillDataset(folder.path(), {{dataset, {indices.begin(), indices.end()}}}, progress));
  if (finish) ETUDE_RETURN_IF_ERROR(finish(folder.path()));
  return folder.Commit();
}

Status DeleteEpisodes(const Path& dataset, const std::vector<std::uint64_t>& indices) {
  if (Status there = CheckDataset(dataset); !there) return there;
  if (indices.empty())
    return Fail(Code::kInvalidArgument, fmt::format("delete from '{}': no episode is chosen", dataset.string()));
  ETUDE_ASSIGN_OR_RETURN(const auto lock, internal::LockDataset(dataset));
  ETUDE_RETURN_IF_ERROR(internal::FinishDeletion(dataset));
  for (const std::uint64_t index : indices)
    if (Status there = CheckHasEpisode(dataset, index); !there)
      return Fail(there.error().Wrap("delete, and nothing was deleted"));
  ETUDE_RETURN_IF_ERROR(internal::CheckNotStopped(dataset));
  // from here on it will be done, by this process or by the next one
  const auto intend = [&] { return WriteFileAtomically(dataset / kDeleting, OrderedJson(indices).dump() + "\n"); };
  Status intended = intend();
  std::error_code error;
  // a full disk, on which one deletes, has no room to write that down: the first episode makes it, unless its bytes
  // have another name
  if (!intended && IsFull(dataset) && fs::hard_link_count(EpisodePath(dataset, indices.front()), error) == 1) {
    fs::remove(EpisodePath(dataset, indices.front()), error);
    if (!error) intended = intend();
  }
  ETUDE_RETURN_IF_ERROR(intended);
  return internal::FinishDeletion(dataset);
}

Status MarkDerived(const Path& dataset) { return SetInDescription(dataset, "derived", true); }

bool IsDerived(const Path& dataset) {
  const auto text = ReadTextFile(dataset / internal::kDatasetJson);
  const OrderedJson description = text ? ParseBoundedJson(*text).value_or(OrderedJson()) : OrderedJson();
  return description.is_object() && description.contains("derived") && description["derived"] == true;
}

bool CanBeMadeAgain(const Path& dataset) {
  const auto found = internal::ReadDatasetFile(dataset);
  return found && found->spec.mode == "demonstrate" && internal::WhyClosed(*found).empty() && !IsDerived(dataset);
}

namespace internal {

Status CopyDescription(const Path& from, const Path& to) {
  ETUDE_ASSIGN_OR_RETURN(const std::string description, ReadTextFile(from / kDatasetJson));
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(to / kDatasetJson, description));
  ETUDE_ASSIGN_OR_RETURN(const auto journal, ReadTextFileIfThere(from / kSampling));
  return journal ? WriteFileAtomically(to / kSampling, *journal) : Status();
}

Status CopyFilterKeys(const std::vector<EpisodeSource>& sources, const Path& to) {
  std::set<std::uint64_t> all;  // an episode that several have is copied from one, and marked in any
  for (const auto& source : sources) all.insert(source.indices.begin(), source.indices.end());
  FilterKeys joint;
  for (const auto& source : sources) {
    ETUDE_ASSIGN_OR_RETURN(const FilterKeys keys, ReadFilterKeys(source.dataset));
    for (const auto& [name, chosen] : keys)
      for (const std::uint64_t index : chosen)
        if (all.contains(index)) joint[name].insert(index);
  }
  return joint.empty() ? Status() : WriteFilterKeys(to, joint);
}

Status CopyAttempts(const std::vector<EpisodeSource>& sources, const Path& to) {
  ETUDE_ASSIGN_OR_RETURN(auto attempts, LineAppender::Open(to / kAttempts));
  for (const auto& source : sources) ETUDE_RETURN_IF_ERROR(CopyAttemptLines(source.dataset, source.indices, attempts));
  return attempts.Sync();
}

Status CopyCommits(const std::vector<EpisodeSource>& sources, const Path& to) {
  ETUDE_ASSIGN_OR_RETURN(auto lines, LineAppender::Open(to / kCommits));
  for (const auto& source : sources) {
    std::ifstream file(source.dataset / kCommits);
    for (std::string line; std::getline(file, line);) {
      if (file.eof()) break;  // without its end it may be torn
      const auto row = ParseCommitLine(line);
      if (row && source.indices.contains(row->index)) ETUDE_RETURN_IF_ERROR(lines.Append(line));
    }
  }
  return lines.Sync();
}

Status SyncEpisodeFolders(const Path& dataset) {
  ETUDE_ASSIGN_OR_RETURN(const auto files, ListEpisodeFolder(dataset));
  std::set<Path> folders;
  for (const auto& file : files) folders.insert(file.parent_path());
  for (const auto& folder : folders) ETUDE_RETURN_IF_ERROR(SyncFolder(folder));
  return {};
}

int HardLink(const Path& from, const Path& to) {
  return ::linkat(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), AT_SYMLINK_FOLLOW) == 0 ? 0 : errno;
}

Status CheckNotStopped(const Path& dataset) {
  if (!StopRequested()) return {};
  return Fail(Code::kExhausted, fmt::format("stopped; nothing of '{}' was changed or copied", dataset.string()));
}

Status CheckNotStopped(std::uint64_t done, std::uint64_t total, const Path& to) {
  if (!StopRequested()) return {};
  return Fail(Code::kExhausted,
              fmt::format("stopped after {} of {} episodes; what is there lies in '{}' (--restart begins anew)", done,
                          total, to.string()));
}

Status FillDataset(const Path& to, const std::vector<EpisodeSource>& sources, const EditProgress& progress) {
  ETUDE_RETURN_IF_ERROR(CopyDescription(sources.front().dataset, to));
  ETUDE_RETURN_IF_ERROR(MarkDerived(to));
  ETUDE_RETURN_IF_ERROR(CopyAttempts(sources, to));
  ETUDE_RETURN_IF_ERROR(CopyFilterKeys(sources, to));
  ETUDE_RETURN_IF_ERROR(CopyCommits(sources, to));
  std::uint64_t done = 0, total = 0;
  for (const auto& source : sources) total += source.indices.size();
  for (const auto& source : sources)
    for (const std::uint64_t index : source.indices) {
      ETUDE_RETURN_IF_ERROR(CheckNotStopped(done, total, to));
      ETUDE_RETURN_IF_ERROR(LinkOrCopy(EpisodePath(source.dataset, index), EpisodePath(to, index)));
      ++done;
      if (progress) progress(done, total);
    }
  ETUDE_RETURN_IF_ERROR(SyncEpisodeFolders(to));
  return RefreshDerived(to);
}

Status FinishDeletion(const Path& dataset) {
  const Path intent = dataset / kDeleting;
  ETUDE_ASSIGN_OR_RETURN(const auto text, ReadTextFileIfThere(intent, 64 << 20));
  if (!text) return {};
  const OrderedJson json = ParseBoundedJson(*text).value_or(OrderedJson());
  std::set<std::uint64_t> indices;
  if (json.is_array())
    for (const auto& index : json)
      if (index.is_number_unsigned()) indices.insert(index.get<std::uint64_t>());
  if (!json.is_array() || indices.size() != json.size())
    return Fail(Code::kCorrupt, fmt::format("read '{}': not a list of episodes; remove the file, and delete what you "
                                            "want deleted once more",
                                            intent.string()));
  ETUDE_RETURN_IF_ERROR(ForgetEpisodes(dataset, indices));
  std::set<Path> folders;
  for (const std::uint64_t index : indices) {
    const Path path = EpisodePath(dataset, index);
    std::error_code error;
    fs::remove(path, error);
    if (error) return Fail(ErrnoError("delete", path, error.value()));
    // also where an earlier try removed it: that may not be durable
    if (fs::exists(path.parent_path(), error)) folders.insert(path.parent_path());
  }
  for (const auto& folder : folders) ETUDE_RETURN_IF_ERROR(SyncFolder(folder));
  std::error_code error;
  Status refreshed = RefreshDerived(dataset);  // as long as the intent is there: a crash leaves no dead link behind
  // a full disk has no room for two master files, and the old one is of links that are dead by now
  if (!refreshed && refreshed.error().code == Code::kUnavailable && ListEpisodeFolder(dataset)) {
    fs::remove(dataset / kMasterFile, error);
    refreshed = RefreshDerived(dataset);
  }
  ETUDE_RETURN_IF_ERROR(refreshed);
  fs::remove(intent, error);
  if (error) return Fail(ErrnoError("delete", intent, error.value()));
  return SyncFolder(dataset);
}

Status RefreshDerived(const Path& dataset) {
  ETUDE_ASSIGN_OR_RETURN(const auto reader, DatasetReader::Open(dataset));
  ETUDE_ASSIGN_OR_RETURN(const auto files, ListEpisodeFolder(dataset));
  const auto sizes = SizesOf(files);
  std::map<std::uint64_t, EpisodeSummary> summaries;
  ForEachCommit(dataset, sizes, [&](const CommitRow& row) {
    if (row.counted) summaries[row.index] = SummaryOf(row);
  });
  for (const auto& [index, bytes] : sizes) {
    if (summaries.contains(index)) continue;
    if (const auto record = reader.Read(index))
      summaries[index] = Summarize(*record);
    else  // verify sets damaged ones aside
      Log().warn("left out of the master file: {}", record.error().message);
  }
  ETUDE_RETURN_IF_ERROR(WriteMasterFile(dataset, reader.spec(), reader.spec_sha256(), EntriesOf(summaries)));

  OrderedJson statistics = StatisticsOf(reader.spec(), summaries);
  statistics["failed_attempts"] = FailuresByOutcome(dataset);
  return SetInDescription(dataset, "statistics", std::move(statistics));
}

}  // namespace internal

}  // namespace etude::store
