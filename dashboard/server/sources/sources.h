// SPDX-License-Identifier: Apache-2.0
// The catalog with a reader for each thing that somebody asked for.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "dashboard/server/sources/catalog.h"
#include "dashboard/server/sources/dataset_source.h"
#include "dashboard/server/sources/eval_source.h"
#include "dashboard/server/sources/run_source.h"

namespace etude::sources {

/// Thread-safe. Readers of what is no longer there are dropped.
class Sources {
 public:
  explicit Sources(std::vector<Path> roots) : catalog_(std::move(roots)) {}

  Catalog& catalog() { return catalog_; }
  /// @error kNotFound
  Result<std::shared_ptr<DatasetSource>> Dataset(const std::string& id) { return Get(datasets_, Kind::kDataset, id); }
  Result<std::shared_ptr<RunSource>> Run(const std::string& id) { return Get(runs_, Kind::kRun, id); }
  Result<std::shared_ptr<EvalSource>> Eval(const std::string& id) { return Get(evals_, Kind::kEval, id); }

 private:
  template <class Source>
  using Cache = std::map<std::string, std::shared_ptr<Source>>;

  template <class Source>
  Result<std::shared_ptr<Source>> Get(Cache<Source>& cache, Kind kind, const std::string& id) {
    ETUDE_ASSIGN_OR_RETURN(Found found, catalog_.Find(kind, id));
    MutexLock lock(mutex_);
    auto& source = cache[id];
    if (!source || source->found().folder != found.folder) source = std::make_shared<Source>(std::move(found));
    if (cache.size() > kMost) {
      for (auto it = cache.begin(); it != cache.end() && cache.size() > kMost;)
        it = it->first == id ? std::next(it) : cache.erase(it);
    }
    return cache[id];
  }

  static constexpr std::size_t kMost = 64;
  Catalog catalog_;
  Mutex mutex_;
  Cache<DatasetSource> datasets_;
  Cache<RunSource> runs_;
  Cache<EvalSource> evals_;
};

}  // namespace etude::sources
