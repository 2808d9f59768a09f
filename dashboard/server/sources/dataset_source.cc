// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/sources/dataset_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "services/core/identity.h"
#include "services/core/statistics.h"
#include "services/episode/bounded_json.h"
#include "services/spec/attempt_outcome.h"
#include "services/spec/episode_plan.h"
#include "services/store/filter_keys.h"

namespace etude::sources {
namespace {

constexpr std::chrono::milliseconds kRefreshEvery{500};
constexpr std::chrono::seconds kAgainAfter{10};  // for a file that could not be had
constexpr std::size_t kRecent = 4;               // episodes kept, 1 MB each
constexpr std::size_t kMostRows = 1'000'000;     // of a list
constexpr std::size_t kMostUnreadable = 20;      // named
constexpr std::uint64_t kJsonBytes = 16 << 20;
constexpr std::size_t kFewest = 8;  // episodes of a task, to call one of them odd

// When something last came to a folder of the episodes or went: a hundred of them hold a hundred thousand files.
std::vector<std::filesystem::file_time_type> FolderTimes(const Path& dataset) {
  const Path episodes = store::EpisodePath(dataset, 0).parent_path().parent_path();
  std::error_code error, ignored;
  std::vector<std::filesystem::file_time_type> times{std::filesystem::last_write_time(episodes, ignored)};
  for (std::filesystem::directory_iterator it(episodes, error), end; !error && it != end; it.increment(error))
    if (it->is_directory(ignored)) times.push_back(it->last_write_time(ignored));
  return times;
}

// What the journal leaves at 0 was not measured.
std::optional<double> Measured(double value) { return value > 0 ? std::optional(value) : std::nullopt; }

// What a line of the journal and an episode's file both say.
void TakeMade(const store::CommitRow& made, EpisodeRow& row) {
  row.known = true;
  const auto take = [](const std::string& text, std::string& into) {
    if (!text.empty()) into = text;
  };
  take(made.task, row.task);
  take(made.target, row.target);
  take(made.reference, row.reference);
  take(made.robot, row.robot);
  row.outcome = made.outcome.empty() ? "success" : made.outcome;
  row.instruction = made.instruction;
  row.attempt = made.attempt;
  row.steps = made.steps, row.frames = made.frames, row.bytes = made.bytes, row.draws = made.draws;
  row.path_m = Measured(made.path_m);
  row.jerk = Measured(made.jerk);
  row.joint_speed = Measured(made.joint_speed);
  row.place_m = made.place_m;
}

void TakeCommit(const store::CommitRow& made, EpisodeRow& row) {
  TakeMade(made, row);
  row.worker = made.facts.worker;
  row.host = made.facts.host;
  row.t = Measured(made.t);
  row.plan_s = Measured(made.facts.timings.plan_s);
  row.step_s = Measured(made.facts.timings.step_s);
  row.render_s = Measured(made.facts.timings.render_s);
  row.deflate_s = Measured(made.facts.timings.deflate_s);
}

void TakeEpisode(const store::EpisodeRecord& record, EpisodeRow& row) {
  const etude::Episode& episode = record.episode;
  std::uint64_t frames = 0;
  for (const auto& camera : record.frames) frames += camera.size();
  const FileStamp stamp = StampOf(record.path);
  TakeMade(store::RowOf(episode, frames, stamp.size), row);
  if (!row.t && stamp.exists()) row.t = stamp.modified_s();
}

AttemptRow FailureFrom(const OrderedJson& line) {
  AttemptRow row;
  row.index = UnsignedOf(line, "index").value_or(0);
  row.seed = UnsignedOf(line, "seed").value_or(0);
  row.attempt = static_cast<std::uint32_t>(UnsignedOf(line, "attempt").value_or(0));
  row.outcome = TextOf(line, "outcome");
  const auto& details = PartOf(line, "details");
  row.reason = TextOf(details, "reason");
  row.worker = TextOf(details, "worker");
  row.t = NumberOf(details, "t");
  row.stage = TextOf(details, "stage");
  // where it is only in the words, "approach: step 21: ..."
  if (const auto colon = row.reason.find(": "); row.stage.empty() && colon != std::string::npos && colon < 40)
    row.stage = row.reason.substr(0, colon);
  const auto& pair = PartOf(details, "pair");
  if (pair.is_string()) row.pair = pair.get<std::string>();
  if (pair.is_array() && pair.size() == 2 && pair[0].is_string() && pair[1].is_string())
    row.pair = pair[0].get<std::string>() + "–" + pair[1].get<std::string>();
  row.plan_s = NumberOf(details, "plan_s");
  row.step_s = NumberOf(details, "step_s");
  row.render_s = NumberOf(details, "render_s");
  row.deflate_s = NumberOf(details, "deflate_s");
  return row;
}

struct Measure {
  const char* name;
  std::optional<double> (*of)(const EpisodeRow&);
};

constexpr std::array<Measure, 4> kMeasures{
    {{"steps", [](const EpisodeRow& row) -> std::optional<double> { return static_cast<double>(row.steps); }},
     {"path_m", [](const EpisodeRow& row) { return row.path_m; }},
     {"jerk", [](const EpisodeRow& row) { return row.jerk; }},
     {"joint_speed", [](const EpisodeRow& row) { return row.joint_speed; }}}};

void MarkOdd(std::vector<EpisodeRow*>& rows, const Measure& measure) {
  std::vector<double> values;
  for (const auto* row : rows)
    if (const auto value = measure.of(*row)) values.push_back(*value);
  if (values.size() < kFewest) return;
  const double median = Quantile(values, 0.5);
  std::vector<double> deviations;
  for (const double value : values) deviations.push_back(std::abs(value - median));
  const double scale = 1.4826 * Quantile(std::move(deviations), 0.5);
  if (!(scale > 0)) return;
  for (auto* row : rows) {
    const auto value = measure.of(*row);
    if (!value) continue;
    const double z = std::abs(*value - median) / scale;
    if (row->odd && *row->odd >= z) continue;
    row->odd = z;
    row->odd_what = measure.name;
  }
}

}  // namespace

std::string SplitOrNone(const CampaignSpec& spec, std::uint64_t index) {
  const auto& [train, valid, test] = spec.split;
  return train >= 0 && valid >= 0 && test >= 0 && train + valid + test > 0 ? SplitOf(spec, index) : "";
}

void MarkOdd(std::vector<EpisodeRow>& rows) {
  std::map<std::string, std::vector<EpisodeRow*>> by_task;
  for (auto& row : rows)
    if (row.known) by_task[row.task].push_back(&row);
  for (auto& [task, of_task] : by_task)
    for (const auto& measure : kMeasures) MarkOdd(of_task, measure);
}

const EpisodeRow* DatasetView::Find(std::uint64_t index) const {
  const auto found = std::ranges::lower_bound(rows, index, {}, &EpisodeRow::index);
  return found == rows.end() || found->index != index ? nullptr : &*found;
}

std::set<std::uint64_t> DatasetView::UsedUp() const {
  const auto most = static_cast<std::size_t>(std::max(1, info.spec.max_attempts));
  std::map<std::uint64_t, std::set<std::uint32_t>> failed;
  std::set<std::uint64_t> used_up;
  for (const auto& row : failures) {
    const Retry retry = RetryOf(info.spec, row.outcome);
    if (retry == Retry::kSameAttempt || Find(row.index)) continue;  // that one is made again, whatever its number
    auto& attempts = failed[row.index];
    attempts.insert(row.attempt);
    if (retry == Retry::kNever || attempts.size() >= most) used_up.insert(row.index);
  }
  return used_up;
}

DatasetSource::DatasetSource(Found found, std::chrono::milliseconds settled)
    : found_(std::move(found)),
      settled_(settled),
      commits_(found_.folder),
      attempts_(found_.folder / "attempts.jsonl") {}

Status DatasetSource::ReadSpec() {
  const FileStamp stamp = StampOf(found_.folder / "dataset.json");
  const FileStamp sampling = StampOf(found_.folder / "sampling.jsonl");
  if (reader_ && stamp == spec_stamp_ && sampling == sampling_stamp_) return {};
  ETUDE_ASSIGN_OR_RETURN(auto reader, store::DatasetReader::Open(found_.folder));
  ETUDE_ASSIGN_OR_RETURN(const std::string text, ReadTextFile(found_.folder / "dataset.json", kJsonBytes));
  const auto json = ParseBoundedJson(text);
  if (!json) return Fail(Code::kCorrupt, fmt::format("read '{}': dataset.json is not JSON", found_.shown));
  info_.spec = reader.spec();
  info_.spec_json = PartOf(*json, "spec");
  info_.statistics = PartOf(*json, "statistics");
  info_.spec_sha256 = reader.spec_sha256();
  info_.schema_version = reader.schema_version();
  info_.content = static_cast<std::int64_t>(UnsignedOf(*json, "content").value_or(0));
  info_.derived = FlagOf(*json, "derived");
  if (const auto identity = ReadIdentity(found_.folder)) {
    if (identity->id != info_.identity) {  // it was made anew
      rows_.clear();
      told_.clear();
      commits_ = store::CommitTail(found_.folder);
    }
    info_.identity = identity->id;
    info_.since = identity->since;
  }
  // what follows from the spec is only worked out for one that makes sense here: its files may be elsewhere
  sampling_.reset();
  if (info_.spec.Validate())
    if (auto journal = store::SamplingJournal::Open(found_.folder, info_.spec)) sampling_.emplace(std::move(*journal));
  reader_.emplace(std::move(reader));
  spec_stamp_ = stamp;
  // what failed was perhaps drawn by weights that were not known yet
  if (sampling_stamp_ != sampling)
    for (AttemptRow& row : failures_) TakePlan(row);
  sampling_stamp_ = sampling;
  changed_ = true;
  return {};
}

EpisodeRow DatasetSource::RowFromSpec(std::uint64_t index) {
  EpisodeRow row;
  row.index = index;
  row.split = SplitOrNone(info_.spec, index);
  if (!sampling_) return row;
  const EpisodePlan plan = PlanEpisode(info_.spec, index, 0, sampling_->At(index));
  row.task = plan.task.text();
  row.target = plan.target, row.reference = plan.reference, row.robot = plan.scene.robot;
  return row;
}

void DatasetSource::TakePlan(AttemptRow& row) {
  const EpisodeRow about = RowFromSpec(row.index);
  row.task = about.task, row.target = about.target, row.robot = about.robot;
}

EpisodeRow DatasetSource::About(std::uint64_t index) {
  MutexLock lock(mutex_);
  if (const auto known = rows_.find(index); known != rows_.end()) return known->second;
  return RowFromSpec(index);
}

void DatasetSource::ReadCommits() {
  commits_stamp_ = StampOf(found_.folder / "commits.jsonl");
  info_.journal = commits_stamp_.exists();
  // one that cannot be read now is asked for again
  (void)commits_.Refresh([this]() ETUDE_REQUIRES(mutex_) { rows_.clear(), told_.clear(), changed_ = true; },
                         [this](const store::CommitRow& made) ETUDE_REQUIRES(mutex_) {
                           if (told_.size() >= kMostRows && !told_.contains(made.index)) return;
                           EpisodeRow row;
                           row.index = made.index;
                           row.split = SplitOrNone(info_.spec, row.index);
                           TakeCommit(made, row);
                           told_[row.index] = std::move(row);  // a later line takes the place of the earlier one
                           changed_ = true;
                         });
}

void DatasetSource::ReadFailures() {
  attempts_.Refresh([this] { failures_.clear(), changed_ = true; },
                    [this](const OrderedJson& line) {
                      if (!UnsignedOf(line, "index") || failures_.size() >= kMostRows) return;
                      AttemptRow row = FailureFrom(line);
                      if (row.outcome == kRecheckMismatch) return;  // the attempt itself had succeeded
                      TakePlan(row);
                      failures_.push_back(std::move(row));
                      changed_ = true;
                    });
}

// What the collector keeps for its next start (services/campaign/history.h).
void DatasetSource::ReadEnd() {
  const FileStamp stamp = StampOf(found_.folder / "collector.json");
  if (stamp == collector_stamp_) return;
  collector_stamp_ = stamp;
  const auto text = ReadTextFile(found_.folder / "collector.json", 1 << 20);
  const OrderedJson said = text ? ParseBoundedJson(*text).value_or(OrderedJson()) : OrderedJson();
  info_.stopped = TextOf(said, "ended") == "stopped";
  info_.shard = ParseShard(TextOf(said, "shard")).value_or(Shard());
  changed_ = true;
}

// The files decide what is committed: the journal may be behind, or of episodes that were set aside. Where another host
// writes it may be ahead of what a folder shows: what it told, once, is kept until then.
Status DatasetSource::ListEpisodes() {
  auto times = FolderTimes(found_.folder);
  const auto now = MonotonicClock::now();
  if (!changed_ && times == folder_times_ && now - folders_changed_ > settled_) return {};
  ETUDE_ASSIGN_OR_RETURN(const auto indices, reader_->List());
  if (times != folder_times_) folder_times_ = std::move(times), folders_changed_ = now;
  const std::size_t before = rows_.size();
  std::erase_if(rows_, [&](const auto& item) { return !std::ranges::binary_search(indices, item.first); });
  changed_ = changed_ || rows_.size() != before;
  for (const auto index : indices) {
    const bool listed = rows_.contains(index);
    if (!listed && rows_.size() >= kMostRows) continue;
    auto told = told_.extract(index);
    if (listed && told.empty()) continue;
    rows_.insert_or_assign(index, told.empty() ? RowFromSpec(index) : std::move(told.mapped()));
    changed_ = true;
  }
  return {};
}

// A file that was replaced or set aside since is no longer known to be damaged.
void DatasetSource::ForgetUnreadable() {
  const auto gone = std::erase_if(unreadable_stamps_, [this](const auto& item) {
    return StampOf(store::EpisodePath(found_.folder, item.first)) != item.second;
  });
  if (gone == 0) return;
  std::erase_if(info_.unreadable_files,
                [this](const auto& item) ETUDE_REQUIRES(mutex_) { return !unreadable_stamps_.contains(item.first); });
  // there is room for other names: those that have none are read again
  std::erase_if(unreadable_stamps_, [this](const auto& item) ETUDE_REQUIRES(mutex_) {
    return !info_.unreadable_files.contains(item.first);
  });
  info_.unreadable = unreadable_stamps_.size();
  changed_ = true;
}

Status DatasetSource::Refresh() {
  if (view_ && MonotonicClock::now() - refreshed_ < kRefreshEvery) return {};
  ETUDE_RETURN_IF_ERROR(ReadSpec());
  ReadCommits();
  ReadFailures();
  ReadEnd();
  ETUDE_RETURN_IF_ERROR(ListEpisodes());
  std::error_code error;
  info_.updated = std::max({spec_stamp_.modified_s(), commits_stamp_.modified_s(), attempts_.stamp().modified_s()});
  if (!rows_.empty()) {
    const auto newest = StampOf(store::EpisodePath(found_.folder, rows_.rbegin()->first));
    info_.updated = std::max(info_.updated, newest.modified_s());
  }
  ForgetUnreadable();
  refreshed_ = MonotonicClock::now();
  return {};
}

std::shared_ptr<const DatasetView> DatasetSource::Build() {
  auto view = std::make_shared<DatasetView>();
  view->info = info_;
  view->failures = failures_;
  view->rows.reserve(rows_.size());
  for (const auto& [index, row] : rows_) {
    view->rows.push_back(row);
    view->known += row.known ? 1 : 0;
  }
  MarkOdd(view->rows);
  return view;
}

Result<std::shared_ptr<const DatasetView>> DatasetSource::View() {
  MutexLock lock(mutex_);
  ETUDE_RETURN_IF_ERROR(Refresh());
  if (changed_ || !view_) view_ = Build();
  changed_ = false;
  return view_;
}

bool DatasetSource::ReadNext() {
  std::uint64_t index = 0;
  std::optional<store::DatasetReader> reader;
  {
    MutexLock lock(mutex_);
    if (!reader_) return false;
    const auto now = MonotonicClock::now();
    // newest first: that is what a list shows first
    const auto next = std::find_if(rows_.rbegin(), rows_.rend(), [&](const auto& item) ETUDE_REQUIRES(mutex_) {
      const auto again = again_at_.find(item.first);
      return !item.second.known && !unreadable_stamps_.contains(item.first) &&
             (again == again_at_.end() || again->second <= now);
    });
    if (next == rows_.rend()) return false;
    index = next->first;
    reader = *reader_;
  }
  const FileStamp stamp = StampOf(store::EpisodePath(found_.folder, index));
  const auto record = reader->Read(index);
  MutexLock lock(mutex_);
  changed_ = true;
  if (!record) {
    // the machine's trouble is not the file's: again in a while
    if (record.error().code == Code::kUnavailable) {
      again_at_[index] = MonotonicClock::now() + kAgainAfter;
      return true;
    }
    unreadable_stamps_[index] = stamp;
    if (info_.unreadable_files.size() < kMostUnreadable) info_.unreadable_files[index] = record.error().message;
    info_.unreadable = unreadable_stamps_.size();
    return true;
  }
  if (const auto row = rows_.find(index); row != rows_.end()) TakeEpisode(*record, row->second);
  return true;
}

Result<std::shared_ptr<const store::EpisodeRecord>> DatasetSource::Episode(std::uint64_t index) {
  std::optional<store::DatasetReader> reader;
  // of before it is read: a file that is replaced meanwhile is read again
  const FileStamp stamp = StampOf(store::EpisodePath(found_.folder, index));
  {
    MutexLock lock(mutex_);
    const auto found = std::ranges::find(recent_, index, &Recent::index);
    if (found != recent_.end() && found->stamp == stamp) {
      recent_.splice(recent_.begin(), recent_, found);
      return recent_.front().record;
    }
    if (found != recent_.end()) recent_.erase(found);
    ETUDE_RETURN_IF_ERROR(ReadSpec());
    reader = *reader_;
  }
  ETUDE_ASSIGN_OR_RETURN(auto record, reader->Read(index));
  auto shared = std::make_shared<const store::EpisodeRecord>(std::move(record));
  MutexLock lock(mutex_);
  recent_.push_front({index, stamp, shared});
  if (recent_.size() > kRecent) recent_.pop_back();
  return shared;
}

std::vector<std::string> DatasetSource::Keys() const {
  std::vector<std::string> names;
  // a file that is damaged has none: whoever asks for one of its keys is told why
  for (const auto& [name, episodes] : store::ReadFilterKeys(found_.folder).value_or(store::FilterKeys()))
    names.push_back(name);
  return names;
}

Result<std::set<std::uint64_t>> DatasetSource::EpisodesOfKey(const std::string& key) const {
  ETUDE_ASSIGN_OR_RETURN(auto keys, store::ReadFilterKeys(found_.folder));
  const auto found = keys.find(key);
  if (found == keys.end()) return Fail(Code::kNotFound, fmt::format("there is no filter key '{:.64}'", key));
  return std::move(found->second);
}

}  // namespace etude::sources
