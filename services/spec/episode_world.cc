// SPDX-License-Identifier: Apache-2.0
#include "services/spec/episode_world.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "services/core/check.h"
#include "services/core/rng.h"
#include "services/spec/episode_plan.h"
#include "services/spec/object_names.h"

namespace etude {
namespace {

using Eigen::Vector3d;

constexpr double kFrame = 0.02;  // of the picture, kept free around the work volume
constexpr int kDraws = 60;       // of a camera, before the ranges begin to shrink,
constexpr double kShrink = 0.9;  // by so much with each more
constexpr int kMostDraws = 160;
constexpr double kUsualDistance = 1.8;  // m, of what is looked at by a camera that does not look down

/// Streams are told apart by the key that they belong to.
Rng StreamOf(const CampaignSpec& spec, std::uint64_t number, const std::string& key) {
  return Rng(MixSeed({spec.seed, number}, "world " + key));
}

/// In a fixed order: that of arguments is the compiler's.
Vector3d DrawVector(double size, Rng& rng) {
  const double x = rng.Uniform(-size, size), y = rng.Uniform(-size, size), z = rng.Uniform(-size, size);
  return {x, y, z};
}

Rgb DrawGain(double size, Rng rng) {
  const Vector3d change = DrawVector(size, rng);
  return {1 + change.x(), 1 + change.y(), 1 + change.z()};
}

/// `spec.camera` moved, aimed and turned anew. Every number is drawn whether its range is 0 or not.
CameraSpec MoveCamera(const CampaignSpec& spec, double scale, Rng& rng) {
  const WorldRandomizationSpec& ranges = spec.randomization.world;
  const Pose X_WC = ToCamera(spec.camera).X_WC;
  const Vector3d forward = -(X_WC.q * Vector3d::UnitZ());
  const double distance = forward.z() < 0 && X_WC.p.z() > 0 ? X_WC.p.z() / -forward.z() : kUsualDistance;
  const Vector3d p = X_WC.p + scale * DrawVector(ranges.camera_position, rng);
  Vector3d aim = scale * DrawVector(ranges.camera_aim, rng);
  aim.z() = 0;
  aim += X_WC.p + distance * forward;
  const double roll = scale * rng.Uniform(-ranges.camera_roll, ranges.camera_roll);
  const Vector3d ahead = (aim - p).normalized();
  const Eigen::Quaterniond q =
      Eigen::AngleAxisd(roll, ahead) * Eigen::Quaterniond::FromTwoVectors(forward, ahead) * X_WC.q;
  const Vector3d euler = ToEuler(q.normalized());
  CameraSpec moved = spec.camera;
  moved.position = {p.x(), p.y(), p.z()};
  moved.euler = {euler.x(), euler.y(), euler.z()};
  moved.fovy_deg += scale * rng.Uniform(-ranges.fovy_deg, ranges.fovy_deg);
  return moved;
}

}  // namespace

Camera ToCamera(const CameraSpec& spec) {
  ETUDE_CHECK(spec.position.size() == 3 && spec.euler.size() == 3);
  Camera camera;
  camera.width = spec.width;
  camera.height = spec.height;
  camera.fovy = spec.fovy_deg * std::numbers::pi / 180;
  camera.X_WC.p = Vector3d::Map(spec.position.data());
  camera.X_WC.q = FromEuler(Vector3d::Map(spec.euler.data()));
  return camera;
}

bool SeesWorkVolume(const CameraSpec& spec) {
  if (!(spec.fovy_deg > 1 && spec.fovy_deg < 170)) return false;
  const Camera camera = ToCamera(spec);
  const ViewedVolume volume;
  const double u_free = kFrame * camera.width, v_free = kFrame * camera.height;
  for (const double x : volume.x)
    for (const double y : volume.y)
      for (const double z : volume.z) {
        const Eigen::Vector2d pixel = camera.Project({x, y, z});
        // written so that NaN fails too
        const bool inside = pixel.x() >= u_free && pixel.x() <= camera.width - u_free && pixel.y() >= v_free &&
                            pixel.y() <= camera.height - v_free;
        if (!inside) return false;
      }
  return true;
}

std::optional<CameraSpec> DrawCamera(const CampaignSpec& spec, std::uint64_t index) {
  if (!spec.randomization.world.moves_camera()) return std::nullopt;
  Rng rng = StreamOf(spec, index, "camera");
  double scale = 1;
  for (int draw = 0; draw < kMostDraws; ++draw) {
    if (draw >= kDraws) scale *= kShrink;
    CameraSpec camera = MoveCamera(spec, scale, rng);
    if (SeesWorkVolume(camera)) return camera;
  }
  return spec.camera;
}

std::vector<Camera> CamerasOf(const CampaignSpec& spec, std::uint64_t count) {
  if (!spec.randomization.world.moves_camera()) return {ToCamera(spec.camera)};
  std::vector<Camera> cameras;
  for (std::uint64_t i = 0; i < count; ++i) cameras.push_back(ToCamera(*DrawCamera(spec, i)));
  return cameras;
}

std::vector<std::string> PossibleDistractorClasses(const CampaignSpec& spec) {
  std::set<std::string> named;
  for (const std::string& object : spec.objects) named.insert(ObjectNoun(object));
  std::vector<std::string> classes = GeneratedClasses();
  std::erase_if(classes, [&](const std::string& name) { return named.contains(name); });
  return classes;
}

std::vector<std::string> DrawDistractors(const CampaignSpec& spec, std::uint64_t index) {
  const int most = spec.randomization.world.distractors;
  if (most <= 0) return {};
  Rng rng = StreamOf(spec, index / kEpisodesPerScene, "distractors");
  std::vector<std::string> classes = PossibleDistractorClasses(spec);
  const std::size_t count = rng.Below(static_cast<std::uint64_t>(most) + 1);
  rng.Shuffle(classes);
  std::vector<std::string> drawn;
  for (std::size_t i = 0; i < std::min(count, classes.size()); ++i)
    drawn.push_back(DistractorName(GeneratedObject(classes[i], static_cast<int>(rng.Below(kTrainInstances)))));
  const double balls = spec.randomization.world.distractor_balls;
  if (balls <= 0 || drawn.empty()) return drawn;
  Rng ball = StreamOf(spec, index / kEpisodesPerScene, "distractor_balls");
  if (ball.Bernoulli(balls)) drawn.front() = DistractorName(BallName(static_cast<int>(ball.Below(kBallColours))));
  return drawn;
}

EpisodeWorld DrawWorld(const CampaignSpec& spec, std::uint64_t index, const std::vector<std::string>& objects) {
  const WorldRandomizationSpec& ranges = spec.randomization.world;
  const auto stream = [&](const std::string& key) { return StreamOf(spec, index, key); };
  EpisodeWorld world;
  world.camera = DrawCamera(spec, index);
  if (ranges.light_colour > 0) world.light = DrawGain(ranges.light_colour, stream("light_colour"));
  if (ranges.light_brightness > 0) {
    const double gain = 1 + stream("light_brightness").Uniform(-ranges.light_brightness, ranges.light_brightness);
    for (double& channel : world.light) channel *= gain;
  }
  if (ranges.light_direction > 0) {
    Rng rng = stream("light_direction");
    Eigen::Map<Vector3d>(world.sun_shift.data()) = DrawVector(ranges.light_direction, rng);
  }
  if (!ranges.tables.empty()) world.table = ranges.tables[stream("tables").Below(ranges.tables.size())];
  if (ranges.table_scale > 0) {
    const double most = std::log1p(ranges.table_scale);
    world.table_scale = std::exp(stream("table_scale").Uniform(-most, most));
  }
  if (ranges.table_colour > 0) world.table_colour = DrawGain(ranges.table_colour, stream("table_colour"));
  if (ranges.background > 0) {
    Rng rng = stream("background");
    Rgb& colour = world.background.emplace();
    for (double& channel : colour) channel = rng.Uniform(0, ranges.background);
  }
  for (const std::string& name : objects) {
    if (ranges.object_colour > 0) world.colour[name] = DrawGain(ranges.object_colour, stream("object_colour " + name));
    if (ranges.object_gloss > 0)
      world.gloss[name] = stream("object_gloss " + name).Uniform(-ranges.object_gloss, ranges.object_gloss);
  }
  return world;
}

OrderedJson ToJson(const EpisodeWorld& world) {
  OrderedJson json{{"light", world.light},
                   {"sun_shift", world.sun_shift},
                   {"table", world.table},
                   {"table_scale", world.table_scale},
                   {"table_colour", world.table_colour}};
  if (world.background) json["background"] = *world.background;
  json["colour"] = world.colour;
  json["gloss"] = world.gloss;
  return json;
}

}  // namespace etude
