// SPDX-License-Identifier: Apache-2.0
#include "services/language/senses.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>

namespace etude::language {
namespace {

// Those that are open, by folder: replicas of a policy, and one checkpoint after the other, read and hash it once.
Mutex open_mutex;
std::map<Path, std::weak_ptr<const Senses>> open_senses ETUDE_GUARDED_BY(open_mutex);

}  // namespace

Result<std::shared_ptr<const Senses>> Senses::Open(const std::string& sha256, const Path& folder) {
  const MutexLock lock(open_mutex);
  std::shared_ptr<const Senses> senses = open_senses[folder].lock();
  if (!senses) {
    ETUDE_ASSIGN_OR_RETURN(WordNet wordnet, WordNet::Open(folder));
    std::string content = wordnet.sha256();
    senses.reset(new Senses(std::move(wordnet), std::move(content)));
    open_senses[folder] = senses;
  }
  if (!sha256.empty() && senses->sha256() != sha256)
    return Fail(Code::kInvalidArgument,
                fmt::format("WordNet in '{}' has content {:.12}, trained with {:.12}: its words would mean something "
                            "else; install the same version of wordnet-base",
                            folder.string(), senses->sha256(), sha256));
  return senses;
}

Senses::Names Senses::Of(const std::string& previous, const std::string& word) const {
  const std::string pair = previous + " " + word;
  {
    const MutexLock lock(mutex_);
    if (const auto it = remembered_.find(pair); it != remembered_.end()) return it->second;
  }
  std::vector<std::string> names = wordnet_.Senses(word);
  if (!previous.empty())
    for (auto& name : wordnet_.Senses(pair))
      if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(std::move(name));
  auto found = std::make_shared<const std::vector<std::string>>(std::move(names));
  const MutexLock lock(mutex_);
  if (remembered_.size() >= kRemembered) remembered_.clear();
  return remembered_.emplace(pair, std::move(found)).first->second;
}

}  // namespace etude::language
