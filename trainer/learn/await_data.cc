// SPDX-License-Identifier: Apache-2.0
#include "trainer/learn/await_data.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <set>

#include "services/core/clock.h"
#include "services/core/log.h"
#include "services/core/stop.h"

namespace etude::learn {
namespace {

using data::Split;

std::size_t Planned(const CampaignSpec& spec, const char* split) {
  std::size_t count = 0;
  for (std::uint64_t i = 0; i < spec.episodes; ++i) count += SplitOf(spec, i) == split;
  return count;
}

std::size_t Planned(const data::Dataset& dataset, const char* split) {
  std::size_t count = 0;
  for (std::size_t folder = 0; folder < dataset.folders(); ++folder) count += Planned(dataset.spec(folder), split);
  return count;
}

// Training episodes to begin with, of a dataset or of one folder's spec.
template <class Plan>
std::size_t Wanted(const TrainConfig& config, const Plan& plan) {
  return std::min(static_cast<std::size_t>(config.data.min_episodes), Planned(plan, "train"));
}

// what training needs, and what is there of it
struct Need {
  std::size_t train = 1, valid = 1;
  std::set<std::string> tasks;
  // of several: each, so that what comes of it later has been looked at, and is validated on
  struct Folder {
    std::string path;
    std::size_t train = 0;  // of its own that it is patient for; 0: it need have nothing to validate on
  };
  std::vector<Folder> folders;

  static Need Of(const data::Dataset& dataset, const TrainConfig& config, bool follow) {
    Need need;
    for (std::size_t folder = 0; folder < dataset.folders() && dataset.folders() > 1; ++folder) {
      const auto& spec = dataset.spec(folder);
      const bool validates = follow && Planned(spec, "valid") > 0;
      need.folders.push_back({dataset.path(folder).string(), validates ? 2 * Wanted(config, spec) : 0});
    }
    if (!follow) return need;
    need.train = Wanted(config, dataset);
    need.valid = std::min(static_cast<std::size_t>(config.data.min_valid), Planned(dataset, "valid"));
    // of few episodes not every task need be in the training split
    const auto& all = dataset.tasks();
    if (need.train >= 4 * all.size()) need.tasks.insert(all.begin(), all.end());
    return need;
  }
  // "" when it is met
  std::string Missing(const data::Snapshot& snapshot) const {
    std::vector<std::string> missing;
    const auto count = [&](const char* what, std::size_t there, std::size_t wanted) {
      if (there < wanted) missing.push_back(fmt::format("{} of {} {} episodes", there, wanted, what));
    };
    for (std::uint32_t folder = 0; folder < folders.size(); ++folder) {
      const auto of = [&](Split split) {
        return static_cast<std::size_t>(std::ranges::count_if(
            snapshot.episodes(), [&](const auto& entry) { return entry->folder == folder && entry->split == split; }));
      };
      const auto& [path, patient] = folders[folder];
      if (std::ranges::none_of(snapshot.episodes(), [&](const auto& entry) { return entry->folder == folder; }))
        missing.push_back(fmt::format("no episode of '{}'", path));
      else if (of(Split::kValid) == 0 && of(Split::kTrain) < patient)
        missing.push_back(fmt::format("no validation episode of '{}'", path));
    }
    count("training", snapshot.episode_count(Split::kTrain), train);
    count("validation", snapshot.episode_count(Split::kValid), valid);
    // a task that never comes about (no scene of it works) keeps nobody waiting for ever
    const bool patient = snapshot.episode_count(Split::kTrain) < 2 * train;
    for (const auto& task : tasks)
      if (patient && !snapshot.frames(Split::kTrain).contains(task)) missing.push_back("none of task " + task);
    for (const auto& [split, name] : {std::pair(Split::kTrain, "training"), std::pair(Split::kValid, "validation")})
      if (missing.empty() && snapshot.frame_count(split) == 0) missing.push_back(fmt::format("no {} frame", name));
    return fmt::format("{}", fmt::join(missing, ", "));
  }
};

tl::unexpected<Error> NothingToTrainOn(const data::Dataset& dataset, const data::Snapshot& snapshot,
                                       const std::string& missing) {
  return Fail(Code::kNotFound,
              fmt::format("train on {}: {} usable training and {} validation frames in {} "
                          "episodes{}; collect more, or, while they are collected, give --follow to wait for them",
                          dataset.text(), snapshot.frame_count(Split::kTrain), snapshot.frame_count(Split::kValid),
                          snapshot.episodes().size(), dataset.folders() > 1 ? " (" + missing + ")" : ""));
}

}  // namespace

namespace {

// Of what is there, a snapshot says it; what is to come is known from the campaign alone.
Status CheckOneRobot(const data::Dataset& dataset) {
  for (std::size_t folder = 0; folder < dataset.folders(); ++folder)
    if (const auto& robots = dataset.spec(folder).robots; robots.size() > 1)
      return Fail(Code::kInvalidArgument,
                  fmt::format("train on '{}' while it grows: its campaign has the robots {}, and a policy drives one: "
                              "collect a dataset for each",
                              dataset.path(folder).string(), fmt::join(robots, ", ")));
  return {};
}

}  // namespace

Status AwaitData(data::Dataset& dataset, const TrainConfig& config, const AwaitOptions& options) {
  if (options.follow) ETUDE_RETURN_IF_ERROR(CheckOneRobot(dataset));
  if (options.follow)
    for (const char* split : {"train", "valid"})
      if (Planned(dataset, split) == 0)
        return Fail(
            Code::kInvalidArgument,
            fmt::format("train on {} while it grows: its campaign plans no episode of split '{}' (split, episodes): "
                        "training needs both train and valid",
                        dataset.text(), split));
  const Need need = Need::Of(dataset, config, options.follow);
  std::string reported;
  auto last_change = MonotonicClock::now();
  std::size_t seen = 0;
  while (true) {
    const bool over = options.over && options.over();  // before it is looked: what it left is then there
    ETUDE_ASSIGN_OR_RETURN([[maybe_unused]] const int added, dataset.Refresh());
    // a part of it may have been read: nothing is to be concluded from that
    if (StopRequested()) return Fail(Code::kUnavailable, fmt::format("stopped while {} was read", dataset.text()));
    const auto snapshot = dataset.snapshot();
    const std::string missing = need.Missing(*snapshot);
    if (missing.empty()) return {};
    if (!options.follow) return NothingToTrainOn(dataset, *snapshot, missing);
    if (options.source) ETUDE_RETURN_IF_ERROR(options.source());
    if (over) {
      // less than was wished for, but something of each
      if (options.alone && snapshot->frame_count(Split::kTrain) > 0 && snapshot->frame_count(Split::kValid) > 0) {
        Log().warn("training begins with what there is, since the collection has ended: there are {}", missing);
        return {};
      }
      return NothingToTrainOn(dataset, *snapshot, missing);
    }
    if (missing != reported) Log().info("waiting for data: there are {}", missing);
    if (snapshot->episodes().size() != seen) last_change = MonotonicClock::now();
    seen = snapshot->episodes().size();
    reported = missing;
    if (MonotonicClock::now() - last_change > options.patience)
      return Fail(Code::kExhausted,
                  fmt::format("train on {} while it grows: {}, and nothing new for {} s; is its collector running? "
                              "To train on what is there leave out --follow, or lower data.min_episodes",
                              dataset.text(), missing,
                              std::chrono::duration_cast<std::chrono::seconds>(options.patience).count()));
    if (WaitForStop(std::chrono::milliseconds(500)))
      return Fail(Code::kUnavailable, "stopped while waiting for the first episodes");
  }
}

Follower::Follower(std::shared_ptr<data::Dataset> dataset, double every_s)
    : dataset_(std::move(dataset)), every_(every_s), thread_([this] { Work(); }) {}

Follower::~Follower() {
  {
    const MutexLock lock(mutex_);
    stop_ = true;
  }
  wake_.NotifyAll();
  thread_.join();
}

void Follower::Work() {
  while (true) {
    {
      const MutexLock lock(mutex_);
      const auto until = MonotonicClock::now() + every_;
      while (!stop_ && MonotonicClock::now() < until) wake_.WaitFor(mutex_, until - MonotonicClock::now());
      if (stop_) return;
    }
    const auto added = dataset_->Refresh();
    if (!added) Log().warn("look for new episodes: {}", added.error().message);
  }
}

}  // namespace etude::learn
