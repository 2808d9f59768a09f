// SPDX-License-Identifier: Apache-2.0
#include "trainer/serve/watch.h"

#include <fmt/format.h>

#include <cstdio>

#include "services/bus/directory.h"
#include "services/bus/topic.h"
#include "services/core/clock.h"
#include "services/core/log.h"
#include "services/core/printable.h"
#include "services/core/stop.h"
#include "services/episode/bounded_json.h"
#include "trainer/serve/insight_text.h"

namespace etude::serve {
namespace {

using namespace std::chrono_literals;

Status AddHidden(const std::string& text, OrderedJson& what_if) {
  const auto rectangle = ParseBoundedJson("[" + text + "]");
  if (!rectangle || rectangle->size() != 4)
    return Fail(Code::kInvalidArgument, fmt::format("--hide '{}': must be U,V,WIDTH,HEIGHT in px", text));
  what_if["hide"].push_back(*rectangle);
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

Result<std::optional<bus::Presence>> WaitForServer(const bus::Participant& participant, const Selector& run) {
  ETUDE_ASSIGN_OR_RETURN(auto directory, bus::Directory::Open(participant));
  while (!StopRequested()) {
    ETUDE_ASSIGN_OR_RETURN(auto found, directory.Find(bus::PresenceKind::kPolicy, run, 1s));
    if (found) return found;
  }
  return std::optional<bus::Presence>();
}

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
  for (const auto& text : options.hide) ETUDE_RETURN_IF_ERROR(AddHidden(text, what_if));
  for (const auto& text : options.say) ETUDE_RETURN_IF_ERROR(AddSaid(text, what_if));
  for (const auto& text : options.think) ETUDE_RETURN_IF_ERROR(AddThought(text, what_if));
  if (options.worth) what_if["worth"] = true;
  return what_if.empty() ? std::string() : JsonText(what_if);
}

Status Watch(const bus::Participant& participant, const WatchOptions& options) {
  bus::InsightWish wish;
  ETUDE_ASSIGN_OR_RETURN(wish.what_if_json, WhatIfOf(options));
  Log().info("waiting for the policy server of run {}", options.run.text());
  ETUDE_ASSIGN_OR_RETURN(const auto server, WaitForServer(participant, options.run));
  if (!server) return {};
  const std::string partition = bus::Owner{server->name, server->id}.partition();
  ETUDE_ASSIGN_OR_RETURN(auto wishes, bus::Writer<bus::InsightWish>::Open(participant, partition));
  ETUDE_ASSIGN_OR_RETURN(auto insights, bus::Reader<bus::Insight>::Open(participant, partition));
  wish.run = server->name;
  wish.run_id = server->id;
  wish.viewer = "watch-" + NewId();
  wish.session = options.session;
  wish.seconds = bus::kWishStands;
  (void)wishes.WaitForReaders(1, 10s);
  auto again = MonotonicClock::now();
  const auto wanted = [&](std::uint64_t seen) { return options.count == 0 || seen < options.count; };
  // an error of stdout: nobody reads on
  for (std::uint64_t seen = 0; !StopRequested() && wanted(seen) && std::ferror(stdout) == 0;) {
    if (MonotonicClock::now() >= again) {
      ETUDE_RETURN_IF_ERROR(wishes.Write(wish));
      again = MonotonicClock::now() + std::chrono::seconds(bus::kWishAgain);
    }
    if (!insights.Wait(200ms)) continue;
    for (const auto& insight : insights.Take()) {
      if (!wanted(seen)) break;
      if (insight.viewer != wish.viewer) continue;
      if (!insight.error.empty()) return Fail(Code::kInvalidArgument, Printable(insight.error));
      Print(insight, options.as_json);
      ++seen;
    }
  }
  wish.seconds = 0;
  return wishes.Write(wish);
}

}  // namespace etude::serve
