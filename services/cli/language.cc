// SPDX-License-Identifier: Apache-2.0
// `etude language held-out`: which words of the paper's unseen sentences training never saw.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "services/cli/command_line.h"
#include "services/core/config.h"
#include "services/language/grammar.h"
#include "services/language/held_out.h"
#include "services/spec/object_names.h"

namespace etude::cli {
namespace {

struct HeldOutArguments {
  std::vector<std::string> tasks{"pick", "push", "put_down"};
  std::vector<std::string> objects{"cube", "coke", "pepsi", "milk", "bread", "bottle"};
  bool as_json = false;
};

struct WordRow {
  std::string text, meaning;
  std::vector<std::string> unseen;
};

void PrintRows(const char* title, const std::vector<WordRow>& rows) {
  std::size_t with_unseen = 0;
  fmt::print("\n{:<38} {:<18} never seen\n", title, "means");
  for (const auto& row : rows) {
    with_unseen += !row.unseen.empty();
    fmt::print("{:<38} {:<18} {}\n", row.text, row.meaning,
               row.unseen.empty() ? "- (only put together anew)" : fmt::format("{}", fmt::join(row.unseen, ", ")));
  }
  fmt::print("{} of {} hold a word that training never saw\n", with_unseen, rows.size());
}

OrderedJson ToJson(const std::vector<WordRow>& rows) {
  OrderedJson list = OrderedJson::array();
  for (const auto& row : rows) list.push_back({{"text", row.text}, {"means", row.meaning}, {"never_seen", row.unseen}});
  return list;
}

Status HeldOut(const HeldOutArguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const auto expanded, ExpandObjects(arguments.objects));
  for (const auto& object : expanded) ETUDE_RETURN_IF_ERROR(CheckObjectName(object));
  const std::vector<std::string> objects = SceneNames(expanded);
  ETUDE_ASSIGN_OR_RETURN(const auto grammar, language::Grammar::LoadFor(objects, arguments.tasks));
  ETUDE_ASSIGN_OR_RETURN(const auto seen, language::SeenWords(grammar, arguments.tasks, objects));
  std::vector<WordRow> sentences, phrases;
  for (const auto& held_out : language::HeldOutSentences())
    sentences.push_back(
        {held_out.text, held_out.task + " " + held_out.object, language::UnseenWords(held_out.text, seen)});
  for (const auto& held_out : language::HeldOutNounPhrases())
    phrases.push_back({held_out.text, held_out.object, language::UnseenWords(held_out.text, seen)});
  if (arguments.as_json) {
    const OrderedJson json{{"seen", seen}, {"table_11", ToJson(sentences)}, {"table_8", ToJson(phrases)}};
    fmt::print("{}\n", json.dump(1));
    return {};
  }
  fmt::print(
      "Training on {} of {} says {} words (base words, function words, and WordNet's rule; typing errors aside):\n"
      "{}\n",
      fmt::join(arguments.tasks, ", "), fmt::join(arguments.objects, ", "), seen.size(), fmt::join(seen, " "));
  PrintRows("sentences of Table 11", sentences);
  PrintRows("noun phrases of Table 8", phrases);
  return {};
}

}  // namespace

void AddLanguage(CLI::App& app, Body& body) {
  auto* command = AddGroup(app, "language", "what training says, and what it never says");
  auto arguments = std::make_shared<HeldOutArguments>();
  auto* held_out =
      command->add_subcommand("held-out", "the paper's unseen sentences, and which of their words training never saw");
  held_out->add_option("--tasks", arguments->tasks, "tasks that are trained");
  held_out->add_option("--objects", arguments->objects, "objects that are trained on");
  held_out->add_flag("--json", arguments->as_json, "as JSON");
  held_out->callback([=, &body] { body = [=] { return HeldOut(*arguments); }; });
}

}  // namespace etude::cli
