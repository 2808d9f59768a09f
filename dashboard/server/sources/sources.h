// SPDX-License-Identifier: Apache-2.0
// The catalog with a reader for each thing that somebody asked for.
#pragma once

#include <algorithm>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "dashboard/server/sources/catalog.h"
#include "dashboard/server/sources/dataset_source.h"
#include "dashboard/server/sources/eval_source.h"
#include "dashboard/server/sources/identities.h"
#include "dashboard/server/sources/replays.h"
#include "dashboard/server/sources/run_source.h"

namespace etude::sources {

/// Thread-safe. Of each kind the readers that were used last are kept.
class Sources {
 public:
  /// @param replays  folder of attempts that were made again, which is never listed; empty: none are kept
  explicit Sources(std::vector<Path> roots, const Path& replays = {})
      : catalog_(std::move(roots), replays), replays_(replays) {}

  Catalog& catalog() { return catalog_; }
  Identities& identities() { return identities_; }
  const Replays& replays() const { return replays_; }
  /// One that was found, by its id or as NAME@ID on the bus, or a replay's ("replay.<key>"). @error kNotFound
  Result<std::shared_ptr<DatasetSource>> Dataset(const std::string& id) {
    const auto key = Replays::KeyIn(id);
    return Get(datasets_, key ? replays_.FindDataset(*key) : Find(Kind::kDataset, id));
  }
  Result<std::shared_ptr<RunSource>> Run(const std::string& id) { return Get(runs_, Find(Kind::kRun, id)); }
  Result<std::shared_ptr<EvalSource>> Eval(const std::string& id) {
    return Get(evals_, catalog_.Find(Kind::kEval, id));
  }

 private:
  // A page that began with a name on the bus goes on with it when the folder has come. No folder's id has an '@'.
  Result<Found> Find(Kind kind, const std::string& id) {
    const auto at = id.rfind('@');
    const std::string identity = at == std::string::npos ? "" : id.substr(at + 1);
    if (identity.empty()) return catalog_.Find(kind, id);
    const auto all = catalog_.List();
    for (const auto& item : *all)
      if (item.kind == kind && identities_.Of(item.folder) == identity) return item;
    return catalog_.Find(kind, id);
  }

  template <class Source>
  struct Cached {
    std::shared_ptr<Source> source;
    std::uint64_t used = 0;  // when, as a count
  };
  template <class Source>
  using Cache = std::map<std::string, Cached<Source>>;

  template <class Source>
  Result<std::shared_ptr<Source>> Get(Cache<Source>& cache, Result<Found> looked_up) {
    ETUDE_ASSIGN_OR_RETURN(Found found, std::move(looked_up));
    MutexLock lock(mutex_);
    auto& [source, used] = cache[found.id];
    used = ++uses_;
    if (!source || source->found().folder != found.folder) source = std::make_shared<Source>(std::move(found));
    const auto result = source;
    if (cache.size() > kMost)
      cache.erase(std::ranges::min_element(cache, {}, [](const auto& item) { return item.second.used; }));
    return result;
  }

  static constexpr std::size_t kMost = 256;  // more than pages and scrapes look at all the time
  Catalog catalog_;
  Identities identities_;
  const Replays replays_;
  Mutex mutex_;
  std::uint64_t uses_ ETUDE_GUARDED_BY(mutex_) = 0;
  Cache<DatasetSource> datasets_;
  Cache<RunSource> runs_;
  Cache<EvalSource> evals_;
};

}  // namespace etude::sources
