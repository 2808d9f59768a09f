// SPDX-License-Identifier: Apache-2.0
// Attempts that were made again: whether one was, and what it left (worker/view/replay.h says what it writes).
#include "dashboard/server/api/replays.h"

#include <fmt/format.h>

#include "dashboard/server/api/jobs.h"
#include "services/core/command.h"
#include "services/episode/bounded_json.h"
#include "services/spec/content_version.h"

namespace etude::api {
namespace {

constexpr std::uint64_t kMostJson = 16 << 20;

// A replay that is there, by its dataset's id.
Result<Path> OpenReplay(Context& context, const http::Request& request) {
  const std::string id = request.Parameter("id");
  const auto key = sources::Replays::KeyIn(id);
  if (!key) return Fail(Code::kNotFound, fmt::format("there is no replay '{:.100}'", id));
  return context.sources.replays().Find(*key);
}

Result<http::Answer> ReplayState(Context& context, const http::Request& request) {
  constexpr std::int64_t kMostAttempts = 1'000'000;
  ETUDE_ASSIGN_OR_RETURN(const std::uint64_t index, request.Index("n"));
  ETUDE_ASSIGN_OR_RETURN(const auto attempt, request.query.Integer("attempt", 0, 0, kMostAttempts));
  const auto wish = FindAttempt(context, request.Parameter("id"), index, static_cast<std::uint32_t>(attempt));
  if (!wish && wish.error().code != Code::kInvalidArgument) return Fail(wish.error());
  const std::string id = wish ? sources::Replays::IdOf(wish->key) : "";
  const bool there = wish && context.sources.replays().Find(wish->key);
  const auto job = there ? std::nullopt : context.jobs.Running(id);
  return http::JsonAnswer({{"id", sources::TextOrNull(id)},
                           {"state", !wish   ? "impossible"
                                     : there ? "ready"
                                     : job   ? "running"
                                             : "none"},
                           {"why_not", wish ? OrderedJson() : OrderedJson(wish.error().message)},
                           {"job", sources::Maybe(job)},
                           {"has_episode", there && context.sources.replays().FindDataset(wish->key)}});
}

Result<http::Answer> ReplayJson(Context& context, const http::Request& request, const char* file) {
  ETUDE_ASSIGN_OR_RETURN(const Path place, OpenReplay(context, request));
  ETUDE_ASSIGN_OR_RETURN(const std::string text, ReadTextFile(place / file, kMostJson));
  const auto json = ParseBoundedJson(text);
  if (!json) return Fail(Code::kCorrupt, fmt::format("{} of replay {} is not JSON", file, request.Parameter("id")));
  return http::JsonAnswer(http::ForBrowsers(*json));
}

Result<http::Answer> ReplayPoses(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const Path place, OpenReplay(context, request));
  ETUDE_ASSIGN_OR_RETURN(auto open, sources::OpenBelow(place, "poses.f32"));
  http::Answer answer;
  answer.content_type = "application/octet-stream";
  answer.file = http::FileBody{std::make_shared<Descriptor>(std::move(open.file)), open.stamp.size};
  answer.etag = open.stamp.tag();
  return answer;
}

std::string ReplayKeyOf(const OpenedDataset& opened, std::uint64_t index, std::uint32_t attempt) {
  const auto& info = opened.view->info;
  return sources::Replays::KeyOf({opened.source->found().folder.string(), info.identity, info.spec_sha256, Version(),
                                  std::to_string(kContentVersion), std::to_string(index), std::to_string(attempt)});
}

}  // namespace

Result<ReplayableAttempt> FindAttempt(Context& context, const std::string& dataset, std::uint64_t index,
                                      std::uint32_t attempt) {
  ETUDE_ASSIGN_OR_RETURN(const OpenedDataset opened, OpenDataset(context, dataset));
  const auto& info = opened.view->info;
  if (index >= info.spec.episodes)
    return Fail(Code::kNotFound, fmt::format("campaign '{}' has {} episodes, and none of index {}", info.spec.name,
                                             info.spec.episodes, index));
  if (info.spec.mode != "demonstrate")
    return Fail(Code::kInvalidArgument, "a rollout is its policy's: only the expert's attempts can be made again");
  return ReplayableAttempt{opened.source->found().folder, ReplayKeyOf(opened, index, attempt)};
}

std::string PicturedReplay(Context& context, const OpenedDataset& opened, std::uint64_t index, std::uint32_t attempt) {
  if (opened.view->info.spec.mode != "demonstrate") return "";
  const std::string key = ReplayKeyOf(opened, index, attempt);
  return context.sources.replays().HasEpisode(key) ? sources::Replays::IdOf(key) : "";
}

void AddReplayRoutes(http::Router& router, Context& context) {
  const auto add = [&](const std::string& path, auto handler) {
    router.Add("GET", kPrefix + path, http::Lane::kFiles,
               [&context, handler](const http::Request& request) { return handler(context, request); });
  };
  add("/datasets/{id}/episodes/{n}/replay", ReplayState);
  add("/replays/{id}/plan.json",
      [](Context& of, const http::Request& request) { return ReplayJson(of, request, "plan.json"); });
  add("/replays/{id}/geometry.json",
      [](Context& of, const http::Request& request) { return ReplayJson(of, request, "geometry.json"); });
  add("/replays/{id}/poses.f32", ReplayPoses);
}

}  // namespace etude::api
