// SPDX-License-Identifier: Apache-2.0
#include "services/core/command_table.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

#include "services/core/command.h"

namespace etude {
namespace {

using Json = nlohmann::ordered_json;

// "TEXT:{latest,best}": one of a set
std::vector<std::string> ChoicesIn(const std::string& type) {
  const auto open = type.find(":{"), close = type.rfind('}');
  std::vector<std::string> choices;
  if (open == std::string::npos || close == std::string::npos) return choices;
  return CLI::detail::split(type.substr(open + 2, close - open - 2), ',');
}

// "INT:INT in [0 - 230]" says twice that it is a number
std::string ValueOf(const std::string& type, bool has_choices) {
  const auto colon = type.find(':');
  if (colon == std::string::npos) return type;
  return has_choices ? type.substr(0, colon) : type.substr(colon + 1);
}

Json OptionRow(const CLI::Option& option) {
  Json names = Json::array();
  for (const auto& name : option.get_lnames()) names.push_back("--" + name);
  for (const auto& name : option.get_snames()) names.push_back("-" + name);
  const bool positional = option.get_positional();
  if (names.empty()) names.push_back(option.get_name(true));
  const bool flag = option.get_items_expected_max() == 0;
  const std::string type = flag ? "" : option.get_type_name();
  const auto choices = ChoicesIn(type);
  return {{"names", std::move(names)},
          {"positional", positional},
          {"value", ValueOf(type, !choices.empty())},
          {"choices", choices},
          {"default", option.get_default_str()},
          {"required", option.get_required()},
          {"repeats", option.get_items_expected_max() > 1},
          {"description", option.get_description()}};
}

// @returns what is wrong, "" when nothing is
std::string TakeDecimal(std::string& text, bool is_unsigned) {
  if (is_unsigned && text.starts_with('-')) return fmt::format("{} is below 0", text);
  const std::size_t begin = text.starts_with('-') || text.starts_with('+') ? 1 : 0;
  std::size_t end = begin;
  while (end + 1 < text.size() && text[end] == '0' && std::isdigit(static_cast<unsigned char>(text[end + 1])) != 0)
    ++end;
  text.erase(begin, end - begin);
  const bool whole = text.size() > begin && std::all_of(text.begin() + static_cast<std::ptrdiff_t>(begin), text.end(),
                                                        [](unsigned char c) { return std::isdigit(c) != 0; });
  if (!whole) return fmt::format("{} is no whole number", text);
  std::uint64_t number = 0;
  const bool fits = std::from_chars(text.data() + begin, text.data() + text.size(), number).ec == std::errc();
  return fits ? "" : fmt::format("{} is more than a number holds", text);
}

// What is no number lies in every range. @returns what is wrong, "" when nothing is
std::string CheckFinite(const std::string& text) {
  char* end = nullptr;
  const double number = std::strtod(text.c_str(), &end);
  const bool is_number = end != text.c_str() && *end == '\0';
  return is_number && !std::isfinite(number) ? fmt::format("{} is no finite number", text) : "";
}

}  // namespace

Json CommandTable(const CLI::App& app) {
  Json options = Json::array(), commands = Json::array();
  for (const auto* option : app.get_options())
    if (!option->get_group().empty()) options.push_back(OptionRow(*option));
  for (const auto* command : app.get_subcommands([](const CLI::App*) { return true; }))
    if (!command->get_group().empty()) commands.push_back(CommandTable(*command));
  return {{"name", app.get_name()},
          {"description", app.get_description()},
          {"options", std::move(options)},
          {"commands", std::move(commands)}};
}

void TakeDecimals(CLI::App& app) {
  for (CLI::Option* option : app.get_options()) {
    const std::string type = option->get_type_name();
    if (type.starts_with("FLOAT"))
      option->transform(CLI::Validator([](std::string& text) { return CheckFinite(text); }, ""));
    const bool is_unsigned = type.starts_with("UINT");
    if (!is_unsigned && !type.starts_with("INT")) continue;
    // before all checks: ranges look at what it makes
    option->transform(CLI::Validator([=](std::string& text) { return TakeDecimal(text, is_unsigned); }, ""));
  }
  for (CLI::App* command : app.get_subcommands([](CLI::App*) { return true; })) TakeDecimals(*command);
}

std::optional<int> ParseCommandLine(CLI::App& app, int argc, char** argv) {
  if (argc == 2 && std::strcmp(argv[1], "--command-table") == 0) {
    fmt::print("{}\n", CommandTable(app).dump(1));
    return kExitOk;
  }
  TakeDecimals(app);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? kExitOk : kExitUsage;
  }
  return std::nullopt;
}

CLI::Validator EndsWith(const std::vector<std::string>& endings) {
  const std::string wanted = fmt::format("{}", fmt::join(endings, " or "));
  return CLI::Validator(
      [=](const std::string& file) {
        const bool known = std::ranges::any_of(endings, [&](const auto& ending) { return file.ends_with(ending); });
        return known ? std::string() : fmt::format("'{}' must end with {}", file, wanted);
      },
      "");
}

CLI::Validator NamesAPlace() {
  return CLI::Validator(
      [](const std::string& name) { return name.empty() ? std::string("it is empty") : std::string(); }, "");
}

}  // namespace etude
