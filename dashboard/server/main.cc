// SPDX-License-Identifier: Apache-2.0
// etude-gateway: `etude dashboard`.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>

#include "dashboard/server/api/metrics.h"
#include "dashboard/server/gateway.h"
#include "services/core/command.h"
#include "services/core/command_table.h"
#include "services/core/service_manager.h"

namespace etude {
namespace {

Status Serve(dashboard::GatewayOptions options) {
  if (options.dirs.empty()) options.dirs.push_back(".");
  ETUDE_ASSIGN_OR_RETURN(const auto gateway, dashboard::Gateway::Open(options));
  // the address is what people and programs wait for
  fmt::print("dashboard  {}\n", gateway->url());
  std::fflush(stdout);
  ServiceManager::Get().Ready(gateway->url());
  gateway->Run();
  return {};
}

Status Describe(const std::string& what) {
  fmt::print("{}\n", what == "http" ? dashboard::OpenApiText() : api::MetricFamilies());
  return {};
}

}  // namespace
}  // namespace etude

int main(int argc, char** argv) {
  CLI::App app(
      "Web pages over datasets, runs and evaluations below the given folders, and over what is on the bus. It changes\n"
      "nothing unless a token was given, and answers this machine alone unless told otherwise.",
      "etude dashboard");
  etude::dashboard::GatewayOptions options;
  std::vector<std::string> dirs;
  std::string token_file, web, cache, describe;
  bool no_bus = false;
  app.add_option("--dir", dirs, "folder to look in; repeatable (default: the current one)")->allow_extra_args(false);
  app.add_option("--port", options.port, "0: any free one")->capture_default_str();
  app.add_option("--bind", options.address, "address to listen at; another than this machine's own needs --token-file")
      ->capture_default_str();
  app.add_option("--host", options.hosts, "name that browsers open it by; repeatable")->allow_extra_args(false);
  app.add_option("--token-file", token_file, "whoever has its content may act; made when it is not there");
  app.add_flag("--no-bus", no_bus, "files alone");
  app.add_option("--web", web, "folder of the built pages (default: those that come along)");
  app.add_option("--cache", cache, "folder for videos and replays (default: ~/.cache/etude/dashboard)");
  app.add_option("--describe", describe, "only print what it serves: http (OpenAPI) | metrics (names and types)")
      ->check(CLI::IsMember({"http", "metrics"}));
  options.bus.Add(app);
  if (const auto ended = etude::ParseCommandLine(app, argc, argv)) return *ended;
  options.dirs.assign(dirs.begin(), dirs.end());
  options.token_file = token_file;
  options.web = web;
  options.cache = cache;
  options.use_bus = !no_bus;
  return etude::RunMain("etude-gateway", [&] {
    if (!describe.empty()) return etude::Describe(describe);
    return etude::Serve(options);
  });
}
