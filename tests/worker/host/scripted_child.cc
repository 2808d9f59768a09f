// SPDX-License-Identifier: Apache-2.0
// A child that makes what it is told by a file: scripted_child STATE. Of episode 0 it makes a result; of 1 it crashes
// once (STATE remembers), of 2 it hangs once, of 3 it says garbage once, of 4 it asks, of 5 its work fails, of 6 it
// always crashes, of 7 it says once that it is where it was, for ever.
#include <signal.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>

#include "services/core/command.h"
#include "services/core/file.h"
#include "worker/host/child.h"

namespace etude {
namespace {

Result<campaign::WorkResult> Make(const std::string& state, const campaign::WorkItem& item,
                                  const policy::AskFunction& ask) {
  const Path once = state + "-" + std::to_string(item.index);
  const bool first = !std::filesystem::exists(once);
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(once, std::string_view("done")));
  item.progress("reach", 3);
  if (item.index == 6 || (item.index == 1 && first)) {
    std::fputs("GL: out of luck\n", stderr);
    ::raise(SIGSEGV);
  }
  while (item.index == 2 && first) ::pause();
  // by a channel of its own: item.progress says the same now and then alone
  for (host::Channel own(::dup(host::kHostDescriptor)); item.index == 7 && first; ::usleep(20'000))
    ETUDE_RETURN_IF_ERROR(own.Send(host::FrameKind::kProgress, {{"stage", "reach"}, {"step", 3}}));
  const char garbage[] = "this is no frame at all, and longer than a header";
  if (item.index == 3 && first) (void)!::send(host::kHostDescriptor, garbage, sizeof garbage, 0);
  if (item.index == 5) return Fail(Code::kUnavailable, "no GL here");
  campaign::WorkResult result{.episode = {1, 2, 3}, .outcome = "success", .steps = item.attempt};
  if (item.index == 4) {
    const std::vector<std::uint8_t> picture(12, 200);
    ETUDE_ASSIGN_OR_RETURN(const auto answer, ask({.instruction = "which", .width = 2, .height = 2, .rgb = picture}));
    result.steps = answer.checkpoint_step;
  }
  return result;
}

}  // namespace
}  // namespace etude

int main(int, char** argv) {
  using namespace etude;
  return RunMain("scripted_child", [&] {
    return host::ServeHost(
        host::Channel(host::kHostDescriptor),
        [&](const campaign::JoinedCampaign&, const policy::AskFunction& ask) -> Result<campaign::WorkFunction> {
          return [&, ask](const campaign::WorkItem& item) { return Make(argv[1], item, ask); };
        });
  });
}
