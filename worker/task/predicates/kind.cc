// SPDX-License-Identifier: Apache-2.0
#include "worker/task/predicates/kind.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "services/core/check.h"
#include "worker/task/predicates/kinds.h"

namespace etude::task {
namespace {

using Type = PredicateParameter::Type;

tl::unexpected<Error> Wrong(const PredicateSpec& spec, const std::string& what) {
  return Fail(Code::kInvalidArgument, fmt::format("predicate '{}': {}", spec.kind, what));
}

const PredicateKind* FindKind(const std::string& name) {
  const auto& kinds = PredicateKinds();
  const auto it = std::find_if(kinds.begin(), kinds.end(), [&](const auto& kind) { return kind.name == name; });
  return it == kinds.end() ? nullptr : &*it;
}

Status CheckNames(const PredicateSpec& spec, const PredicateKind& kind) {
  std::vector<std::string> known;
  for (const auto& parameter : kind.parameters) known.push_back(parameter.name);
  for (const auto& [name, value] : spec.parameters)
    if (std::find(known.begin(), known.end(), name) == known.end())
      return Wrong(spec, known.empty() ? fmt::format("it has no parameters, not '{}'", name) : NotKnown(name, known));
  if (kind.combines == spec.children.empty())
    return Wrong(spec, kind.combines ? "needs a list of predicates" : "takes parameters, not a list of predicates");
  return {};
}

Result<double> NumberOf(const PredicateSpec& spec, const PredicateParameter& parameter) {
  const auto it = spec.parameters.find(parameter.name);
  if (it == spec.parameters.end()) return parameter.value;
  const PredicateValue& value = it->second;
  if (value.is_word() || (!value.unit.empty() && value.unit != parameter.unit))
    return Wrong(spec, fmt::format("{}: a quantity in {}", parameter.name, parameter.unit));
  if (!(value.number >= parameter.low && value.number <= parameter.high))
    return Wrong(spec, fmt::format("{}: {} not in {}..{} {}", parameter.name, value.number, parameter.low,
                                   parameter.high, parameter.unit));
  return value.number;
}

Result<std::vector<std::string>> NamesOf(const PredicateSpec& spec, const PredicateParameter& parameter,
                                         const Cast& cast) {
  const auto it = spec.parameters.find(parameter.name);
  if (it != spec.parameters.end() && !it->second.is_word()) return Wrong(spec, parameter.name + ": a word");
  const std::string word = it == spec.parameters.end() ? parameter.words.front() : it->second.word;
  if (parameter.type == Type::kWord) {
    const auto& words = parameter.words;
    if (std::find(words.begin(), words.end(), word) == words.end())
      return Wrong(spec, parameter.name + ": " + NotKnown(word, words));
    return std::vector<std::string>{word};
  }
  if (word == "others" && parameter.type == Type::kObjects) {
    std::vector<std::string> others = cast.objects;
    std::erase_if(others, [&](const auto& name) { return name == cast.target || name == cast.reference; });
    return others;
  }
  const std::string& name = word == "target" ? cast.target : word == "reference" ? cast.reference : word;
  if (name.empty() || std::find(cast.objects.begin(), cast.objects.end(), name) == cast.objects.end())
    return Wrong(
        spec, fmt::format("{}: the scene has no '{}'; it has {}", parameter.name, word, fmt::join(cast.objects, ", ")));
  return std::vector<std::string>{name};
}

}  // namespace

PredicateParameter NumberParameter(std::string name, std::string unit, double value, double low, double high,
                                   std::string says) {
  return {.name = std::move(name),
          .type = Type::kNumber,
          .unit = std::move(unit),
          .value = value,
          .low = low,
          .high = high,
          .says = std::move(says)};
}

PredicateParameter WordParameter(std::string name, std::vector<std::string> words, std::string says) {
  return {.name = std::move(name), .type = Type::kWord, .words = std::move(words), .says = std::move(says)};
}

PredicateParameter ObjectParameter(std::string name, std::string role, std::string says) {
  return {.name = std::move(name), .type = Type::kObject, .words = {std::move(role)}, .says = std::move(says)};
}

PredicateParameter ObjectsParameter(std::string name, std::string role, std::string says) {
  return {.name = std::move(name), .type = Type::kObjects, .words = {std::move(role)}, .says = std::move(says)};
}

double PredicateArguments::number(const std::string& name) const { return numbers_.at(name); }
const std::string& PredicateArguments::word(const std::string& name) const { return names_.at(name).front(); }
const std::string& PredicateArguments::object(const std::string& name) const { return names_.at(name).front(); }
const std::vector<std::string>& PredicateArguments::objects(const std::string& name) const { return names_.at(name); }

const std::vector<PredicateKind>& PredicateKinds() {
  static const std::vector<PredicateKind> all_kinds = [] {
    std::vector<PredicateKind> list = kinds::List();
    std::ranges::sort(list, {}, &PredicateKind::name);
    return list;
  }();
  return all_kinds;
}

const ObjectState& StateOf(const Observation& now, const std::string& object) {
  const auto it = now.find(object);
  ETUDE_CHECK(it != now.end(), "object={}", object);
  return it->second;
}

Result<std::unique_ptr<Predicate>> MakePredicate(const PredicateSpec& spec, const Cast& cast) {
  const PredicateKind* kind = FindKind(spec.kind);
  if (kind == nullptr) {
    std::vector<std::string> known;
    for (const auto& other : PredicateKinds()) known.push_back(other.name);
    return Fail(Code::kInvalidArgument, "predicate " + NotKnown(spec.kind, known));
  }
  ETUDE_RETURN_IF_ERROR(CheckNames(spec, *kind));
  PredicateArguments arguments;
  for (const auto& parameter : kind->parameters) {
    if (parameter.type == Type::kNumber) {
      ETUDE_ASSIGN_OR_RETURN(arguments.numbers_[parameter.name], NumberOf(spec, parameter));
    } else {
      ETUDE_ASSIGN_OR_RETURN(arguments.names_[parameter.name], NamesOf(spec, parameter, cast));
    }
  }
  for (const auto& child : spec.children) {
    ETUDE_ASSIGN_OR_RETURN(auto made, MakePredicate(child, cast));
    arguments.children_.push_back(std::move(made));
  }
  return kind->make(arguments);
}

}  // namespace etude::task
