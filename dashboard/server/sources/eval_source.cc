// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/sources/eval_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "services/episode/bounded_json.h"

namespace etude::sources {
namespace {

constexpr std::chrono::seconds kEvalRefreshEvery{1};
constexpr std::uint64_t kEvalJsonBytes = 64 << 20;
constexpr std::size_t kMostRollouts = 100'000;
constexpr std::size_t kMostVideos = 2'000;
constexpr std::size_t kMostVideoFiles = 100'000;  // of files in their folder

// rows of both, by index; a streamed one may be newer than the report
std::vector<OrderedJson> Merged(const OrderedJson& report, const std::vector<OrderedJson>& streamed) {
  std::map<std::uint64_t, const OrderedJson*> rows;
  const auto& listed = PartOf(report, "per_episode");
  const auto take = [&](const OrderedJson& row) {
    if (const auto index = UnsignedOf(row, "index"); index && rows.size() < kMostRollouts) rows[*index] = &row;
  };
  if (listed.is_array())
    for (const auto& row : listed) take(row);
  for (const auto& row : streamed) {
    const auto index = UnsignedOf(row, "index");
    if (index && !rows.contains(*index)) take(row);
  }
  std::vector<OrderedJson> merged;
  merged.reserve(rows.size());
  for (const auto& [index, row] : rows) merged.push_back(*row);
  return merged;
}

std::vector<std::string> VideosIn(const Path& folder) {
  std::vector<std::string> names;
  std::error_code error;
  std::filesystem::directory_iterator entries(folder, error), end;
  for (; !error && entries != end && names.size() < kMostVideoFiles; entries.increment(error)) {
    const std::string name = entries->path().filename().string();
    if (name.ends_with(".mp4") && !name.starts_with('.')) names.push_back(name);
  }
  std::ranges::sort(names);
  if (names.size() > kMostVideos) names.resize(kMostVideos);
  return names;
}

}  // namespace

Result<std::shared_ptr<const EvalView>> EvalSource::View() {
  MutexLock lock(mutex_);
  if (view_ && MonotonicClock::now() - refreshed_ < kEvalRefreshEvery) return view_;
  bool changed = !view_;
  if (const auto stamp = StampOf(found_.folder / "eval.json"); stamp != report_stamp_) {
    OrderedJson report = OrderedJson::object();
    if (stamp.exists()) {
      ETUDE_ASSIGN_OR_RETURN(const std::string text, ReadTextFile(found_.folder / "eval.json", kEvalJsonBytes));
      auto json = ParseBoundedJson(text);
      if (!json || !json->is_object())
        return Fail(Code::kCorrupt, fmt::format("read '{}': eval.json is not a report", found_.shown));
      report = std::move(*json);
    }
    now_.report = std::move(report);
    report_stamp_ = stamp;
    changed = true;
  }
  lines_.Refresh([&] { streamed_.clear(), changed = true; },
                 [&](const OrderedJson& row) {
                   changed = true;
                   if (streamed_.size() < kMostRollouts) streamed_.push_back(row);
                 });
  // before the first report, and for reports of earlier versions
  const Path spec_file = found_.folder / "rollouts" / "dataset.json";
  if (const auto stamp = StampOf(spec_file); stamp != spec_stamp_) {
    rollouts_spec_ = nullptr;
    if (const auto text = ReadTextFile(spec_file, kEvalJsonBytes))
      if (const auto json = ParseBoundedJson(*text)) rollouts_spec_ = PartOf(*json, "spec");
    spec_stamp_ = stamp;
    changed = true;
  }
  if (auto videos = VideosIn(found_.folder / "videos"); videos != now_.videos) {
    now_.videos = std::move(videos);
    changed = true;
  }
  refreshed_ = MonotonicClock::now();
  if (!changed) return view_;
  const OrderedJson& reported = PartOf(now_.report, "spec");
  now_.spec = reported.is_object() ? reported : rollouts_spec_;
  now_.rows = Merged(now_.report, streamed_);
  now_.updated = std::max(report_stamp_.modified_s(), lines_.stamp().modified_s());
  view_ = std::make_shared<const EvalView>(now_);
  return view_;
}

}  // namespace etude::sources
