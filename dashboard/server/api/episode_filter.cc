// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/api/episode_filter.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>

namespace etude::api {
namespace {

bool Listed(const std::vector<std::string>& wanted, const std::string& value) {
  return wanted.empty() || std::ranges::find(wanted, value) != wanted.end();
}

// "a..b", "a..", "..b"
Result<Span> SpanFrom(const http::Query& query, const char* key) {
  const auto text = query.Get(key);
  if (!text || text->empty()) return Span{};
  const auto dots = text->find("..");
  Span span;
  span.set = true;
  bool good = dots != std::string::npos;
  const auto bound = [&](const std::string& part, double& value) {
    if (part.empty()) return;
    const auto number = sources::ParseTime(part);
    good = good && number.has_value();
    value = number.value_or(0);
  };
  if (good) bound(text->substr(0, dots), span.low);
  if (good) bound(text->substr(dots + 2), span.high);
  if (good) return span;
  return Fail(Code::kInvalidArgument,
              fmt::format("{}={:.40}: not a span, such as 100..200, 100.. or ..200", key, *text));
}

}  // namespace

std::vector<std::string> WordsOf(const std::string& text) {
  std::vector<std::string> words;
  std::string word;
  for (const char c : text + " ") {
    const auto byte = static_cast<unsigned char>(c);
    if (std::isalnum(byte) || byte >= 0x80 || c == '\'') {
      word += static_cast<char>(byte < 0x80 ? std::tolower(byte) : byte);
    } else if (!word.empty()) {
      words.push_back(std::move(word));
      word.clear();
    }
  }
  return words;
}

Result<EpisodeFilter> EpisodeFilter::From(const http::Query& query, const sources::DatasetSource& dataset) {
  EpisodeFilter filter;
  filter.tasks_ = query.All("task");
  filter.targets_ = query.All("target");
  filter.references_ = query.All("reference");
  filter.robots_ = query.All("robot");
  filter.outcomes_ = query.All("outcome");
  filter.splits_ = query.All("split");
  filter.workers_ = query.All("worker");
  filter.words_ = WordsOf(query.Get("words").value_or(""));
  ETUDE_ASSIGN_OR_RETURN(filter.steps_, SpanFrom(query, "steps"));
  ETUDE_ASSIGN_OR_RETURN(filter.odd_, SpanFrom(query, "odd"));
  ETUDE_ASSIGN_OR_RETURN(filter.t_, SpanFrom(query, "t"));
  for (const auto& key : query.All("key")) {
    filter.by_key_ = true;
    if (key == "train" || key == "valid" || key == "test") {
      filter.split_keys_.insert(key);
      continue;
    }
    ETUDE_ASSIGN_OR_RETURN(const auto episodes, dataset.EpisodesOfKey(key));
    filter.of_keys_.insert(episodes.begin(), episodes.end());
  }
  filter.empty_ = filter.tasks_.empty() && filter.targets_.empty() && filter.references_.empty() &&
                  filter.robots_.empty() && filter.outcomes_.empty() && filter.splits_.empty() &&
                  filter.workers_.empty() && filter.words_.empty() && !filter.by_key_ && !filter.steps_.set &&
                  !filter.odd_.set && !filter.t_.set;
  return filter;
}

bool EpisodeFilter::Holds(const sources::EpisodeRow& row) const {
  if (empty_) return true;
  if (!Listed(tasks_, row.task) || !Listed(targets_, row.target) || !Listed(references_, row.reference) ||
      !Listed(robots_, row.robot) || !Listed(outcomes_, row.outcome) || !Listed(splits_, row.split) ||
      !Listed(workers_, row.worker))
    return false;
  if (by_key_ && !split_keys_.contains(row.split) && !of_keys_.contains(row.index)) return false;
  // what is not known yet is in no span
  if (steps_.set && (!row.known || !steps_.Holds(static_cast<double>(row.steps)))) return false;
  if (odd_.set && (!row.odd || !odd_.Holds(*row.odd))) return false;
  if (t_.set && (!row.t || !t_.Holds(*row.t))) return false;
  if (words_.empty()) return true;
  const auto words = WordsOf(row.instruction);
  return std::ranges::all_of(words_, [&](const auto& word) { return std::ranges::find(words, word) != words.end(); });
}

}  // namespace etude::api
