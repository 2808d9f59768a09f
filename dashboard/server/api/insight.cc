// SPDX-License-Identifier: Apache-2.0
// POST /insight: what the policy that serves a run sees in a recorded picture and says of it, and what it would say of
// another sentence, with a part hidden, or with a module's output replaced. Answered for that picture alone: the
// question has a session that no robot has.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "dashboard/server/api/context.h"

namespace etude::api {
namespace {

using sources::PartOf;
using sources::TextOf;
using sources::UnsignedOf;

constexpr std::size_t kLongestSentence = 400;

struct Asked {
  std::shared_ptr<const store::EpisodeRecord> record;
  std::size_t picture = 0;
  std::vector<std::uint8_t> rgb;
  policy::Question question;  // points into rgb
};

// The recorded picture as a robot would have sent it.
Status Fill(Context& context, const OrderedJson& source, Asked& asked) {
  ETUDE_ASSIGN_OR_RETURN(const auto dataset, context.sources.Dataset(TextOf(source, "dataset")));
  const auto index = UnsignedOf(source, "episode");
  if (!index) return Fail(Code::kInvalidArgument, "source.episode: must be a whole number");
  ETUDE_ASSIGN_OR_RETURN(asked.record, dataset->Episode(*index));
  const Episode& episode = asked.record->episode;
  asked.picture = UnsignedOf(source, "picture").value_or(0);
  const std::size_t pictures = asked.record->frames.empty() ? 0 : asked.record->frames[0].size();
  if (asked.picture >= pictures)
    return Fail(Code::kNotFound, fmt::format("episode {} has {} pictures", *index, pictures));
  const auto step = static_cast<std::int64_t>(asked.picture) * std::max(1, episode.image_stride);
  if (step >= episode.steps() || step >= episode.joint_pos.rows() || step >= episode.gripper_qpos.rows())
    return Fail(Code::kCorrupt, fmt::format("episode {} has no step of picture {}", *index, asked.picture));
  const Camera& camera = episode.cameras[0].camera;
  asked.rgb.resize(static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height) * 3);
  ETUDE_RETURN_IF_ERROR(
      store::FrameReader::Read(asked.record->path, asked.record->frames[0][asked.picture], asked.rgb));
  asked.question = policy::QuestionAt(episode, static_cast<int>(step), asked.rgb);
  return {};
}

// The same keys as a what-if has; its server checks their content. "": nothing is asked besides.
Result<std::string> WhatIfOf(const OrderedJson& body) {
  const OrderedJson& what_if = PartOf(body, "what_if");
  if (what_if.is_null()) return std::string();
  if (!what_if.is_object()) return Fail(Code::kInvalidArgument, "what_if: must be an object");
  for (const auto& [key, value] : what_if.items())
    if (key != "sentence" && key != "hide" && key != "say")
      return Fail(Code::kInvalidArgument, "what_if: " + NotKnown(key.substr(0, 40), {"sentence", "hide", "say"}));
  return what_if.empty() ? std::string() : what_if.dump();
}

// Where the target, the hand and others truly are in the picture, px.
OrderedJson TruthJson(const Asked& asked) {
  const Episode& episode = asked.record->episode;
  const int step = static_cast<int>(asked.picture) * std::max(1, episode.image_stride);
  OrderedJson marks = OrderedJson::object();
  const auto mark = [&](const std::string& name, const Track& pixel) {
    if (pixel.columns == 2 && step < pixel.rows()) marks[name] = {pixel.row(step)[0], pixel.row(step)[1]};
  };
  mark("hand", episode.eef_pixel);
  for (const auto& object : episode.objects) mark(object.name, object.pixel);
  return {{"target", episode.target},
          {"reference", sources::TextOrNull(episode.reference)},
          {"instruction", episode.instruction},
          {"pixels", marks}};
}

OrderedJson WaypointsJson(const policy::Insight& insight) {
  OrderedJson points = OrderedJson::array();
  for (const auto& waypoint : insight.waypoints)
    points.push_back({waypoint.X_WE.p.x(), waypoint.X_WE.p.y(), waypoint.X_WE.p.z(), waypoint.gripper});
  return points;
}

Result<http::Answer> Answer(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson body, JsonBody(request));
  if (!context.look)
    return Fail(Code::kUnavailable, "this gateway reads no bus (--no-bus): no policy server can be asked");
  const std::string run = TextOf(body, "run");
  const auto name = BusNameOfPolicy(context, run);
  if (!name)
    return http::Problem(409, "Nobody serves it", name.error().message,
                         "etude policy --subscribe NAME follows a run; etude policy --checkpoint FILE serves a file");
  ETUDE_ASSIGN_OR_RETURN(const std::string what_if, WhatIfOf(body));
  Asked asked;
  ETUDE_RETURN_IF_ERROR(Fill(context, PartOf(body, "source"), asked));
  if (const std::string sentence = TextOf(body, "sentence"); !sentence.empty())
    asked.question.instruction = sentence.substr(0, kLongestSentence);
  ETUDE_ASSIGN_OR_RETURN(const policy::Insight insight, context.look(*name, asked.question, what_if));
  return http::JsonAnswer({{"run", *name},
                           {"checkpoint_step", insight.checkpoint_step},
                           {"sentence", asked.question.instruction},
                           {"modules", http::ForBrowsers(insight.modules)},
                           {"what_if", insight.what_if.is_null() ? OrderedJson() : http::ForBrowsers(insight.what_if)},
                           {"attention", AttentionJson(insight)},
                           {"view", ViewJson(insight)},
                           {"waypoints", WaypointsJson(insight)},
                           {"truth", TruthJson(asked)}});
}

}  // namespace

OrderedJson AttentionJson(const policy::Insight& insight) {
  // what a byte of them was is kept, and not what dividing it made of it: a grid of hundreds goes several times a
  // second
  const auto rounded = [](double weight) { return std::round(weight * 1e6) / 1e6; };
  OrderedJson json = OrderedJson::object();
  for (const auto& [module, attention] : insight.attention) {
    std::vector<double> weights(attention.weights.size());
    std::ranges::transform(attention.weights, weights.begin(), rounded);
    json[module] = {{"rows", attention.rows},
                    {"columns", attention.columns},
                    {"share", attention.share()},
                    {"weights", std::move(weights)}};
  }
  return json;
}

OrderedJson ViewJson(const policy::Insight& insight) {
  const auto& view = insight.view;
  return {{"u", view.u}, {"v", view.v}, {"width", view.width}, {"height", view.height}};
}

void AddInsightRoutes(http::Router& router, Context& context) {
  // it reads an episode, waits for a policy server and changes nothing: whoever may read may ask
  router.Add("POST", kPrefix + "/insight", http::Lane::kBus,
             [&context](const http::Request& request) { return Answer(context, request); });
}

}  // namespace etude::api
