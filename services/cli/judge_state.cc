// SPDX-License-Identifier: Apache-2.0
#include "services/cli/judge_state.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <optional>
#include <vector>

#include "services/episode/action.h"

namespace etude::cli {
namespace {

constexpr std::size_t kMostViolations = 2;  // the first ones; more do not fit under a picture
constexpr std::size_t kMostLetters = 48;    // of a name that comes out of a file

// details[key] where it is a list; else an empty one.
const OrderedJson& ListOf(const OrderedJson& details, const char* key) {
  static const OrderedJson kNone = OrderedJson::array();
  const auto found = details.find(key);
  return found != details.end() && found->is_array() ? *found : kNone;
}

// The control step that json[key] names, when it is there and not after `step`.
std::optional<int> Reached(const OrderedJson& json, const char* key, int step) {
  const auto found = json.find(key);
  if (found == json.end() || !found->is_number_integer()) return std::nullopt;
  const auto number = found->get<std::int64_t>();
  return number >= 0 && number <= step ? std::optional(static_cast<int>(number)) : std::nullopt;
}

std::string At(int step) { return fmt::format("at {:.2f} s", step / kControlRate); }

std::string WordOf(const OrderedJson& json, const char* key) {
  const auto found = json.find(key);
  return found != json.end() && found->is_string() ? found->get<std::string>().substr(0, kMostLetters) : "?";
}

bool Touched(const OrderedJson& details, int step) {
  return std::ranges::any_of(ListOf(details, "decisions"), [&](const OrderedJson& decision) {
    const auto touched = decision.find("touched");
    return Reached(decision, "step", step) && touched != decision.end() && *touched == true;
  });
}

}  // namespace

std::string JudgeState(const OrderedJson& details, int step) {
  std::vector<std::string> words;
  if (Touched(details, step)) words.push_back("target touched");
  if (const auto latched = Reached(details, "latched_step", step)) words.push_back("latched " + At(*latched));
  if (const auto done = Reached(details, "done_step", step)) words.push_back("done " + At(*done));
  std::size_t violations = 0;
  for (const auto& violation : ListOf(details, "violations")) {
    const auto begun = Reached(violation, "step", step);
    if (!begun || violations == kMostViolations) continue;
    words.push_back(fmt::format("{} {} {}", WordOf(violation, "kind"), WordOf(violation, "what"), At(*begun)));
    ++violations;
  }
  return words.empty() ? "judge: nothing yet" : fmt::format("judge: {}", fmt::join(words, ", "));
}

}  // namespace etude::cli
