// SPDX-License-Identifier: Apache-2.0
#include "services/language/grammar.h"

#include <fmt/format.h>

#include <algorithm>

#include "services/core/check.h"
#include "services/core/config.h"
#include "services/language/sentence.h"
#include "services/language/vocabulary.h"
#include "services/spec/object_names.h"

namespace etude::language {

Command CommandFor(const TaskName& task, const std::string& target, const std::string& reference) {
  std::string obstacle;
  if (task.avoid == "obstacle") obstacle = kObstacleObject;
  if (task.avoid == "others") obstacle = kEverythingElse;
  return {task.base, target, reference, obstacle};
}

Result<Grammar> Grammar::Load(const std::vector<OwnObject>& own, const std::vector<std::string>& tasks) {
  ETUDE_ASSIGN_OR_RETURN(auto vocabulary, Vocabulary::Load(own, tasks));
  Grammar grammar;
  grammar.vocabulary_ = std::make_shared<const Vocabulary>(std::move(vocabulary));
  return grammar;
}

Result<Grammar> Grammar::LoadFor(const std::vector<std::string>& objects, const std::vector<std::string>& tasks) {
  ETUDE_ASSIGN_OR_RETURN(auto vocabulary, Vocabulary::LoadFor(objects, tasks));
  Grammar grammar;
  grammar.vocabulary_ = std::make_shared<const Vocabulary>(std::move(vocabulary));
  return grammar;
}

Status Grammar::Check(const Command& command) const {
  const auto refuse = [](std::string why) { return Fail(Code::kInvalidArgument, "command: " + std::move(why)); };
  if (std::find(tasks().begin(), tasks().end(), command.task) == tasks().end())
    return refuse(fmt::format("no words for task '{}'{}", command.task, Suggestion(command.task, tasks())));
  if (vocabulary_->needs_reference(command.task) == command.reference.empty())
    return refuse(
        fmt::format("task '{}' {} reference", command.task, command.reference.empty() ? "needs a" : "has no"));

  std::vector<std::string> classes;
  for (const auto* object : {&command.target, &command.reference, &command.obstacle}) {
    if (object != &command.target && (object->empty() || *object == kEverythingElse)) continue;
    if (!vocabulary_->FindNoun(*object))
      return refuse(fmt::format("no words for object '{}'{}", *object, Suggestion(*object, objects())));
    const std::string its_class = ObjectNoun(*object);
    if (std::find(classes.begin(), classes.end(), its_class) != classes.end())
      return refuse(fmt::format("two objects are called '{}'", its_class));
    classes.push_back(its_class);
  }
  if (command.reference == kEverythingElse) return refuse("everything else is no reference");
  return {};
}

std::string Grammar::Sample(const Command& command, Style style, Rng& rng, double masked) const {
  const Status status = Check(command);
  ETUDE_CHECK(status.has_value(), "{}", status.error().message);
  if (style == Style::kTemplate) return DrawTemplate(*vocabulary_, command, rng);
  std::string sentence;
  do {
    sentence = DrawVaried(*vocabulary_, command, masked, rng);
    if (style == Style::kNoisy)
      for (std::uint64_t typos = rng.Below(3); typos > 0; --typos) AddTypo(sentence, rng);
  } while (Vocabulary::HasHeldOut(sentence));
  if (style == Style::kNoisy) {
    if (rng.Bernoulli(0.3)) sentence[0] = static_cast<char>(std::toupper(sentence[0]));
    if (rng.Bernoulli(0.3)) sentence += rng.Bernoulli(0.5) ? "." : "!";
  }
  return sentence;
}

std::vector<std::string> Grammar::Templates(const Command& command) const {
  const Status status = Check(command);
  ETUDE_CHECK(status.has_value(), "{}", status.error().message);
  return AllTemplates(*vocabulary_, command);
}

std::set<std::string> Grammar::Words(const Command& command) const {
  const Status status = Check(command);
  ETUDE_CHECK(status.has_value(), "{}", status.error().message);
  return AllWords(*vocabulary_, command);
}

std::vector<std::string> Grammar::NounPhrases(const std::string& object) const {
  const auto* noun = vocabulary_->FindNoun(object);
  return noun ? std::vector<std::string>(noun->phrases.begin(), noun->phrases.end()) : std::vector<std::string>{};
}

const std::vector<std::string>& Grammar::tasks() const { return vocabulary_->tasks(); }
const std::vector<std::string>& Grammar::objects() const { return vocabulary_->objects(); }

}  // namespace etude::language
