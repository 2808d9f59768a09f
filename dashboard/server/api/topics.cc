// SPDX-License-Identifier: Apache-2.0
// GET /topics, /topics/{topic}/newest and /events: the bus itself, and what its processes warned of.
#include "services/monitor/topics.h"

#include <fmt/format.h>

#include <algorithm>

#include "dashboard/server/api/context.h"

namespace etude::api {
namespace {

constexpr std::size_t kMostSample = 64 * 1024;  // bytes of JSON

// Texts that are JSON themselves, such as failures_json, stay texts: a page shows them as such.
OrderedJson OfSample(const live::Sample& sample) {
  OrderedJson message = http::ForBrowsers(sample.message);
  const std::size_t size = JsonText(message).size();
  if (size > kMostSample) message = {{"too_large", fmt::format("{} bytes of JSON", size)}};
  return {{"partition", sample.partition}, {"age_ms", live::AgeMs(sample.heard)}, {"message", message}};
}

OrderedJson EventJson(const bus::ProcessEvent& event) {
  return {{"process", event.process},
          {"role", event.role},
          {"host", event.host},
          {"n", event.number},
          {"t", sources::Rfc3339(static_cast<double>(event.time_ms) / 1000)},
          {"level", event.level},
          {"code", event.code},
          {"text", event.text}};
}

}  // namespace

OrderedJson TopicsJson(Context& context) {
  const auto live = context.live();
  const auto names = monitor::PeerNames(live->processes);
  OrderedJson rows = OrderedJson::array();
  for (const auto& [topic, row] : monitor::TopicRows(*live->endpoints, live->participant)) {
    OrderedJson json = monitor::TopicJson(topic, row, names);
    const auto rate = live->rates.find(topic);
    const bool counted = rate != live->rates.end();
    json["per_s"] = counted ? OrderedJson(rate->second.samples_per_second) : OrderedJson();
    json["bytes_per_s"] = counted ? OrderedJson(rate->second.bytes_per_second) : OrderedJson();
    json["bulk"] = monitor::IsBulk(topic);
    rows.push_back(std::move(json));
  }
  return {{"domain", context.domain >= 0 ? OrderedJson(context.domain) : OrderedJson()},
          {"error", sources::TextOrNull(live->error)},
          {"topics", rows}};
}

Result<OrderedJson> SampleJson(Context& context, const std::string& topic) {
  if (!context.newest) return Fail(Code::kUnavailable, "this gateway reads no bus (--no-bus)");
  ETUDE_ASSIGN_OR_RETURN(const auto samples, context.newest(topic));
  OrderedJson rows = OrderedJson::array();
  for (const auto& sample : samples) rows.push_back(OfSample(sample));
  return OrderedJson{{"topic", topic}, {"samples", rows}};
}

Result<OrderedJson> EventsJson(Context& context, const http::Query& query) {
  ETUDE_ASSIGN_OR_RETURN(const auto limit, query.Integer("limit", 200, 1, 500));
  const std::string level = query.Get("level").value_or("warn"), text = query.Get("q").value_or("");
  if (level != "warn" && level != "error")
    return Fail(Code::kInvalidArgument, "level: " + NotKnown(level.substr(0, 40), {"warn", "error"}));
  const auto live = context.live();
  OrderedJson rows = OrderedJson::array();
  std::size_t total = 0;
  for (const auto& item : *live->events) {
    const bus::ProcessEvent& event = item.event;
    if (level == "error" && event.level != "error") continue;
    if (!text.empty() && (event.text + event.role + event.host + event.code).find(text) == std::string::npos) continue;
    if (++total <= static_cast<std::size_t>(limit)) rows.push_back(EventJson(event));
  }
  return OrderedJson{{"total", total}, {"events", rows}};
}

void AddTopicRoutes(http::Router& router, Context& context) {
  const auto add = [&](const std::string& path, auto handler) {
    router.Add("GET", kPrefix + path, http::Lane::kFiles,
               [&context, handler](const http::Request& request) -> Result<http::Answer> {
                 ETUDE_ASSIGN_OR_RETURN(const OrderedJson json, handler(context, request));
                 return http::JsonAnswer(json);
               });
  };
  add("/topics", [](Context& of, const http::Request&) -> Result<OrderedJson> { return TopicsJson(of); });
  add("/topics/{topic}/newest",
      [](Context& of, const http::Request& request) { return SampleJson(of, request.Parameter("topic")); });
  add("/events", [](Context& of, const http::Request& request) { return EventsJson(of, request.query); });
}

}  // namespace etude::api
