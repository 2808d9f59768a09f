// SPDX-License-Identifier: Apache-2.0
// Frames a second through sim::Renderer against a bare MuJoCo loop with the same flags in the same
// GL context, interleaved in blocks so that both see the same machine. One frame is update, render,
// read.
#include <chrono>
#include <cstdio>
#include <vector>

#include "services/core/statistics.h"
#include "worker/sim/model.h"
#include "worker/sim/renderer.h"

namespace etude::sim {
namespace {

constexpr int kBlocks = 24, kFrames = 25;
using Clock = std::chrono::steady_clock;

/// The loop as MuJoCo's own samples write it.
class Bare {
 public:
  explicit Bare(const Scene& scene)
      : model_(scene.model().mj.get()), area_{0, 0, scene.camera().width, scene.camera().height} {
    mjv_defaultOption(&option_);
    mjv_defaultCamera(&camera_);
    camera_.type = mjCAMERA_FIXED;
    camera_.fixedcamid = 0;
    mjv_defaultScene(&scene_);
    mjv_makeScene(model_, &scene_, 512);
    for (const int flag : {mjRND_SHADOW, mjRND_REFLECTION, mjRND_SKYBOX, mjRND_HAZE, mjRND_FOG}) scene_.flags[flag] = 0;
    mjr_defaultContext(&context_);
    mjr_makeContext(model_, &context_, mjFONTSCALE_100);
  }
  ~Bare() {
    mjr_freeContext(&context_);
    mjv_freeScene(&scene_);
  }
  void Frame(mjData* data, std::uint8_t* rgb) {
    mjr_setBuffer(mjFB_OFFSCREEN, &context_);
    mjv_updateScene(model_, data, &option_, nullptr, &camera_, mjCAT_ALL, &scene_);
    mjr_render(area_, &scene_, &context_);
    mjr_readPixels(rgb, nullptr, area_, &context_);
  }

 private:
  const mjModel* model_;
  mjrRect area_;
  mjvOption option_;
  mjvCamera camera_;
  mjvScene scene_;
  mjrContext context_;
};

/// Seconds for kFrames frames, the world moving between them.
template <class Frame>
double Block(World& world, Frame frame) {
  double seconds = 0;
  const Pose X = world.X_WE();
  for (int i = 0; i < kFrames; ++i) {
    world.Step({X, i % 2 ? 1.0 : 0.0}, Eigen::Matrix<double, 6, 1>::Zero());
    const auto start = Clock::now();
    frame();
    seconds += std::chrono::duration<double>(Clock::now() - start).count();
  }
  return seconds;
}

int Run() {
  auto scene = Scene::Build(SceneSpec{});
  if (!scene) return std::fprintf(stderr, "%s\n", scene.error().message.c_str()), 1;
  auto renderer = Renderer::Open(*scene);
  if (!renderer) return std::fprintf(stderr, "%s\n", renderer.error().message.c_str()), 3;
  World world(*scene);
  std::vector<std::uint8_t> rgb(static_cast<std::size_t>((*scene)->camera().width) * (*scene)->camera().height * 3);
  std::vector<double> ours, theirs, ratios;
  {
    Bare bare(**scene);
    const auto our_frame = [&] { renderer->Render(world, rgb); };
    const auto bare_frame = [&] { bare.Frame(world.state().mj.get(), rgb.data()); };
    Block(world, our_frame);
    Block(world, bare_frame);
    for (int block = 0; block < kBlocks; ++block) {
      const bool first = block % 2 == 0;  // neither side always comes second
      double a = first ? Block(world, our_frame) : 0;
      const double b = Block(world, bare_frame);
      if (!first) a = Block(world, our_frame);
      ours.push_back(kFrames / a);
      theirs.push_back(kFrames / b);
      ratios.push_back(b / a);
    }
  }
  std::fprintf(stderr, "%s, %s\n", renderer->backend().c_str(), renderer->gl_renderer().c_str());
  std::printf(
      "{\"name\": \"render\", \"value\": %.1f, \"unit\": \"frames/s\", \"baseline\": %.1f, "
      "\"ratio\": %.3f}\n",
      Quantile(ours, 0.5), Quantile(theirs, 0.5), Quantile(ratios, 0.5));
  return 0;
}

}  // namespace
}  // namespace etude::sim

int main() { return etude::sim::Run(); }
