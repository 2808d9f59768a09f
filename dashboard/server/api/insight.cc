// SPDX-License-Identifier: Apache-2.0
// POST /insight: what the policy that serves a run sees in a recorded picture and says of it, and what it would say of
// another sentence, with a part hidden, or with a module's output replaced. Answered for that picture alone: the
// question has a session that no robot has.
//
// GET /evals/{id}/insights/{index}/{decision}: the same of a decision of a rollout whose evaluation kept it (etude eval
// --insight), from its file. Nobody is asked.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "dashboard/server/api/context.h"
#include "dashboard/server/api/truth.h"
#include "services/policy/insight_file.h"

namespace etude::api {
namespace {

using sources::PartOf;
using sources::TextOf;
using sources::UnsignedOf;

constexpr std::size_t kLongestSentence = 400;

struct Asked {
  std::shared_ptr<const store::EpisodeRecord> record;
  int step = 0;               // of the picture
  bool demonstrated = false;  // by an expert, and not a policy
  std::vector<std::uint8_t> rgb;
  policy::Question question;  // points into rgb
};

// @param step  of its record, which the file may not have
Status GoTo(std::int64_t step, Asked& asked) {
  const Episode& episode = asked.record->episode;
  if (step < 0 || step >= episode.steps() || step >= episode.joint_pos.rows() || step >= episode.gripper_qpos.rows() ||
      episode.cameras.empty())
    return Fail(Code::kCorrupt, fmt::format("episode {} has no camera or no step {}", episode.index, step));
  asked.step = static_cast<int>(step);
  return {};
}

// The recorded picture as a robot would have sent it.
Status Fill(Context& context, const OrderedJson& source, Asked& asked) {
  ETUDE_ASSIGN_OR_RETURN(const auto dataset, context.sources.Dataset(TextOf(source, "dataset")));
  const auto index = UnsignedOf(source, "episode");
  if (!index) return Fail(Code::kInvalidArgument, "source.episode: must be a whole number");
  ETUDE_ASSIGN_OR_RETURN(asked.record, dataset->Episode(*index));
  const Episode& episode = asked.record->episode;
  ETUDE_ASSIGN_OR_RETURN(const auto view, dataset->View());
  asked.demonstrated = view->info.spec.mode != "rollout";
  ETUDE_ASSIGN_OR_RETURN(const auto number, WholeIn(source, "picture"));
  const std::uint64_t picture = number.value_or(0);
  const std::size_t pictures = asked.record->frames.empty() ? 0 : asked.record->frames[0].size();
  if (picture >= pictures) return Fail(Code::kNotFound, fmt::format("episode {} has {} pictures", *index, pictures));
  ETUDE_RETURN_IF_ERROR(GoTo(static_cast<std::int64_t>(picture) * std::max(1, episode.image_stride), asked));
  store::FrameReader frames(asked.record->path, asked.record->frames[0]);
  ETUDE_ASSIGN_OR_RETURN(const auto rgb, frames.Read(picture));
  asked.rgb.assign(rgb.begin(), rgb.end());
  asked.question = policy::QuestionAt(episode, asked.step, asked.rgb);
  return {};
}

// The same keys as a what-if has; its server checks their content. "": nothing is asked besides.
Result<std::string> WhatIfOf(const OrderedJson& body) {
  const OrderedJson& what_if = PartOf(body, "what_if");
  if (what_if.is_null()) return std::string();
  if (!what_if.is_object()) return Fail(Code::kInvalidArgument, "what_if: must be an object");
  const std::vector<std::string> known{"sentence", "hide", "look_away", "say", "think", "worth"};
  for (const auto& [key, value] : what_if.items())
    if (std::ranges::find(known, key) == known.end())
      return Fail(Code::kInvalidArgument, "what_if: " + NotKnown(key.substr(0, 40), known));
  return what_if.empty() ? std::string() : what_if.dump();
}

// What a byte of them was is kept, and not what dividing it made of it: a grid of hundreds goes several times a second.
std::vector<double> RoundedWeights(const std::vector<double>& weights) {
  std::vector<double> rounded(weights.size());
  std::ranges::transform(weights, rounded.begin(), [](double weight) { return std::round(weight * 1e6) / 1e6; });
  return rounded;
}

OrderedJson WordsJson(const policy::Insight& insight) {
  OrderedJson words = OrderedJson::array();
  for (const auto& [word, moves] : insight.words) words.push_back(OrderedJson{{"word", word}, {"moves_m", moves}});
  return words;
}

// Where each joint was in the question, and what it is worth where that was asked.
OrderedJson JointsJson(const Asked& asked, const policy::Insight& insight) {
  const auto arm = static_cast<std::size_t>(asked.record->episode.joint_pos.columns);
  const auto& values = asked.question.joints;
  const bool worth = insight.joints.size() == values.size();
  OrderedJson joints = OrderedJson::array();
  for (std::size_t j = 0; j < values.size(); ++j) {
    const bool one_finger = values.size() == arm + 1;
    const std::string name = j < arm      ? fmt::format("joint {}", j + 1)
                             : one_finger ? "gripper"
                                          : fmt::format("gripper {}", j - arm + 1);
    joints.push_back({{"name", name},
                      {"value", values[j]},
                      {"unit", j < arm ? "rad" : "rad or m"},
                      {"moves_m", worth ? OrderedJson(insight.joints[j]) : OrderedJson()}});
  }
  return joints;
}

OrderedJson WaypointsJson(const std::vector<Waypoint>& waypoints) {
  OrderedJson points = OrderedJson::array();
  for (const auto& waypoint : waypoints)
    points.push_back({waypoint.X_WE.p.x(), waypoint.X_WE.p.y(), waypoint.X_WE.p.z(), waypoint.gripper});
  return points;
}

OrderedJson InsightJson(const std::string& run, const Asked& asked, const policy::Insight& insight) {
  const Episode& episode = asked.record->episode;
  const TruthScope scope{asked.question.instruction == episode.instruction, asked.demonstrated};
  return {{"run", run},
          {"checkpoint_step", insight.checkpoint_step},
          {"sentence", asked.question.instruction},
          {"modules", http::ForBrowsers(insight.modules)},
          {"what_if", insight.what_if.is_null() ? OrderedJson() : http::ForBrowsers(insight.what_if)},
          {"attention", AttentionJson(insight, Heads::kEach)},
          {"view", ViewJson(insight)},
          {"waypoints", WaypointsJson(insight.waypoints)},
          {"what_if_waypoints", WaypointsJson(insight.what_if_waypoints)},
          {"words", WordsJson(insight)},
          {"joints", JointsJson(asked, insight)},
          {"truth", TruthJson(episode, asked.step, insight, scope)}};
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
  return http::JsonAnswer(InsightJson(*name, asked, insight));
}

// ---- from files -----------------------------------------------------------------------------------

struct Kept {
  OpenedEval eval;
  std::uint64_t index = 0;  // of the rollout
  policy::InsightFile file;
};

// The file's name is made of the number: nothing that a request or the report says is a path.
Result<Kept> OpenKept(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(OpenedEval eval, OpenEval(context, request.Parameter("id")));
  ETUDE_ASSIGN_OR_RETURN(const std::uint64_t index, request.Index("index"));
  const Path name = Path("insights") / policy::InsightFileName(index);
  auto open = sources::OpenBelow(eval.source->found().folder, name);
  if (!open)
    return Fail(open.error().code, fmt::format("of rollout {} no insights were kept: {}", index, open.error().message));
  ETUDE_ASSIGN_OR_RETURN(auto file, policy::InsightFile::Open(std::move(open->file), name));
  return Kept{std::move(eval), index, std::move(file)};
}

// The record that the file is of, and not one that was rolled out again since.
Result<Asked> RolloutOf(Context& context, const std::string& eval, const Kept& kept) {
  ETUDE_ASSIGN_OR_RETURN(const auto dataset, context.sources.Dataset(RolloutsOf(context, eval)));
  Asked asked;
  ETUDE_ASSIGN_OR_RETURN(asked.record, dataset->Episode(kept.index));
  const Episode& episode = asked.record->episode;
  if (kept.file.of() != policy::InsightsOf{kept.index, episode.seed, episode.attempt})
    return Fail(Code::kNotFound, fmt::format("what was kept is of another attempt than rollout {} now is", kept.index));
  return asked;
}

Result<http::Answer> KeptDecisions(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const Kept kept, OpenKept(context, request));
  const std::string eval = request.Parameter("id");
  ETUDE_ASSIGN_OR_RETURN(const Asked asked, RolloutOf(context, eval, kept));
  const int stride = std::max(1, asked.record->episode.image_stride);
  OrderedJson decisions = OrderedJson::array();
  for (const auto& decision : kept.file.decisions())
    decisions.push_back({{"step", decision.step},
                         {"picture", decision.step % stride == 0 ? OrderedJson(decision.step / stride) : OrderedJson()},
                         {"kept", decision.kept()}});
  return http::JsonAnswer({{"eval", eval},
                           {"index", kept.index},
                           {"dataset", RolloutsOf(context, eval)},
                           {"instruction", asked.record->episode.instruction},
                           {"outcome", asked.record->episode.outcome},
                           {"decisions", std::move(decisions)}});
}

Result<http::Answer> KeptInsight(Context& context, const http::Request& request) {
  ETUDE_ASSIGN_OR_RETURN(const Kept kept, OpenKept(context, request));
  ETUDE_ASSIGN_OR_RETURN(const std::uint64_t decision, request.Index("decision"));
  ETUDE_ASSIGN_OR_RETURN(const policy::Insight insight, kept.file.At(decision));
  ETUDE_ASSIGN_OR_RETURN(Asked asked, RolloutOf(context, request.Parameter("id"), kept));
  ETUDE_RETURN_IF_ERROR(GoTo(kept.file.decisions()[decision].step, asked));
  asked.question = policy::QuestionAt(asked.record->episode, asked.step, {});
  return http::JsonAnswer(InsightJson(TextOf(kept.eval.view->report, "run"), asked, insight));
}

}  // namespace

OrderedJson AttentionJson(const policy::Insight& insight, Heads heads) {
  OrderedJson json = OrderedJson::object();
  for (const auto& [module, attention] : insight.attention) {
    OrderedJson& own = json[module] = {{"rows", attention.rows},
                                       {"columns", attention.columns},
                                       {"share", attention.share()},
                                       {"keys", attention.keys},
                                       {"weights", RoundedWeights(attention.mean.picture)},
                                       {"key_weights", RoundedWeights(attention.mean.keys)}};
    if (heads == Heads::kMean) continue;
    own["heads"] = OrderedJson::array();
    for (const auto& head : attention.heads)
      own["heads"].push_back({{"weights", RoundedWeights(head.picture)}, {"key_weights", RoundedWeights(head.keys)}});
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
  const std::string kept = kPrefix + "/evals/{id}/insights/{index}";
  router.Add("GET", kept, http::Lane::kEpisodes,
             [&context](const http::Request& request) { return KeptDecisions(context, request); });
  router.Add("GET", kept + "/{decision}", http::Lane::kEpisodes,
             [&context](const http::Request& request) { return KeptInsight(context, request); });
}

}  // namespace etude::api
