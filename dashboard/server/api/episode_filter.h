// SPDX-License-Identifier: Apache-2.0
// Which episodes of a dataset a request means.
#pragma once

#include <limits>
#include <set>
#include <string>
#include <vector>

#include "dashboard/server/http/message.h"
#include "dashboard/server/sources/dataset_source.h"

namespace etude::api {

struct Span {
  double low = -std::numeric_limits<double>::infinity();
  double high = std::numeric_limits<double>::infinity();
  bool set = false;
  bool Holds(double value) const { return value >= low && value <= high; }
};

/// Values of one key are alternatives, keys must all hold.
class EpisodeFilter {
 public:
  /// task, target, reference, robot, outcome, split, worker, key (each repeatable), words, steps=a..b, odd, t.
  /// @error kInvalidArgument: a span that is none; kNotFound: an unknown key
  static Result<EpisodeFilter> From(const http::Query& query, const sources::DatasetSource& dataset);

  bool Holds(const sources::EpisodeRow& row) const;
  bool empty() const { return empty_; }

 private:
  std::vector<std::string> tasks_, targets_, references_, robots_, outcomes_, splits_, workers_, words_;
  bool by_key_ = false, empty_ = true;
  std::set<std::uint64_t> of_keys_;
  std::set<std::string> split_keys_;
  Span steps_, odd_, t_;
};

/// Lower-case words of a sentence; what is no letter or digit parts them.
std::vector<std::string> WordsOf(const std::string& text);

}  // namespace etude::api
