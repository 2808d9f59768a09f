// SPDX-License-Identifier: Apache-2.0
// `etude attempt replay`: the worker makes the attempt again, then its pictures become a video.
#include <fmt/format.h>

#include <chrono>
#include <filesystem>

#include "services/campaign/process.h"
#include "services/cli/command_line.h"
#include "services/cli/video.h"
#include "services/core/command.h"
#include "services/core/command_table.h"
#include "services/core/stop.h"

namespace etude::cli {
namespace {

struct AttemptArguments {
  std::string spec, out;
  std::uint64_t index = 0;
  std::uint32_t attempt = 0;
  std::vector<std::string> overrides;
};

Status RunWorker(const AttemptArguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const Path program, campaign::FindSibling("etude-worker"));
  campaign::ProcessOptions options;
  options.argv = {program.string(), "attempt",
                  "replay",         arguments.spec,
                  "--index",        std::to_string(arguments.index),
                  "--attempt",      std::to_string(arguments.attempt),
                  "--out",          arguments.out};
  for (const auto& text : arguments.overrides) options.argv.insert(options.argv.end(), {"--set", text});
  ETUDE_ASSIGN_OR_RETURN(auto worker, campaign::Process::Start(options));
  while (worker.running() && !StopRequested()) worker.Wait(std::chrono::milliseconds(100));
  if (worker.running()) return Fail(Code::kExhausted, "replay an attempt: stopped");
  // the worker has said what is wrong
  if (const int code = worker.Poll().value_or(1); code != 0)
    return Fail(CodeForExit(code), fmt::format("replay an attempt: etude-worker ended with {}", code));
  return {};
}

Status Replay(const AttemptArguments& arguments) {
  ETUDE_RETURN_IF_ERROR(RunWorker(arguments));
  const Path out = arguments.out;
  std::error_code error;
  if (std::filesystem::exists(out / "dataset.json", error)) {
    ETUDE_ASSIGN_OR_RETURN(const auto videos, WriteVideos(out, out, 1));
    for (const auto& video : videos) fmt::print("{}\n", video.string());
  }
  fmt::print("{}\n", (out / "plan.json").string());
  return {};
}

}  // namespace

void AddAttempt(CLI::App& app, Body& body) {
  auto* command = AddGroup(app, "attempt", "make any attempt of a campaign again, to see how it went");
  auto arguments = std::make_shared<AttemptArguments>();
  auto* replay = command->add_subcommand(
      "replay", "an attempt, failed or not: episode, video, planned motions, distances, where every body was");
  replay->add_option("spec", arguments->spec, "campaign file, or the folder of a dataset")->required();
  replay->add_option("--index", arguments->index, "episode")->required();
  replay->add_option("--attempt", arguments->attempt, "attempt at it, as in attempts.jsonl")->capture_default_str();
  replay->add_option("--out", arguments->out, "folder, new or empty")->required()->check(NamesAPlace());
  AddOverrides(*replay, arguments->overrides, "image_stride=2");
  replay->callback([=, &body] { body = [=] { return Replay(*arguments); }; });
}

}  // namespace etude::cli
