// SPDX-License-Identifier: Apache-2.0
#include "tests/support/synthetic_episode.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "services/codec/frames.h"
#include "services/core/check.h"
#include "services/core/rng.h"
#include "services/episode/action.h"
#include "services/episode/codec.h"
#include "services/episode/frame_cursor.h"
#include "services/spec/episode_plan.h"
#include "services/spec/episode_world.h"
#include "services/store/dataset.h"

namespace etude {
namespace {

using Eigen::Vector3d;

constexpr double kObjectRadius = 0.05;  // m
constexpr double kHandRadius = 0.03;    // m

struct Disc {
  Vector3d p_W;
  double radius = 0;  // m
  std::array<std::uint8_t, 3> color;
};

Camera CameraOf(const CampaignSpec& spec, std::uint64_t index) {
  return ToCamera(DrawCamera(spec, index).value_or(spec.camera));
}

// wood-like ground with discs on it, far ones first
std::vector<std::uint8_t> Draw(const Camera& camera, std::vector<Disc> discs) {
  const auto depth = [&](const Disc& disc) { return -(camera.X_WC.inverse() * disc.p_W).z(); };
  std::stable_sort(discs.begin(), discs.end(), [&](const Disc& a, const Disc& b) { return depth(a) > depth(b); });
  struct Circle {
    Eigen::Vector2d center;
    double radius;
    std::array<std::uint8_t, 3> color;
  };
  std::vector<Circle> circles;
  for (const Disc& disc : discs)
    circles.push_back(
        {camera.Project(disc.p_W), std::max(1.0, camera.focal() * disc.radius / depth(disc)), disc.color});
  std::vector<std::uint8_t> pixels(static_cast<std::size_t>(camera.width) * camera.height * 3);
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const int grain = (u * 7 + v * v) % 13;
      std::array<std::uint8_t, 3> color{static_cast<std::uint8_t>(160 + grain), static_cast<std::uint8_t>(112 + grain),
                                        static_cast<std::uint8_t>(74 + grain)};
      for (const Circle& circle : circles)
        if ((Eigen::Vector2d(u + 0.5, v + 0.5) - circle.center).norm() <= circle.radius) color = circle.color;
      std::copy(color.begin(), color.end(), &pixels[3 * (static_cast<std::size_t>(v) * camera.width + u)]);
    }
  }
  return pixels;
}

void Push(Track& track, int columns, std::initializer_list<double> values) {
  track.columns = columns;
  ETUDE_CHECK(static_cast<int>(values.size()) == columns);
  for (double value : values) track.values.push_back(static_cast<float>(value));
}

// places that do not overlap, all in view of the default camera
std::vector<Vector3d> Places(std::size_t count, Rng& rng) {
  std::vector<Vector3d> places;
  while (places.size() < count) {
    const double y = rng.Uniform(-0.25, 0.3);  // a statement each: arguments have no order
    const Vector3d place(rng.Uniform(-0.35, 0.35), y, kObjectRadius);
    const bool free = std::all_of(places.begin(), places.end(),
                                  [&](const Vector3d& other) { return (other - place).norm() > 2.2 * kObjectRadius; });
    if (free) places.push_back(place);
  }
  return places;
}

void PushStep(Episode& episode, const Vector3d& p_WE, const Vector3d& next, double closed) {
  const Camera& camera = episode.cameras[0].camera;
  const auto joint = [](const Vector3d& p) {
    return std::array<double, 6>{std::atan2(p.y(), p.x() + 1), p.x(), p.y() - p.x(), p.z(), p.y(),
                                 std::sin(p.z() + p.x())};
  };
  const auto q = joint(p_WE);
  const auto q_next = joint(next);
  std::array<double, 6> v{};
  for (int i = 0; i < 6; ++i) v[i] = (q_next[i] - q[i]) * kControlRate;
  Push(episode.joint_pos, 6, {q[0], q[1], q[2], q[3], q[4], q[5]});
  Push(episode.joint_vel, 6, {v[0], v[1], v[2], v[3], v[4], v[5]});
  Push(episode.gripper_qpos, 1, {0.8 * closed});
  Push(episode.eef_pos, 3, {p_WE.x(), p_WE.y(), p_WE.z()});
  Push(episode.eef_quat, 4, {0, 1, 0, 0});
  const Eigen::Vector2d pixel = camera.Project(p_WE);
  Push(episode.eef_pixel, 2, {pixel.x(), pixel.y()});
  episode.actions_abs.columns = kWaypointSize;
  episode.actions_abs.Push(ToVector({{next, FromEuler({M_PI, 0, 0})}, closed}));
  Push(episode.states, 8, {q[0], q[1], q[2], q[3], q[4], q[5], 0.8 * closed, v[0]});
  episode.supervise.push_back(1);
}

void Describe(Episode& episode, const CampaignSpec& spec, std::uint64_t index) {
  episode.campaign = spec.name;
  episode.index = index;
  episode.seed = EpisodeSeed(spec, index, 0);
  episode.spec_sha256 = SpecHash(spec);
  episode.scene_sha256 = std::string(64, '0');
  episode.version = "synthetic";
  episode.robot = spec.robots[0];
  episode.task = PlanEpisode(spec, index, 0).task.text();
  episode.success = true;
  episode.image_stride = spec.image_stride;
  episode.stage_names = {"reach", "lift"};
  episode.details = {{"planner", "line"}, {"cost", 0.25 * static_cast<double>(index % 4)}};
}

}  // namespace

CampaignSpec SyntheticSpec(int width, int height) {
  CampaignSpec spec;
  spec.name = "synthetic";
  spec.episodes = 20;
  spec.camera.width = width;
  spec.camera.height = height;
  return spec;
}

std::array<std::uint8_t, 3> SyntheticColor(const std::string& object) {
  static const std::map<std::string, std::array<std::uint8_t, 3>> colors{
      {"cube", {220, 20, 20}},   {"coke", {160, 0, 60}},    {"pepsi", {20, 40, 200}},
      {"milk", {120, 200, 240}}, {"bread", {240, 200, 40}}, {"bottle", {20, 160, 40}}};
  const auto it = colors.find(object);
  ETUDE_CHECK(it != colors.end(), "{}", object);
  return it->second;
}

Episode MakeSyntheticEpisode(const CampaignSpec& spec, std::uint64_t index, int steps) {
  ETUDE_CHECK(steps >= 2);
  Rng rng(EpisodeSeed(spec, index, 0));
  Episode episode;
  Describe(episode, spec, index);
  episode.cameras.push_back({CameraOf(spec, index), {}, {}});
  const Camera camera = episode.cameras[0].camera;
  codec::FrameDeflater frames(codec::LayoutFor(camera.width, camera.height));

  std::vector<Vector3d> places = Places(spec.objects.size(), rng);
  const std::size_t target = rng.Below(spec.objects.size());
  episode.target = spec.objects[target];
  episode.instruction =
      episode.task == "put_down" ? "put down the " + episode.target : episode.task + " the " + episode.target;
  for (const auto& name : spec.objects) episode.objects.emplace_back().name = name;
  const double z = rng.Uniform(0.25, 0.4), y = rng.Uniform(-0.2, 0.2);
  const Vector3d start(rng.Uniform(-0.3, 0.3), y, z);
  const Vector3d grasp = places[target];

  // two thirds of the time to the target, then straight up with it
  const auto hand = [&](int t) -> Vector3d {
    const double s = std::min(1.0, t / (steps - 1.0));
    if (s < 2.0 / 3) return start + (grasp - start) * (1.5 * s);
    return grasp + Vector3d::UnitZ() * (0.45 * (s - 2.0 / 3));
  };
  for (int t = 0; t < steps; ++t) {
    const bool lifting = t / (steps - 1.0) >= 2.0 / 3;
    if (lifting) places[target] = hand(t);
    PushStep(episode, hand(t), hand(t + 1), lifting ? 1 : 0);
    episode.phase.push_back(lifting ? 1 : 0);
    std::vector<Disc> discs{{hand(t) + Vector3d(0, 0, kHandRadius), kHandRadius, {255, 255, 255}}};
    for (std::size_t i = 0; i < places.size(); ++i) {
      const Vector3d& p = places[i];
      const Eigen::Vector2d pixel = camera.Project(p);
      Push(episode.objects[i].pose, 7, {p.x(), p.y(), p.z(), 1, 0, 0, 0});
      Push(episode.objects[i].pixel, 2, {pixel.x(), pixel.y()});
      discs.push_back({p, kObjectRadius, SyntheticColor(spec.objects[i])});
    }
    if (t % spec.image_stride == 0) frames.Add(Draw(camera, std::move(discs)));
  }
  episode.cameras[0].Take(frames.Finish());
  return episode;
}

Episode Recut(Episode episode, codec::ChunkShape chunk) {
  for (std::size_t i = 0; i < episode.cameras.size(); ++i) {
    CameraTrack& track = episode.cameras[i];
    codec::FrameDeflater frames({track.camera.width, track.camera.height, chunk});
    FrameCursor cursor(episode, i);
    for (std::size_t k = 0; k < cursor.size(); ++k) {
      const auto frame = cursor.Frame(k);
      ETUDE_CHECK(frame.has_value());
      frames.Add(*frame);
    }
    track.Take(frames.Finish());
  }
  return episode;
}

}  // namespace etude
