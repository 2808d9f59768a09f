// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>

#include "services/campaign/process.h"
#include "services/cli/command_line.h"
#include "services/core/file.h"

namespace etude::cli {

const std::vector<OwnProgram>& OwnPrograms() {
  static const std::vector<OwnProgram> programs{
      {"collector", "etude-collector", "own a campaign; workers on any host join it"},
      {"worker", "etude-worker", "join a campaign, from any host"},
      {"train", "etude-trainer", "train a policy on a dataset, also while it grows"},
      {"policy", "etude-policy", "answer observations with actions, swapping to each new checkpoint"},
      {"dashboard", "etude-gateway", "web pages over folders and what is on the bus"},
      {"scene", "etude-worker", "look at a campaign's scenes", {"scene"}},
      {"robot", "etude-worker", "check a robot of your own", {"robot"}},
      {"task", "etude-worker", "check a task of your own", {"task"}},
      {"object", "etude-object", "make or import objects"},
      {"plan", "etude-plan", "measure the motion planners over seeded scenes"}};
  return programs;
}

Status ExecSibling(const std::string& program, const std::vector<std::string>& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const Path path, campaign::FindSibling(program));
  std::vector<std::string> texts{path.string()};
  texts.insert(texts.end(), arguments.begin(), arguments.end());
  std::vector<char*> argv;
  for (auto& text : texts) argv.push_back(text.data());
  argv.push_back(nullptr);
  ::execv(path.c_str(), argv.data());
  return Fail(ErrnoError("start", path, errno));
}

}  // namespace etude::cli
