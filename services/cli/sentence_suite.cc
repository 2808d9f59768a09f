// SPDX-License-Identifier: Apache-2.0
#include "services/cli/sentence_suite.h"

#include <fmt/format.h>

#include <sstream>

#include "services/core/printable.h"
#include "services/language/held_out.h"
#include "services/language/tokenizer.h"
#include "services/spec/object_names.h"

namespace etude::cli {
namespace {

constexpr std::uint64_t kLargestFile = 1 << 20;

std::vector<SentenceSpec> Table8() {
  std::vector<SentenceSpec> sentences;
  for (const auto& phrase : language::HeldOutNounPhrases())
    sentences.push_back({"push " + phrase.text, "push", phrase.object, ""});
  return sentences;
}

std::vector<SentenceSpec> Table11() {
  std::vector<SentenceSpec> sentences;
  for (const auto& sentence : language::HeldOutSentences())
    sentences.push_back({sentence.text, sentence.task, sentence.object, ""});
  return sentences;
}

Result<SentenceSpec> ParseLine(const std::string& line) {
  const auto colon = line.find(": ");
  SentenceSpec sentence;
  std::string more;
  std::istringstream meaning(line.substr(0, colon));
  meaning >> sentence.task >> sentence.object >> sentence.reference >> more;
  if (colon != std::string::npos) sentence.text = Trimmed(line.substr(colon + 2));
  if (sentence.text.empty() || sentence.object.empty() || !more.empty())
    return Fail(Code::kInvalidArgument, fmt::format("'{}' is not 'TASK OBJECT [REFERENCE]: SENTENCE'", line));
  return sentence;
}

}  // namespace

Result<std::vector<SentenceSpec>> LoadSentences(const std::string& suite) {
  if (suite == "table8") return Table8();
  if (suite == "table11") return Table11();
  const auto text = ReadTextFile(suite, kLargestFile);
  if (!text) return Fail(Code::kInvalidArgument, "--sentences is table8, table11 or a file: " + text.error().message);
  std::vector<SentenceSpec> sentences;
  std::istringstream lines(*text);
  int number = 0;
  for (std::string raw; std::getline(lines, raw);) {
    ++number;
    const std::string line(Trimmed(raw));
    if (line.empty() || line.front() == '#') continue;
    auto sentence = ParseLine(line);
    if (!sentence) return Fail(sentence.error().Wrap(fmt::format("{}:{}", suite, number)));
    sentences.push_back(std::move(*sentence));
  }
  if (sentences.empty())
    return Fail(Code::kInvalidArgument, fmt::format("{}: no sentence; write 'pick bread: grab the loafs'", suite));
  return sentences;
}

Status AddNeverSeen(const std::optional<std::set<std::string>>& said, const std::vector<std::string>& tasks,
                    const std::vector<std::string>& objects, OrderedJson& report) {
  if (!report.contains("per_sentence")) return {};
  std::set<std::string> seen = said.value_or(std::set<std::string>());
  if (!said) {
    const std::vector<std::string> names = SceneNames(objects);
    ETUDE_ASSIGN_OR_RETURN(const auto grammar, language::Grammar::LoadFor(names, tasks));
    ETUDE_ASSIGN_OR_RETURN(seen, language::SeenWords(grammar, tasks, names));
  }
  for (auto& sentence : report["per_sentence"])
    sentence["never_seen"] = language::UnseenWords(language::Normalize(sentence["text"].get<std::string>()), seen);
  report["words_of"] = said ? "training" : "campaign";
  return {};
}

}  // namespace etude::cli
