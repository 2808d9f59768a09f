// SPDX-License-Identifier: Apache-2.0
#include "services/cli/completion.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cstring>

#include "services/cli/all_commands.h"

namespace etude::cli {
namespace {

// For both shells. A path of commands ("dataset info") is found word by word; a word that is no command, option or
// option's value counts as a positional one. Then what may stand in the place of the current word.
constexpr const char* kWalk = R"sh(  local route="" position=0 word skip=0 i
  for ((i = FIRST; i < CURRENT_WORD; ++i)); do
    word=${WORDS_ARRAY[i]}
    if ((skip)); then skip=0; continue; fi
    if [[ $word == -* ]]; then
      [[ $word != *=* && " $(_etude_values "$route") " == *" $word "* ]] && skip=1
    elif [[ " $(_etude_commands "$route") " == *" $word "* ]]; then
      route="${route:+$route }$word"
    else
      ((++position))
    fi
  done
  local current=${WORDS_ARRAY[CURRENT_WORD]} previous=${WORDS_ARRAY[CURRENT_WORD - 1]} offered=""
  if ((skip)); then
    offered=$(_etude_choices "$route:$previous")
  elif [[ $current == -* ]]; then
    offered=$(_etude_options "$route")
  else
    offered="$(_etude_commands "$route") $(_etude_choices "$route:$position")"
  fi
)sh";

std::string Quoted(const std::string& text) {
  std::string quoted = "'";
  for (const char c : text) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

// Sets REPLY: no process is started for a description.
std::string AboutArm(const std::string& pattern, std::string description) {
  std::ranges::replace(description, '\n', ' ');
  return description.empty() ? "" : fmt::format("    {}) REPLY={} ;;\n", Quoted(pattern), Quoted(description));
}

std::string Arm(const std::string& pattern, const std::vector<std::string>& words) {
  if (words.empty()) return "";
  return fmt::format("    {}) echo {} ;;\n", Quoted(pattern), Quoted(fmt::format("{}", fmt::join(words, " "))));
}

// The bodies of the functions that are asked for words.
struct Arms {
  std::string commands, options, values, choices, abouts;
};

void CollectArms(const OrderedJson& row, const std::string& path, Arms& arms) {
  std::vector<std::string> commands, options, values;
  int position = 0;
  for (const auto& option : row["options"]) {
    const auto names = option["names"].get<std::vector<std::string>>();
    const auto choices = option["choices"].get<std::vector<std::string>>();
    if (option["positional"].get<bool>()) {
      arms.choices += Arm(fmt::format("{}:{}", path, position++), choices);
      continue;
    }
    options.insert(options.end(), names.begin(), names.end());
    if (option["value"] != "") values.insert(values.end(), names.begin(), names.end());
    for (const auto& name : names) {
      arms.choices += Arm(path + ":" + name, choices);
      arms.abouts += AboutArm(path + ":" + name, option["description"]);
    }
  }
  for (const auto& command : row["commands"]) {
    commands.push_back(command["name"]);
    arms.abouts += AboutArm(path + ":" + commands.back(), command["description"]);
  }
  arms.commands += Arm(path, commands);
  arms.options += Arm(path, options);
  arms.values += Arm(path, values);
  for (const auto& command : row["commands"])
    CollectArms(command, (path.empty() ? "" : path + " ") + command["name"].get<std::string>(), arms);
}

std::string Function(const char* name, const std::string& body) {
  return fmt::format("{}() {{\n  case $1 in\n{}  esac\n}}\n", name, body);
}

Arms ArmsOf(const OrderedJson& commands) {
  Arms arms;
  CollectArms(commands, "", arms);
  return arms;
}

std::string Functions(const Arms& arms) {
  return "# commands after a path of them\n" + Function("_etude_commands", arms.commands) + "# options of a command\n" +
         Function("_etude_options", arms.options) + "# those of them that take a value\n" +
         Function("_etude_values", arms.values) +
         "# what PATH:OPTION, or PATH:NUMBER of a positional argument, may be\n" +
         Function("_etude_choices", arms.choices);
}

std::string Walk(const char* first, const char* current, const char* words) {
  std::string walk = kWalk;
  for (const auto& [name, value] : {std::pair{"FIRST", first}, {"CURRENT_WORD", current}, {"WORDS_ARRAY", words}})
    for (std::size_t at; (at = walk.find(name)) != std::string::npos;) walk.replace(at, std::strlen(name), value);
  return walk;
}

Status PrintScript(const CLI::App& app, const std::string& shell) {
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson commands, AllCommands(app, Missing::kSkip));
  fmt::print("{}", shell == "bash" ? BashCompletion(commands) : ZshCompletion(commands));
  return {};
}

}  // namespace

std::string BashCompletion(const OrderedJson& commands) {
  return "# bash completion of etude, made by `etude completion bash`\n" + Functions(ArmsOf(commands)) +
         "_etude() {\n" + Walk("1", "COMP_CWORD", "COMP_WORDS") +
         R"sh(  # shellcheck disable=SC2207
  COMPREPLY=($(compgen -W "$offered" -- "$current"))
}
complete -o default -F _etude etude
)sh";
}

// The file is the body of the function of its name, which zsh calls at the first TAB: then the functions are defined
// and the last of them is called. Read with `source`, they are defined alone.
std::string ZshCompletion(const OrderedJson& commands) {
  const Arms arms = ArmsOf(commands);
  return "#compdef etude\n# zsh completion of etude, made by `etude completion zsh`\n" + Functions(arms) +
         "# what PATH:WORD means, in REPLY\n" + Function("_etude_about", arms.abouts) + "_etude() {\n" +
         Walk("2", "CURRENT", "words") +
         R"sh(  local -a described
  local REPLY
  for word in ${=offered}; do
    REPLY=""
    ((skip)) || _etude_about "$route:$word"
    described+=("${word//:/\\:}${REPLY:+:$REPLY}")
  done
  if (($#described)); then _describe etude described; else _files; fi
}
if [[ $funcstack[1] == _etude ]]; then
  _etude "$@"
else
  compdef _etude etude 2>/dev/null
fi
)sh";
}

void AddCompletion(CLI::App& app, Body& body) {
  auto shell = std::make_shared<std::string>();
  auto* command = app.add_subcommand("completion", "a script that completes commands, options and values after TAB");
  command->add_option("shell", *shell, "bash | zsh")->required()->check(CLI::IsMember({"bash", "zsh"}));
  command->callback([shell, &app, &body] { body = [shell, &app] { return PrintScript(app, *shell); }; });
}

}  // namespace etude::cli
