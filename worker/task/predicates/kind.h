// SPDX-License-Identifier: Apache-2.0
// What a file of this folder defines: a kind of predicate, its parameters and how one is made. A kind NAME is the
// file NAME.cc with a function `PredicateKind kinds::NAME()`, and a word in the list of CMakeLists.txt, from which
// kinds.h with its declaration is made.
#pragma once

#include <functional>
#include <utility>

#include "worker/task/predicates/predicate.h"

namespace etude::task {

/// One parameter of a kind.
struct PredicateParameter {
  enum class Type {
    kNumber,   ///< a quantity of `unit`
    kWord,     ///< one of `words`, the first is the default
    kObject,   ///< one object: target | reference | a name
    kObjects,  ///< or several: others (every object but target and reference)
  };
  std::string name;
  Type type = Type::kNumber;
  std::string unit;                ///< kNumber: "m" | "rad" | "m/s" | "s"
  double value = 0;                ///< kNumber: the default
  double low = 0, high = 0;        ///< kNumber: the range, both ends allowed
  std::vector<std::string> words;  ///< kWord: those allowed; kObject(s): the default alone
  std::string says;                ///< meaning, one line
};

PredicateParameter NumberParameter(std::string name, std::string unit, double value, double low, double high,
                                   std::string says);
PredicateParameter WordParameter(std::string name, std::vector<std::string> words, std::string says);
PredicateParameter ObjectParameter(std::string name, std::string role, std::string says);
PredicateParameter ObjectsParameter(std::string name, std::string role, std::string says);

/// The parameters of one predicate, checked and with defaults filled in, roles replaced by names.
class PredicateArguments {
 public:
  double number(const std::string& name) const;
  const std::string& word(const std::string& name) const;
  const std::string& object(const std::string& name) const;
  const std::vector<std::string>& objects(const std::string& name) const;
  std::vector<std::unique_ptr<Predicate>>& children() { return children_; }

 private:
  friend Result<std::unique_ptr<Predicate>> MakePredicate(const PredicateSpec& spec, const Cast& cast);
  std::map<std::string, double> numbers_;
  std::map<std::string, std::vector<std::string>> names_;
  std::vector<std::unique_ptr<Predicate>> children_;
};

struct PredicateKind {
  std::string name;
  std::string says;  ///< meaning, one line
  std::vector<PredicateParameter> parameters;
  bool combines = false;  ///< has children and no parameters
  std::function<std::unique_ptr<Predicate>(PredicateArguments&)> make;
};

/// A kind whose predicates are made as P(arguments).
template <class P>
PredicateKind KindOf(std::string name, std::string says, std::vector<PredicateParameter> parameters) {
  return {.name = std::move(name),
          .says = std::move(says),
          .parameters = std::move(parameters),
          .make = [](PredicateArguments& arguments) { return std::make_unique<P>(arguments); }};
}

/// The same of one that has children.
template <class P>
PredicateKind CombinationOf(std::string name, std::string says) {
  PredicateKind kind = KindOf<P>(std::move(name), std::move(says), {});
  kind.combines = true;
  return kind;
}

/// All kinds, in order of name.
const std::vector<PredicateKind>& PredicateKinds();

}  // namespace etude::task
