// SPDX-License-Identifier: Apache-2.0
#include "services/store/attempts.h"

#include <fstream>
#include <limits>
#include <optional>
#include <utility>

#include "services/episode/bounded_json.h"
#include "services/store/layout.h"

namespace etude::store {
namespace {

std::optional<AttemptLine> ParseAttempt(std::string text) {
  const auto json = ParseBoundedJson(text);
  if (!json || !json->is_object()) return std::nullopt;
  const auto index = json->find("index"), attempt = json->find("attempt"), outcome = json->find("outcome");
  if (index == json->end() || !index->is_number_unsigned() || attempt == json->end() ||
      !attempt->is_number_unsigned() || outcome == json->end() || !outcome->is_string())
    return std::nullopt;
  const auto number = attempt->get<std::uint64_t>();
  if (number > std::numeric_limits<std::uint32_t>::max()) return std::nullopt;
  const auto details = json->find("details");
  return AttemptLine{index->get<std::uint64_t>(), static_cast<std::uint32_t>(number), outcome->get<std::string>(),
                     details == json->end() ? OrderedJson() : *details, std::move(text)};
}

}  // namespace

void ForEachAttempt(const Path& dataset, const std::function<void(const AttemptLine&)>& take) {
  std::ifstream file(dataset / internal::kAttempts);
  std::string buffer(kMaxAttemptLine + 1, '\0');
  while (file) {
    file.getline(buffer.data(), static_cast<std::streamsize>(buffer.size()));
    const auto read = static_cast<std::size_t>(file.gcount());  // with the line's end where there is one
    if (file.bad() || read == 0) return;
    if (file.fail()) {  // longer than the buffer
      file.clear();
      file.ignore(std::numeric_limits<std::streamsize>::max(), '\n');
      continue;
    }
    if (const auto line = ParseAttempt(buffer.substr(0, file.eof() ? read : read - 1))) take(*line);
  }
}

}  // namespace etude::store
