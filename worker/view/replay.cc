// SPDX-License-Identifier: Apache-2.0
#include "worker/view/replay.h"

#include <fmt/format.h>

#include <array>
#include <bit>
#include <filesystem>
#include <string>

#include "services/core/config.h"
#include "services/store/dataset.h"
#include "services/store/sampling_journal.h"
#include "worker/task/attempt.h"

namespace etude {
namespace {

static_assert(std::endian::native == std::endian::little, "poses.f32 is little-endian");

OrderedJson Numbers(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

std::array<float, 7> Row(const Pose& X) {
  const auto f = [](double value) { return static_cast<float>(value); };
  return {f(X.p.x()), f(X.p.y()), f(X.p.z()), f(X.q.w()), f(X.q.x()), f(X.q.y()), f(X.q.z())};
}

const char* Name(sim::Geometry::Shape shape) {
  switch (shape) {
    case sim::Geometry::Shape::kBox:
      return "box";
    case sim::Geometry::Shape::kSphere:
      return "sphere";
    case sim::Geometry::Shape::kCapsule:
      return "capsule";
    case sim::Geometry::Shape::kCylinder:
      return "cylinder";
    case sim::Geometry::Shape::kConvex:
      return "convex";
  }
  return "";
}

OrderedJson GeometryJson(const task::AttemptTrace& trace) {
  OrderedJson pieces = OrderedJson::array();
  for (const auto& piece : trace.scene->geometry()) {
    OrderedJson json{{"name", piece.name},
                     {"body", piece.body},
                     {"shape", Name(piece.shape)},
                     {"size", Numbers(piece.size)},
                     {"pose", Row(piece.X_BG)}};
    if (piece.shape == sim::Geometry::Shape::kConvex)
      for (const auto& vertex : piece.vertices) json["vertices"].push_back(Numbers(vertex));
    pieces.push_back(std::move(json));
  }
  return {{"bodies", trace.bodies},
          {"poses",
           {{"file", "poses.f32"},
            {"dtype", "float32, little-endian"},
            {"shape", {trace.poses.size(), trace.bodies.size(), 7}},
            {"columns", "x y z (m), quaternion w x y z: body in world"},
            {"rate_hz", kControlRate}}},
          {"geometry", std::move(pieces)}};
}

std::string PoseBytes(const task::AttemptTrace& trace) {
  std::string bytes;
  for (const auto& step : trace.poses)
    for (const Pose& X_WB : step) {
      const auto row = Row(X_WB);
      bytes.append(reinterpret_cast<const char*>(row.data()), sizeof row);
    }
  return bytes;
}

OrderedJson MotionsJson(const task::AttemptTrace& trace) {
  OrderedJson motions = OrderedJson::array();
  for (const auto& played : trace.motions) {
    OrderedJson poses = OrderedJson::array();
    for (const Pose& X_WE : played.motion.X_WE) poses.push_back(Row(X_WE));
    motions.push_back({{"step", played.step},
                       {"stages", played.stages},
                       {"disturbance", played.disturbance},
                       {"poses", std::move(poses)}});
  }
  return motions;
}

OrderedJson PlanJson(const EpisodePlan& plan, const task::AttemptResult& result, const task::AttemptTrace& trace) {
  OrderedJson nearest = OrderedJson::array();
  for (const auto& [step, pair, where] : trace.nearest) {
    if (pair.body_a.empty()) continue;
    OrderedJson row{{"step", step}, {"distance_m", pair.distance}, {"a", pair.body_a}, {"b", pair.body_b}};
    if (where) {
      row["a_m"] = Numbers(where->p_WA);
      row["b_m"] = Numbers(where->p_WB);
    }
    nearest.push_back(std::move(row));
  }
  return {{"index", plan.index},
          {"attempt", plan.attempt},
          {"seed", plan.seed},
          {"robot", plan.scene.robot},
          {"task", plan.task.text()},
          {"target", plan.target},
          {"reference", plan.reference},
          {"outcome", task::ToString(result.outcome)},
          {"reason", result.reason},
          {"steps", result.episode.steps()},
          {"scene", result.scene},
          {"details", result.episode.details},
          {"motions", MotionsJson(trace)},
          {"nearest", std::move(nearest)}};
}

Status CheckOut(const Path& out) {
  std::error_code error;
  if (!std::filesystem::exists(out, error) || std::filesystem::is_empty(out, error)) return {};
  return Fail(Code::kInvalidArgument,
              fmt::format("write a replay to '{}': it is there and not empty; choose another folder", out.string()));
}

Status WriteEpisode(const CampaignSpec& spec, const Episode& episode, const ReplayOptions& options) {
  ETUDE_ASSIGN_OR_RETURN(auto writer, store::DatasetWriter::Open(options.out, spec));
  if (options.sampling) {
    ETUDE_ASSIGN_OR_RETURN(auto journal, store::SamplingJournal::Open(options.out, spec));
    ETUDE_RETURN_IF_ERROR(journal.Append(*options.sampling));
  }
  ETUDE_RETURN_IF_ERROR(writer.Commit(episode));
  return writer.WriteMaster();
}

}  // namespace

Status ReplayAttempt(const CampaignSpec& spec, const ReplayOptions& options, const sim::RendererConfig& renderer) {
  if (spec.mode != "demonstrate")
    return Fail(Code::kInvalidArgument,
                fmt::format("replay an attempt of mode '{}': only the expert's can be made again without a policy; "
                            "rollouts are recorded by `etude eval`",
                            spec.mode));
  ETUDE_RETURN_IF_ERROR(CheckOut(options.out));
  const SamplingWeights weights = options.sampling ? options.sampling->weights : SamplingWeights();
  if (!weights.empty()) ETUDE_RETURN_IF_ERROR(CheckWeights(weights, spec));
  ETUDE_ASSIGN_OR_RETURN(auto runner, task::AttemptRunner::Open(spec, renderer));
  task::AttemptTrace trace;
  ETUDE_ASSIGN_OR_RETURN(const task::AttemptResult result,
                         runner.Demonstrate(options.index, options.attempt, weights, &trace));
  const EpisodePlan& plan = trace.plan;
  const int steps = result.episode.steps();
  ETUDE_RETURN_IF_ERROR(MakeFolders(options.out));
  // the dataset comes first: it takes an empty folder only
  if (steps > 0) ETUDE_RETURN_IF_ERROR(WriteEpisode(spec, result.episode, options));
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(options.out / "plan.json", JsonText(PlanJson(plan, result, trace)) + "\n"));
  if (trace.scene)
    ETUDE_RETURN_IF_ERROR(WriteFileAtomically(options.out / "geometry.json", JsonText(GeometryJson(trace)) + "\n"));
  if (steps > 0) ETUDE_RETURN_IF_ERROR(WriteFileAtomically(options.out / "poses.f32", PoseBytes(trace)));
  fmt::print("episode {}, attempt {}: {} {}: {}{}, {}\n", plan.index, plan.attempt, plan.task.text(), plan.target,
             task::ToString(result.outcome), result.reason.empty() ? "" : " (" + result.reason + ")",
             steps > 0 ? fmt::format("{} steps", steps) : "before anything moved");
  return {};
}

}  // namespace etude
