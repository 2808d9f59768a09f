// SPDX-License-Identifier: Apache-2.0
#include "services/cli/sibling_text.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/mman.h>
#include <unistd.h>

#include "services/campaign/process.h"
#include "services/core/command.h"
#include "services/core/descriptor.h"
#include "services/core/file.h"

namespace etude::cli {
namespace {

using namespace std::chrono_literals;

// A file without a name: it is gone with this process, however that ends.
class UnnamedFile {
 public:
  UnnamedFile() : file_(::memfd_create("etude-sibling", MFD_CLOEXEC)) {}
  // Where this process and its children can open it.
  Path path() const { return fmt::format("/proc/{}/fd/{}", ::getpid(), file_.get()); }

 private:
  Descriptor file_;
};

}  // namespace

Result<SiblingText> AskSibling(const std::string& program, std::vector<std::string> arguments) {
  ETUDE_ASSIGN_OR_RETURN(const Path path, campaign::FindSibling(program));
  const std::string said = fmt::format("{} {}", program, fmt::join(arguments, " "));
  arguments.insert(arguments.begin(), path.string());
  const UnnamedFile log;
  ETUDE_ASSIGN_OR_RETURN(auto process, campaign::Process::Start({arguments, log.path(), {{"ETUDE_LOG", "error"}}}));
  const auto exit_code = process.Wait(60s);
  if (!exit_code) return Fail(Code::kTimeout, fmt::format("{} did not end within 60 s", said));
  SiblingText answer{*exit_code, ReadTextFile(log.path()).value_or("")};
  while (!answer.text.empty() && answer.text.back() == '\n') answer.text.pop_back();
  return answer;
}

Status CheckBySibling(const std::string& program, std::vector<std::string> arguments) {
  ETUDE_ASSIGN_OR_RETURN(const SiblingText answer, AskSibling(program, std::move(arguments)));
  if (answer.exit_code == kExitOk) return {};
  return Fail(CodeForExit(answer.exit_code),
              answer.text.empty() ? campaign::HowItEnded(answer.exit_code) : answer.text);
}

Result<OrderedJson> AskSiblingJson(const std::string& program, const std::vector<std::string>& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const auto answer, AskSibling(program, arguments));
  auto json = OrderedJson::parse(answer.text, nullptr, false);
  if (answer.exit_code == 0 && !json.is_discarded()) return json;
  return Fail(Code::kInternal, fmt::format("{} {}: exit code {}, and no JSON: {:.400}", program,
                                           fmt::join(arguments, " "), answer.exit_code, answer.text));
}

}  // namespace etude::cli
