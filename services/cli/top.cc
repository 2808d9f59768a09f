// SPDX-License-Identifier: Apache-2.0
// `etude top`: what goes on on this domain, on one screen.
#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <cstdio>

#include "services/cli/command_line.h"
#include "services/cli/top_json.h"
#include "services/cli/top_text.h"
#include "services/core/stop.h"

namespace etude::cli {
namespace {

using namespace std::chrono_literals;

struct TopArguments {
  bool once = false, as_json = false;
  BusArguments bus;
};

struct Screen {
  std::size_t rows = 0, columns = 0;
};

Screen ScreenNow() {
  winsize size{};
  if (::ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0) return {};
  return {size.ws_row, size.ws_col};
}

Status Top(const TopArguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open({security::Role::kGateway}));
  ETUDE_ASSIGN_OR_RETURN(auto watch, BusWatch::Open(participant));
  // who is there says so once a second
  ETUDE_RETURN_IF_ERROR(watch.LookAround(1500ms));
  if (arguments.as_json) {
    fmt::print("{}\n", JsonText(TopJson(watch.view(), MonotonicClock::now()), 1));
    return {};
  }
  if (arguments.once || !::isatty(STDOUT_FILENO)) {
    fmt::print("{}", TopText(watch.view(), MonotonicClock::now()));
    return {};
  }
  while (!StopRequested() && std::ferror(stdout) == 0) {
    ETUDE_RETURN_IF_ERROR(watch.Look());
    const Screen screen = ScreenNow();
    // home, the lines with what stood behind each erased, then what stood below
    std::string text = TopText(watch.view(), MonotonicClock::now(), screen.rows, screen.columns);
    for (std::size_t at = 0; (at = text.find('\n', at)) != std::string::npos; at += 4) text.insert(at, "\x1b[K");
    fmt::print("\x1b[H{}\x1b[J", text);
    std::fflush(stdout);
    WaitForStop(1s);
  }
  return {};
}

}  // namespace

void AddTop(CLI::App& app, Body& body) {
  auto* command =
      app.add_subcommand("top", "what goes on: campaigns, workers, training, policies; redrawn each second");
  auto arguments = std::make_shared<TopArguments>();
  auto* once = command->add_flag("--once", arguments->once, "print it once");
  command->add_flag("--json", arguments->as_json, "with --once: as one JSON object")->needs(once);
  arguments->bus.Add(*command);
  command->callback([arguments, &body] { body = [arguments] { return Top(*arguments); }; });
}

}  // namespace etude::cli
