// SPDX-License-Identifier: Apache-2.0
// What kinds share that ask one number of one object. Internal to this folder.
#pragma once

#include <fmt/format.h>

#include <functional>
#include <string>
#include <utility>

#include "worker/task/predicates/predicate.h"

namespace etude::task {

/// Holds while a measure of an object is less than a bound.
class LessThan final : public Predicate {
 public:
  using Measure = std::function<double(const ObjectState&)>;

  /// @param words  fmt's format of the object's name, the measure as it was seen last and the bound
  LessThan(std::string object, Measure measure, double bound, const char* words)
      : object_(std::move(object)), measure_(std::move(measure)), bound_(bound), words_(words) {}

  bool Observe(const Observation& now) override {
    seen_ = measure_(StateOf(now, object_));
    return seen_ < bound_;
  }
  std::string Words() const override { return fmt::format(fmt::runtime(words_), object_, seen_, bound_); }

 private:
  std::string object_;
  Measure measure_;
  double bound_;
  const char* words_;
  double seen_ = 0;
};

}  // namespace etude::task
