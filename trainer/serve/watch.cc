// SPDX-License-Identifier: Apache-2.0
#include "trainer/serve/watch.h"

#include <fmt/format.h>

#include <cstdio>
#include <optional>
#include <set>
#include <utility>

#include "services/core/log.h"
#include "services/core/printable.h"
#include "services/core/stop.h"
#include "services/episode/bounded_json.h"
#include "services/policy/insight_stream.h"
#include "trainer/serve/insight_text.h"

namespace etude::serve {
namespace {

constexpr std::chrono::milliseconds kLook{50};  // between two looks for what came

Status AddRectangle(const char* option, const std::string& text, OrderedJson& rectangles) {
  const auto rectangle = ParseBoundedJson("[" + text + "]");
  if (!rectangle || rectangle->size() != 4)
    return Fail(Code::kInvalidArgument, fmt::format("{} '{}': must be U,V,WIDTH,HEIGHT in px", option, text));
  rectangles.push_back(*rectangle);
  return {};
}

Status AddSaid(const std::string& text, OrderedJson& what_if) {
  const auto dot = text.find('.'), equals = text.find('=');
  if (dot == std::string::npos || equals == std::string::npos || dot > equals)
    return Fail(Code::kInvalidArgument,
                fmt::format("--say '{}': must be MODULE.QUANTITY=VALUE, e.g. TAR3D.position=[0.1,0.3,0.04]", text));
  const std::string value = text.substr(equals + 1);
  const auto parsed = ParseBoundedJson(value);
  what_if["say"][text.substr(0, dot)][text.substr(dot + 1, equals - dot - 1)] = parsed ? *parsed : OrderedJson(value);
  return {};
}

Status AddThought(const std::string& text, OrderedJson& what_if) {
  const auto equals = text.find('=');
  if (equals == std::string::npos)
    return Fail(Code::kInvalidArgument,
                fmt::format("--think '{}': must be MODULE=SENTENCE, or MODULE=zero, e.g. TAR2D=push the coke", text));
  what_if["think"][text.substr(0, equals)] = text.substr(equals + 1);
  return {};
}

// Says which server is looked into, and when it is none or another one.
class ServerLog {
 public:
  explicit ServerLog(const Selector& run) : run_(run) { Waiting(); }
  void Note(const std::optional<bus::Presence>& server) {
    const std::string id = server ? server->id : "";
    if (id == id_) return;
    id_ = id;
    if (server)
      Log().info("looking into {}@{} on {}", server->name, server->id, server->host);
    else
      Waiting();
  }

 private:
  void Waiting() { Log().info("waiting for the policy server of run {}", run_.text()); }
  const Selector& run_;
  std::string id_;
};

void Print(const bus::Insight& insight, bool as_json) {
  if (as_json)
    fmt::print("{}\n", InsightLine(insight));
  else
    fmt::print("{} #{}  step {}  \"{}\"\n{}\n", Printable(insight.session), insight.request_id, insight.checkpoint_step,
               Printable(insight.instruction), InsightText(insight));
  std::fflush(stdout);
}

}  // namespace

Result<std::string> WhatIfOf(const WatchOptions& options) {
  OrderedJson what_if = OrderedJson::object();
  if (!options.sentence.empty()) what_if["sentence"] = options.sentence;
  for (const auto& text : options.hide) ETUDE_RETURN_IF_ERROR(AddRectangle("--hide", text, what_if["hide"]));
  for (const auto& text : options.look_away)
    ETUDE_RETURN_IF_ERROR(AddRectangle("--look-away", text, what_if["look_away"]));
  for (const auto& text : options.say) ETUDE_RETURN_IF_ERROR(AddSaid(text, what_if));
  for (const auto& text : options.think) ETUDE_RETURN_IF_ERROR(AddThought(text, what_if));
  if (options.worth) what_if["worth"] = true;
  return what_if.empty() ? std::string() : JsonText(what_if);
}

bool EndsTheWatch(const bus::Insight& insight, const WatchOptions& options) {
  return !options.session.empty() || insight.error.starts_with("what if: ");
}

Status Watch(const bus::Participant& participant, const WatchOptions& options) {
  bus::InsightWish wish;
  ETUDE_ASSIGN_OR_RETURN(wish.what_if_json, WhatIfOf(options));
  wish.viewer = "watch-" + NewId();
  wish.session = options.session;
  ETUDE_ASSIGN_OR_RETURN(auto stream, policy::InsightStream::Open(participant, options.run, std::move(wish)));
  ServerLog log(options.run);
  const auto wanted = [&](std::uint64_t seen) { return options.count == 0 || seen < options.count; };
  std::set<std::string> refused;
  // an error of stdout: nobody reads on
  for (std::uint64_t seen = 0; !StopRequested() && wanted(seen) && std::ferror(stdout) == 0; WaitForStop(kLook)) {
    ETUDE_ASSIGN_OR_RETURN(const auto insights, stream.Take());
    log.Note(stream.server());
    for (const auto& insight : insights) {
      if (!wanted(seen)) break;
      if (!insight.error.empty()) {
        if (EndsTheWatch(insight, options)) return Fail(Code::kInvalidArgument, Printable(insight.error));
        if (refused.insert(insight.session).second)
          Log().warn("session {}: {}", Printable(insight.session), Printable(insight.error));
        continue;
      }
      Print(insight, options.as_json);
      ++seen;
    }
  }
  return {};
}

}  // namespace etude::serve
