// SPDX-License-Identifier: Apache-2.0
// Choosing, copying, joining, linking and deleting episodes. Episodes are files that never change: a copy links them
// where the file system can, and every one keeps its index, its bytes and its seal, unless datasets of different specs
// are merged.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "services/core/output_folder.h"
#include "services/store/dataset.h"

namespace etude::store {

/// What to choose: an episode has to fit each list that is not empty (one of its entries), and every bound.
struct Selection {
  std::vector<std::string> tasks, targets, robots, outcomes, splits;
  std::vector<std::string> keys;    ///< names of filter keys: episodes of any of them
  std::set<std::uint64_t> indices;  ///< ticked ones
  std::optional<int> min_steps, max_steps;
};

/// Indices of the episodes that fit, ascending.
/// @error kNotFound: no dataset, a filter key that it lacks, an index that it lacks; kCorrupt, kUnavailable: an episode
/// that cannot be read (`etude dataset verify` sets damaged ones aside); kExhausted: a stop was requested
Result<std::vector<std::uint64_t>> Select(const Path& dataset, const Selection& selection);

/// Name of a part -> its episodes, ascending. Names are fit to be folders'.
using Groups = std::map<std::string, std::vector<std::uint64_t>>;

/// By robot | task | target | split | outcome.
/// @error kInvalidArgument: another word; as Select
Result<Groups> GroupEpisodes(const Path& dataset, const std::string& by);

struct PartShare {
  std::string name;
  double share = 0;  ///< > 0; relative to the sum of all
};
/// Deals the episodes at random, always the same for the same episodes: counts are the shares', rounded.
/// @error kInvalidArgument: no part, a name that is not plain or comes twice, a share that is not positive, shares that
/// are too large to be added up; kNotFound
Result<Groups> DealEpisodes(const Path& dataset, const std::vector<PartShare>& parts);

/// Called now and then.
using EditProgress = std::function<void(std::uint64_t done, std::uint64_t total)>;
/// Called with the new dataset's folder before it appears under its own name: what else belongs to it.
using EditFinish = std::function<Status(const Path& folder)>;

/// A dataset of some episodes of another, with its spec, its sampling journal and what attempts.jsonl and filter keys
/// say of them. OUT appears when all of it is durable; the source may grow meanwhile.
/// @error kInvalidArgument: OUT is there, no episode is chosen; as of the store and the disk
Status CopyEpisodes(const Path& dataset, const std::vector<std::uint64_t>& indices, const Path& out, Leftover leftover,
                    const EditProgress& progress = {}, const EditFinish& finish = {});

struct MergeReport {
  std::uint64_t episodes = 0;
  bool renumbered = false;  ///< the datasets are of different specs
};

/// One dataset of several. Of one spec: every episode as it is; one that several have must be the same there. Of
/// different specs: episodes are numbered anew in the order of `datasets`, are of a spec that names all their robots,
/// tasks and objects, and say where they come from (details.merged_from); whether one is for training follows its new
/// number. Filter keys come along, each of all that has a key of its name.
/// @param finish  called where the datasets are of one spec
/// @error kInvalidArgument: fewer than two, OUT is there, one index with two contents, other sampling journals of one
/// spec, pictures of other sizes or rates; as of the store and the disk
Result<MergeReport> MergeDatasets(const std::vector<Path>& datasets, const Path& out, Leftover leftover,
                                  const EditProgress& progress = {}, const EditFinish& finish = {});

struct LinkReport {
  std::uint64_t episodes = 0;
  std::uint64_t planned = 0;  ///< that the campaign has, of whichever dataset wants most
};

/// One dataset of the shards of one campaign, which nothing is copied for: its episodes are the same files under other
/// names (hard links), what is said of them (who made them, what failed, filter keys) comes along. Its hash is that of
/// the dataset that one collector would have made. OUT appears when all of it is durable; the shards may go on growing,
/// and may be deleted.
/// @error kInvalidArgument: fewer than two, OUT is there, another spec, name, split or sampling journal, an episode
/// that two of them have, one of an older schema or content, a shard that lies on another filesystem than OUT; as of
/// the store and the disk
Result<LinkReport> LinkDatasets(const std::vector<Path>& datasets, const Path& out, Leftover leftover,
                                const EditProgress& progress = {}, const EditFinish& finish = {});

/// Removes episodes for good. All of them or none, also where the machine dies meanwhile: a deletion that began is
/// ended by the next command that writes the dataset. A campaign that goes on in the folder makes them again.
/// @error kInvalidArgument: none given; kNotFound: one is not there, and nothing is deleted; kUnavailable: another
/// process writes the dataset, or the disk refuses
Status DeleteEpisodes(const Path& dataset, const std::vector<std::uint64_t>& indices);

/// Says in dataset.json that the dataset was made of others and that no campaign goes on with it ("derived": true): it
/// is whole with what is there, whatever its spec asks for. A collector that goes on in the folder takes it back. @pre
/// nobody else writes the dataset
Status MarkDerived(const Path& dataset);
/// Whether that is said of it. What cannot be read says nothing.
bool IsDerived(const Path& dataset);
/// Whether a collector that goes on in the folder makes again what is not there: not where the dataset was made of
/// others, or by a program or of files that are not those of now. What cannot be read says nothing.
bool CanBeMadeAgain(const Path& dataset);

namespace internal {

struct EpisodeSource {
  Path dataset;
  std::set<std::uint64_t> indices;
};
/// Makes a dataset of these episodes in a new folder, which is derived: description and journals of the first source,
/// what is said of the episodes of each. @pre the sources are of one spec and no two have the same index
Status FillDataset(const Path& to, const std::vector<EpisodeSource>& sources, const EditProgress& progress);

// The parts of it.
/// Description and sampling journal: what all of one spec have alike.
Status CopyDescription(const Path& from, const Path& to);
/// Lines of attempts.jsonl about the sources' episodes.
Status CopyAttempts(const std::vector<EpisodeSource>& sources, const Path& to);
/// Who made each of these episodes, and when, from the journals of their datasets.
Status CopyCommits(const std::vector<EpisodeSource>& sources, const Path& to);
/// What the sources' filter keys say of the episodes that come along.
Status CopyFilterKeys(const std::vector<EpisodeSource>& sources, const Path& to);
Status SyncEpisodeFolders(const Path& dataset);
/// The same file under another name; of a symbolic link, what it leads to. @returns errno, or 0
int HardLink(const Path& from, const Path& to);
/// @error kExhausted: a stop was requested, and nothing was written yet
Status CheckNotStopped(const Path& dataset);
/// @error kExhausted: a stop was requested, after `done` of `total` episodes were put into `to`
Status CheckNotStopped(std::uint64_t done, std::uint64_t total, const Path& to);
/// @error kInvalidArgument: datasets of one spec whose sampling journals differ; `command` is for the error's words
Status CheckOneJournal(const std::vector<Path>& datasets, std::string_view command);

/// Ends a deletion that was interrupted. @pre the dataset's lock is held
Status FinishDeletion(const Path& dataset);
/// Removes these from the dataset's filter keys. @pre the lock is held
Status ForgetEpisodes(const Path& dataset, const std::set<std::uint64_t>& indices);
/// Rewrites master file and statistics from the journal of commits, and from the episode files that it does not count,
/// whatever schema they have; what of those cannot be read is left out, and logged. @pre the lock is held, or the
/// folder is nobody else's
Status RefreshDerived(const Path& dataset);

}  // namespace internal

}  // namespace etude::store
