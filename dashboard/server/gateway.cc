// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/gateway.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <optional>

#include "dashboard/server/api/context.h"
#include "dashboard/server/api/jobs.h"
#include "dashboard/server/api/live_hub.h"
#include "dashboard/server/http/server.h"
#include "dashboard/server/http/static_files.h"
#include "dashboard/server/live/policy_looker.h"
#include "services/core/identity.h"
#include "services/core/log.h"
#include "services/core/service_manager.h"
#include "services/core/share.h"
#include "services/core/stop.h"
#include "services/core/stop_reason.h"

namespace etude::dashboard {
namespace {

using namespace std::chrono_literals;

bool IsLoopback(const std::string& address) { return address.starts_with("127.") || address == "::1"; }

std::string Trimmed(std::string text) {
  while (!text.empty() && std::isspace(static_cast<unsigned char>(text.back()))) text.pop_back();
  return text;
}

Status MakeToken(const Path& file) {
  ETUDE_RETURN_IF_ERROR(MakeFolders(std::filesystem::absolute(file).parent_path()));
  if (Status made = WriteSecret(file, NewId() + NewId() + "\n"); !made)
    return Fail(made.error().Wrap("make the token file"));
  Log().info("made a token in {}", file.string());
  return {};
}

Result<std::string> ReadToken(const Path& file) {
  constexpr std::size_t kShortest = 16;
  if (file.empty()) return std::string();
  std::error_code error;
  if (!std::filesystem::exists(file, error)) ETUDE_RETURN_IF_ERROR(MakeToken(file));
  ETUDE_ASSIGN_OR_RETURN(const std::string text, ReadTextFile(file, 4096));
  std::string token = Trimmed(text);
  if (token.size() >= kShortest) return token;
  return Fail(Code::kInvalidArgument,
              fmt::format("--token-file {}: the token has {} characters; at least {} are needed, such as those of "
                          "`openssl rand -hex 16`",
                          file.string(), token.size(), kShortest));
}

// The built pages in a source tree above the program, or where they are installed.
Path FindPages() {
  std::error_code ignored;
  const Path built = "dashboard/web/dist";
  for (Path folder = ProgramFolder(); folder != folder.parent_path(); folder = folder.parent_path())
    if (std::filesystem::is_regular_file(folder / built / "index.html", ignored)) return folder / built;
  return FindShared("web").value_or(built);
}

// "": there is no place that only this user may write.
Path CacheFolder() {
  if (const char* cache = std::getenv("XDG_CACHE_HOME"); cache && *cache) return Path(cache) / "etude" / "dashboard";
  if (const char* home = std::getenv("HOME"); home && *home) return Path(home) / ".cache" / "etude" / "dashboard";
  return {};
}

// "Lab-7:8080", as it stands in a browser, is known as "lab-7". @error kInvalidArgument
Result<std::string> KnownName(const std::string& host) {
  const bool bare_six = std::ranges::count(host, ':') > 1 && !host.starts_with('[');
  std::string name = http::HostName(bare_six ? "[" + host + "]" : host);
  if (!name.empty()) return name;
  return Fail(Code::kInvalidArgument, fmt::format("--host {}: not the name of a host, such as lab-7", host));
}

Result<http::SecurityConfig> SecurityOf(const GatewayOptions& options) {
  http::SecurityConfig config;
  config.reads_need_token = !IsLoopback(options.address);
  for (const auto& host : options.hosts) {
    ETUDE_ASSIGN_OR_RETURN(std::string name, KnownName(host));
    config.hosts.push_back(std::move(name));
  }
  ETUDE_ASSIGN_OR_RETURN(config.token, ReadToken(options.token_file));
  if (config.reads_need_token && config.token.empty())
    return Fail(
        Code::kInvalidArgument,
        fmt::format("--bind {}: other machines could read everything; name a --token-file FILE, too", options.address));
  return config;
}

std::shared_ptr<const live::LiveView> NoBus() {
  static const auto empty = std::make_shared<const live::LiveView>();
  return empty;
}

}  // namespace

// In the order in which they need each other: at the end the server goes first, and with it the threads that use the
// rest.
struct Gateway::Parts {
  Parts(const GatewayOptions& chosen, const http::SecurityConfig& secured)
      : options(chosen),
        cache(chosen.cache.empty() ? CacheFolder() : chosen.cache),
        sources(chosen.dirs, cache / "replays"),
        jobs(cache / "jobs"),
        security(secured),
        bus(chosen.use_bus ? std::make_unique<live::BusWatch>(chosen.bus) : nullptr),
        looker(chosen.bus),
        play(chosen.use_bus ? std::make_unique<live::PlayWatch>(chosen.bus) : nullptr),
        context(
            sources, [this] { return bus ? bus->View() : NoBus(); },
            [this](http::Lane lane, std::function<void()> work) { server->InLane(lane, std::move(work)); }, security,
            jobs),
        pages(chosen.web.empty() ? FindPages() : chosen.web),
        hub(context) {
    context.videos = cache / "videos";
    context.openapi = OpenApiText();
    if (chosen.use_bus) JoinBus(chosen.bus);
    context.play = play.get();
    service = std::make_unique<http::Service>(api::MakeRouter(context), security,
                                              [this](const http::Request& request) { return pages.Serve(request); });
  }

  void JoinBus(const bus::Arguments& arguments) {
    context.domain = static_cast<int>(arguments.domain);
    context.bus_flags = [arguments](security::Role role) {
      auto flags = arguments.Flags(role);
      if (!arguments.profile.empty()) flags.insert(flags.end(), {"--profile", arguments.profile});
      return flags;
    };
    context.newest = [this](const std::string& topic) { return bus->Newest(topic); };
    context.look = [this](const std::string& run, const policy::Question& question, const std::string& what_if) {
      return looker.Look(run, question, what_if);
    };
  }

  const GatewayOptions options;
  const Path cache;
  sources::Sources sources;
  api::Jobs jobs;
  std::optional<RestartHold> hold;  // while jobs run: they are its children
  const http::Security security;
  std::unique_ptr<live::BusWatch> bus;
  live::PolicyLooker looker;
  std::unique_ptr<live::PlayWatch> play;
  api::Context context;
  http::StaticFiles pages;
  api::LiveHub hub;
  std::unique_ptr<http::Service> service;
  std::unique_ptr<http::Server> server;  // last
};

Result<std::unique_ptr<Gateway>> Gateway::Open(const GatewayOptions& options) {
  ETUDE_ASSIGN_OR_RETURN(const auto security, SecurityOf(options));
  if (options.cache.empty() && CacheFolder().empty())
    return Fail(
        Code::kInvalidArgument,
        "start the dashboard: neither HOME nor XDG_CACHE_HOME says where videos may be kept: give --cache FOLDER");
  auto parts = std::make_unique<Parts>(options, security);
  http::ServerOptions serving;
  serving.address = options.address;
  serving.port = options.port;
  auto* hub = &parts->hub;
  ETUDE_ASSIGN_OR_RETURN(parts->server,
                         http::Server::Open(serving, *parts->service,
                                            [hub](const http::Request& request, std::shared_ptr<http::Socket> socket) {
                                              return hub->Connect(request, std::move(socket));
                                            }));
  return std::unique_ptr<Gateway>(new Gateway(std::move(parts)));
}

Gateway::Gateway(std::unique_ptr<Parts> parts) : parts_(std::move(parts)) {
  auto& server = *parts_->server;
  server.Every(100ms, [this] {
    parts_->hub.Tick();
    if (StopRequested()) parts_->server->Stop();
  });
  server.Every(250ms, [this] {
    parts_->jobs.Pump();
    if (!parts_->jobs.Busy())
      parts_->hold.reset();
    else if (!parts_->hold)
      parts_->hold.emplace();
  });
  // whoever opens a page next finds the folders read
  server.InLane(http::Lane::kFiles, [this] { (void)api::HomeJson(parts_->context); });
}

Gateway::~Gateway() = default;

std::uint16_t Gateway::port() const { return parts_->server->port(); }

std::string Gateway::url() const {
  // all addresses at once are none that a browser could open
  const auto& bound = parts_->options.address;
  const std::string address = bound == "0.0.0.0" ? "127.0.0.1" : bound == "::" ? "::1" : bound;
  const bool six = address.find(':') != std::string::npos;
  return fmt::format("http://{}:{}", six ? "[" + address + "]" : address, port());
}

void Gateway::Run() {
  WatchedLoop watched;
  parts_->server->Every(1s, [&watched] { watched.Moved(); });
  parts_->server->Run();
  parts_->jobs.StopAll();
}

void Gateway::Stop() { parts_->server->Stop(); }

}  // namespace etude::dashboard
