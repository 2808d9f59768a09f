// SPDX-License-Identifier: Apache-2.0
// What a picture costs and how good it is under different quality flags: frames a second, and structural
// similarity (Wang et al. 2004, equation 13: luma, Gaussian window of 11 px, sigma 1.5) to the best picture that
// MuJoCo draws of the same scene, supersampled 4 x 4 with the most multisamples, finely tessellated.
// One frame is update, render, read. Variants take turns, so that all see the same machine.
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "services/core/statistics.h"
#include "worker/sim/gl_context.h"
#include "worker/sim/model.h"
#include "worker/sim/renderer.h"
#include "worker/task/attempt.h"

namespace etude::sim {
namespace {

constexpr int kRounds = 8, kFrames = 5, kEpisodes = 2, kSupersample = 4;
using Clock = std::chrono::steady_clock;
using Bytes = std::vector<std::uint8_t>;

struct Variant {
  std::string name;
  int samples = 0;
  std::array<int, 3> mesh{20, 10, 2};  ///< slices, stacks, quads
  int shadow_size = 0;                 ///< 0: the sun casts none
  bool reflection = false, cull = true;
};

const std::array<int, 3> kStockMesh{28, 16, 4}, kOurMesh{20, 10, 2};
const Variant kStock{"MuJoCo's defaults", 4, kStockMesh, 0, true};

std::vector<Variant> Variants() {
  const int ours = RendererConfig{}.samples;
  return {kStock,
          {"ours", ours, kOurMesh},
          {"0 samples", 0, kOurMesh},
          {"2 samples", 2, kOurMesh},
          {"4 samples", 4, kOurMesh},
          {"0 samples, stock tessellation", 0, kStockMesh},
          {"0 samples, 16/8/2", 0, {16, 8, 2}},
          {"0 samples, 16/8/1", 0, {16, 8, 1}},
          {"0 samples, 12/6/1", 0, {12, 6, 1}},
          {"0 samples, 10/6/1", 0, {10, 6, 1}},
          {"0 samples, reflections", 0, kOurMesh, 0, true},
          {"0 samples, back faces too", 0, kOurMesh, 0, false, false}};
}

/// The same with a sun that casts shadows, which the scene's does not: what they would cost.
std::vector<Variant> ShadowVariants() {
  Variant stock = kStock;
  stock.shadow_size = 4096;
  return {stock,
          {"0 samples, shadows of 1024", 0, kOurMesh, 1024},
          {"0 samples, shadows of 4096", 0, kOurMesh, 4096},
          {"0 samples, no shadows", 0, kOurMesh, 0}};
}

/// MuJoCo's render state with the flags of a variant.
class Drawer {
 public:
  Drawer(const Scene& scene, const Variant& variant, int scale)
      : model_(mj_copyModel(nullptr, scene.model().mj.get())),
        area_{0, 0, scene.camera().width * scale, scene.camera().height * scale} {
    model_->vis.global.offwidth = area_.width;
    model_->vis.global.offheight = area_.height;
    auto& quality = model_->vis.quality;
    quality.offsamples = variant.samples;
    quality.shadowsize = variant.shadow_size;
    quality.numslices = variant.mesh[0];
    quality.numstacks = variant.mesh[1];
    quality.numquads = variant.mesh[2];
    for (int i = 0; i < model_->nlight; ++i) model_->light_castshadow[i] = variant.shadow_size > 0;
    mjv_defaultOption(&option_);
    mjv_defaultCamera(&camera_);
    camera_.type = mjCAMERA_FIXED;
    camera_.fixedcamid = 0;
    mjv_defaultScene(&scene_);
    mjv_makeScene(model_.get(), &scene_, 512);
    scene_.flags[mjRND_SHADOW] = variant.shadow_size > 0;
    scene_.flags[mjRND_REFLECTION] = variant.reflection;
    scene_.flags[mjRND_CULL_FACE] = variant.cull;
    mjr_defaultContext(&context_);
    mjr_makeContext(model_.get(), &context_, mjFONTSCALE_100);
    rgb_.resize(static_cast<std::size_t>(area_.width) * area_.height * 3);
  }
  ~Drawer() {
    mjr_freeContext(&context_);
    mjv_freeScene(&scene_);
  }
  Drawer(const Drawer&) = delete;
  Drawer& operator=(const Drawer&) = delete;

  const Bytes& Frame(mjData* data) {
    mjr_setBuffer(mjFB_OFFSCREEN, &context_);
    mjv_updateScene(model_.get(), data, &option_, nullptr, &camera_, mjCAT_ALL, &scene_);
    mjr_render(area_, &scene_, &context_);
    mjr_readPixels(rgb_.data(), nullptr, area_, &context_);
    return rgb_;
  }
  int samples() const { return context_.offSamples; }  ///< what the driver granted

 private:
  ModelPtr model_;
  mjrRect area_;
  mjvOption option_;
  mjvCamera camera_;
  mjvScene scene_;
  mjrContext context_;
  Bytes rgb_;
};

std::vector<double> Luma(const Bytes& rgb) {
  std::vector<double> luma(rgb.size() / 3);
  for (std::size_t i = 0; i < luma.size(); ++i)
    luma[i] = 0.299 * rgb[3 * i] + 0.587 * rgb[3 * i + 1] + 0.114 * rgb[3 * i + 2];
  return luma;
}

/// Means over kSupersample x kSupersample px.
Bytes Shrunk(const Bytes& large, int width, int height) {
  Bytes small(static_cast<std::size_t>(width) * height * 3);
  const int row = width * kSupersample * 3;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width * 3; ++x) {
      int sum = kSupersample * kSupersample / 2;
      for (int i = 0; i < kSupersample * kSupersample; ++i)
        sum += large[static_cast<std::size_t>(y * kSupersample + i / kSupersample) * row +
                     (x / 3 * kSupersample + i % kSupersample) * 3 + x % 3];
      small[static_cast<std::size_t>(y) * width * 3 + x] =
          static_cast<std::uint8_t>(sum / (kSupersample * kSupersample));
    }
  return small;
}

/// Weighted mean around each pixel that has a whole window, row by row then column by column.
std::vector<double> Blurred(const std::vector<double>& values, int width, int height) {
  constexpr int kRadius = 5;
  std::array<double, 2 * kRadius + 1> weight{};
  double sum = 0;
  for (int i = -kRadius; i <= kRadius; ++i) sum += weight[i + kRadius] = std::exp(-i * i / (2 * 1.5 * 1.5));
  const int w = width - 2 * kRadius, h = height - 2 * kRadius;
  std::vector<double> rows(static_cast<std::size_t>(w) * height), result(static_cast<std::size_t>(w) * h);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < w; ++x)
      for (int i = 0; i <= 2 * kRadius; ++i) rows[y * w + x] += weight[i] / sum * values[y * width + x + i];
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x)
      for (int i = 0; i <= 2 * kRadius; ++i) result[y * w + x] += weight[i] / sum * rows[(y + i) * w + x];
  return result;
}

double Ssim(const Bytes& a_rgb, const Bytes& b_rgb, int width, int height) {
  const auto a = Luma(a_rgb), b = Luma(b_rgb);
  std::vector<double> aa(a.size()), bb(a.size()), ab(a.size());
  for (std::size_t i = 0; i < a.size(); ++i) aa[i] = a[i] * a[i], bb[i] = b[i] * b[i], ab[i] = a[i] * b[i];
  const auto ma = Blurred(a, width, height), mb = Blurred(b, width, height), maa = Blurred(aa, width, height),
             mbb = Blurred(bb, width, height), mab = Blurred(ab, width, height);
  const double c1 = std::pow(0.01 * 255, 2), c2 = std::pow(0.03 * 255, 2);
  double sum = 0;
  for (std::size_t i = 0; i < ma.size(); ++i) {
    const double va = maa[i] - ma[i] * ma[i], vb = mbb[i] - mb[i] * mb[i], cov = mab[i] - ma[i] * mb[i];
    sum += (2 * ma[i] * mb[i] + c1) * (2 * cov + c2) / ((ma[i] * ma[i] + mb[i] * mb[i] + c1) * (va + vb + c2));
  }
  return sum / static_cast<double>(ma.size());
}

struct Score {
  std::vector<double> fps, ssim;
};

/// Adds frames a second and similarity of each variant in the scene of `world`.
void Measure(const World& world, GlContext& gl, const std::vector<Variant>& variants, std::vector<Score>& scores) {
  gl.MakeCurrent();
  const Camera& camera = world.scene().camera();
  mjData* data = world.state().mj.get();
  Variant best{"best", 8, {64, 32, 8}, variants[0].shadow_size, true};
  const Bytes reference = Shrunk(Drawer(world.scene(), best, kSupersample).Frame(data), camera.width, camera.height);
  std::vector<std::unique_ptr<Drawer>> drawers;
  for (std::size_t i = 0; i < variants.size(); ++i) {
    drawers.push_back(std::make_unique<Drawer>(world.scene(), variants[i], 1));
    scores[i].ssim.push_back(Ssim(drawers[i]->Frame(data), reference, camera.width, camera.height));
  }
  for (int round = 0; round < kRounds; ++round)
    for (std::size_t i = 0; i < drawers.size(); ++i) {
      const auto start = Clock::now();
      for (int frame = 0; frame < kFrames; ++frame) drawers[i]->Frame(data);
      scores[i].fps.push_back(kFrames / std::chrono::duration<double>(Clock::now() - start).count());
    }
}

void Print(const std::vector<Variant>& variants, const std::vector<Score>& scores) {
  for (std::size_t i = 0; i < variants.size(); ++i)
    std::fprintf(stderr, "%-34s %7.1f frames/s  x %5.2f  SSIM mean %.4f, least %.4f\n", variants[i].name.c_str(),
                 Quantile(scores[i].fps, 0.5), Quantile(scores[i].fps, 0.5) / Quantile(scores[0].fps, 0.5),
                 Mean(scores[i].ssim), Quantile(scores[i].ssim, 0));
}

std::vector<CampaignSpec> Specs() {
  std::vector<CampaignSpec> specs(4);
  for (CampaignSpec& spec : specs) spec.tasks = {"pick"};
  specs[1].robots = {"panda"};
  specs[2].robots = {"jaco2"};
  specs[3].world.table = "stone";
  specs[3].world.background = {0.45, 0.47, 0.5};
  return specs;
}

int Run() {
  const auto variants = Variants(), with_shadows = ShadowVariants();
  std::vector<Score> scores(variants.size()), shadow_scores(with_shadows.size());
  for (const CampaignSpec& spec : Specs()) {
    auto runner = task::AttemptRunner::Open(spec);
    if (!runner) return std::fprintf(stderr, "%s\n", runner.error().message.c_str()), 3;
    auto gl = GlContext::Open({});
    if (!gl) return std::fprintf(stderr, "%s\n", gl.error().message.c_str()), 3;
    for (std::uint64_t index = 0; index < kEpisodes; ++index) {
      const auto scene = runner->Show(index, 0);
      if (!scene) continue;
      Measure(*scene->world, **gl, variants, scores);
      Measure(*scene->world, **gl, with_shadows, shadow_scores);
    }
  }
  if (scores[0].ssim.empty()) return std::fprintf(stderr, "no scene could be set up\n"), 3;
  Print(variants, scores);
  Print(with_shadows, shadow_scores);
  std::printf(
      "{\"name\": \"render_quality\", \"value\": %.1f, \"unit\": \"frames/s\", \"baseline\": %.1f, \"ratio\": %.3f, "
      "\"ssim\": %.4f, \"ssim_least\": %.4f}\n",
      Quantile(scores[1].fps, 0.5), Quantile(scores[0].fps, 0.5),
      Quantile(scores[1].fps, 0.5) / Quantile(scores[0].fps, 0.5), Mean(scores[1].ssim), Quantile(scores[1].ssim, 0));
  return 0;
}

}  // namespace
}  // namespace etude::sim

int main() { return etude::sim::Run(); }
