// SPDX-License-Identifier: Apache-2.0
// What kinds share that ask one number of one object. Internal to this folder.
#pragma once

#include <fmt/format.h>

#include <functional>
#include <string>
#include <utility>

#include "worker/task/predicates/kind.h"

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

/// A kind of them that needs no other argument than its object and its bound.
inline PredicateKind LessThanKind(std::string name, std::string says, const std::string& object,
                                  PredicateParameter bound, LessThan::Measure measure, const char* words) {
  const std::string least = bound.name;
  return {.name = std::move(name),
          .says = std::move(says),
          .parameters = {ObjectParameter("object", "target", object), std::move(bound)},
          .make = [=](PredicateArguments& arguments) -> std::unique_ptr<Predicate> {
            return std::make_unique<LessThan>(arguments.object("object"), measure, arguments.number(least), words);
          }};
}

}  // namespace etude::task
